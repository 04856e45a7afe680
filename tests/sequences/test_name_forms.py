"""Names of images: in every format they sort as time, and a folder that was begun with others goes
on with these.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
from iclnuim.channels import DEPTH, RGB
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory, stamps_of_frames
from iclnuim.postprocess import frames_from
from iclnuim.sequences.frame_source import image_frames, original_frames
from iclnuim.sequences.frames import SequenceFrame
from iclnuim.sequences.sequence_formats import FORMATS
from iclnuim.sequences.sequence_options import SequenceSettings
from iclnuim.sequences.stored_sequence import StoredSequence
from iclnuim.sequences.writer import write_sequence

#: Frames on both sides of 10 s, of image 10 and of image 100.
FRAMES = (1, 9, 10, 11, 99, 100, 269, 270, 271)
#: Formats whose published names do not sort as time.
UNSORTED = ("icl-nuim", "scannet", "eth3d", "euroc", "rtabmap", "replica-v2", "record3d")
#: The only format whose names always are as published, with rgb_0.png in the code of its readers.
PUBLISHED_ONLY = "replica-v2"


def load(number):
    light = np.full((6, 8, 3), number / 300, np.float32)
    return light, np.full((6, 8), 1 + number / 100, np.float32)


@pytest.fixture(scope="module")
def source():
    numbers = np.arange(272)
    positions = np.stack([numbers / 100, np.sin(numbers / 50), 0 * numbers], 1)
    poses = SE3(np.tile(np.eye(3), (272, 1, 1)), positions)
    camera = PinholeCamera(8, 6, 6.0, 6.0, 3.5, 2.5)
    made = frames_from(camera, Trajectory(stamps_of_frames(numbers), poses), load)
    return replace(made, numbers=FRAMES)


@pytest.fixture(scope="module", params=["sorted", "published"])
def written(source, request, tmp_path_factory):
    out = tmp_path_factory.mktemp("forms") / "out"
    write_sequence(source, out, SequenceSettings(names=request.param), FORMATS, workers=1)
    return request.param, out


@pytest.mark.parametrize("name", FORMATS)
def test_names_sort_as_time_as_text_and_as_numbers(written, name):
    form, out = written
    for kind in (RGB, DEPTH):
        names = [getattr(pair, kind).name for pair in StoredSequence(out / name).pairs]
        assert len(names) == len(FRAMES)
        is_sorted = names == sorted(names)
        constant = form == "sorted" and name != PUBLISHED_ONLY
        assert is_sorted == (constant or name not in UNSORTED)
        if constant:
            assert len(set(map(len, names))) == 1
            stems = [path.rpartition(".")[0].strip("framedpthl_") for path in names]
            assert [float(stem) for stem in stems] == sorted(map(float, stems))


@pytest.mark.parametrize("name", FORMATS)
def test_both_forms_are_read_back(source, written, name, tmp_path):
    _, out = written
    again = image_frames(out / name)
    units = FORMATS[name].limits.fixed_units or 5000.0
    assert [again.stamps_s[n] for n in again.numbers] == pytest.approx(
        [source.stamps_s[n] for n in FRAMES], abs=1e-6
    )
    for number, there in zip(FRAMES, again.numbers, strict=True):
        assert np.abs(load(number)[1] - again.load(there)[1]).max() <= 0.5 / units + 1e-6
    write_sequence(original_frames(out / name), tmp_path / "tum", workers=1)
    pairs = StoredSequence(tmp_path / "tum").pairs
    assert [pair.written[0] for pair in pairs][-2:] == ["10.000000", "10.033333"]


@pytest.mark.parametrize("name", ["eth3d", "rtabmap"])
def test_the_stamps_of_lists_are_the_names_of_the_images(written, name):
    lines = (written[1] / name / "rgb.txt").read_text().splitlines()
    for line in lines:
        if not line.startswith("#"):
            stamp, _, path = line.partition(" ")
            assert path.rpartition("/")[2] == f"{stamp}.png"


def test_orb_slam3_and_evo_read_euroc(source, written):
    """ORB-SLAM3's LoadImages (stereo_euroc.cc): a name is the line of the times file, a stamp its
    number.
    """
    from evo.tools import file_interface

    mav = written[1] / "euroc/mav0"
    lines = (written[1] / "euroc/times.txt").read_text().split()
    assert all(line.isdecimal() for line in lines)
    assert all((mav / "cam0/data" / f"{line}.png").is_file() for line in lines)
    there = file_interface.read_euroc_csv_trajectory(mav / "state_groundtruth_estimate0/data.csv")
    stamps_s = [float(line) / 1e9 for line in lines]
    assert stamps_s == pytest.approx([source.stamps_s[n] for n in FRAMES], abs=1e-9)
    assert np.isin(np.round(stamps_s, 6), np.round(there.timestamps, 6)).all()


def test_a_folder_without_a_form_goes_on_with_its_own_names_and_units(source, tmp_path):
    """The names that commit b3970f4 wrote, whose recipes have no form."""
    begun = replace(source, numbers=FRAMES[:4])
    formats = ("icl-nuim", "scannet", "eth3d", "euroc", "rtabmap", "nerf")
    write_sequence(begun, tmp_path, SequenceSettings(names=""), formats, workers=1)
    assert "names" not in json.loads((tmp_path / "recipe.json").read_text())
    made = write_sequence(source, tmp_path, SequenceSettings(), formats, workers=1)
    assert (made.made, made.found) == (5, 4)
    for image in (
        "icl-nuim/rgb/270.png",
        "scannet/frames/color/270.jpg",
        "scannet/frames/pose/270.txt",
        "eth3d/depth/10.000000.png",
        "rtabmap/rgb_sync/10.000000.png",
        "euroc/mav0/depth0/data/10000000000.png",
    ):
        assert (tmp_path / image).is_file()
    for name in formats:
        assert [p.number for p in StoredSequence(tmp_path / name).pairs][:1] != []
        assert len(StoredSequence(tmp_path / name).pairs) == len(FRAMES)
    for name in ("euroc", "nerf"):
        assert image_frames(tmp_path / name).depth_units_per_metre == 5000
    assert not list(tmp_path.rglob("0000000*.png"))


def test_another_form_of_names_in_a_folder_is_refused(source, tmp_path):
    begun = replace(source, numbers=FRAMES[:1])
    write_sequence(begun, tmp_path, SequenceSettings(names="published"), workers=1)
    with pytest.raises(InputError, match="names published there, sorted requested"):
        write_sequence(begun, tmp_path, workers=1)
    with pytest.raises(InputError, match="names sorted or published, found by size"):
        SequenceSettings(names="by size")


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("9.966667", "0000000009.966667"),
        ("1305031102.1753", "1305031102.1753"),
        ("5", "0000000005.000000"),
        ("1.3e9", "1300000000.000000"),
        ("", "0000000010.000000"),
    ],
)
def test_stamps_in_names_have_ten_digits_before_the_point(text, name):
    stamp_s = float(text or 10)
    written = {RGB: text} if text else {}
    assert SequenceFrame(3, stamp_s, written=written).stamp_name() == name
