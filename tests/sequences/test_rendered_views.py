"""Rendered views against the frames of a sequence: found by name in every format, figures by group,
refused in one line.
"""

import json
import shutil
import sys
import types

import numpy as np
import pytest
from iclnuim import ViewSettings, frames_from, view_errors
from iclnuim.errors import InputError
from iclnuim.formats.images import read_colour8, write_array, write_jpeg
from iclnuim.formats.png import read_depth16, write_png
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.sequences.rendered_views import read_keyframes
from iclnuim.sequences.sequence_formats import FORMATS
from iclnuim.sequences.stored_sequence import StoredSequence
from iclnuim.sequences.writer import write_sequence


@pytest.fixture
def views(all_formats, tmp_path):
    """What a system rendered of the sequence tum: one grey level too bright, 0.1 m too far, holes
    in a quarter of the depth; in camera.json's units.
    """
    truth, out = all_formats / "tum", tmp_path / "views"
    for pair in StoredSequence(truth).pairs:
        for kind in ("rgb", "depth"):
            (out / kind).mkdir(parents=True, exist_ok=True)
        write_png(out / "rgb" / pair.rgb.name, read_colour8(pair.rgb).clip(0, 254) + np.uint8(1))
        depth = read_depth16(pair.depth) + 500
        depth[:12] = 0
        write_png(out / "depth" / pair.depth.name, depth)
    return truth, out


def test_figures_are_those_of_the_images(views):
    truth, out = views
    found = view_errors(out, truth, settings=ViewSettings(lpips=False))
    assert [view.name for view in found.views] == [
        "000000",
        "000001",
        "000002",
        "000003",
    ] and not found.missing
    depth_m = read_depth16(truth / "depth/000002.png") / 5000
    expected_m = (depth_m[:12].sum() + 0.1 * depth_m[12:].size) / depth_m.size
    assert found.views[2].depth_l1_m == pytest.approx(expected_m, abs=1e-6)
    assert found.views[2].depth_missing == 0.25
    assert found.mean()["psnr_db"] == pytest.approx(20 * np.log10(255), abs=0.1)
    assert 0.99 < found.mean()["ssim"] < 1


@pytest.mark.parametrize("name", FORMATS)
def test_a_sequence_is_its_own_best_view_in_every_format(all_formats, name):
    found = view_errors(all_formats / name, all_formats / name, settings=ViewSettings(lpips=False))
    assert len(found.views) == 4 and found.mean()["psnr_db"] == np.inf
    assert found.mean()["depth_l1_m"] == found.mean()["depth_missing"] == 0


def test_views_lie_flat_as_jpeg_or_in_metres_and_some_may_be_missing(views, tmp_path):
    truth, out = views
    flat = tmp_path / "flat"
    (flat / "depth").mkdir(parents=True)
    write_jpeg(flat / "000001.jpg", read_colour8(truth / "rgb/000001.png"))
    write_array(flat / "depth/000001.npy", read_depth16(truth / "depth/000001.png") / 5000)
    found = view_errors(flat, truth, settings=ViewSettings("uniform", lpips=False))
    assert found.missing == ("000000", "000002", "000003")
    assert found.views[0].psnr_db > 40 and found.views[0].depth_l1_m < 1e-6
    shutil.rmtree(out / "depth")
    assert "depth_l1_m" not in view_errors(out, truth, settings=ViewSettings(lpips=False)).mean()


def test_keyframes_are_reported_apart(views, tmp_path, command_here):
    truth, out = views
    pairs = StoredSequence(truth).pairs
    listed = tmp_path / "keyframes.txt"
    for text in (
        "000000\n000003\n",
        "rgb/000000.png x\n3\n",
        "# stamps\n1.0 0 0 0 0 0 0 1\n1.1000001 1 0 0 0 0 0 1\n",
    ):
        listed.write_text(text)
        assert read_keyframes(listed, pairs) == {0, 3}
    options = (
        "--truth",
        truth,
        "--keyframes",
        listed,
        "--csv",
        tmp_path / "views.csv",
        "--no-lpips",
    )
    code, out_text, _ = command_here("evaluate", "views", out, *options, "--json")
    values = json.loads(out_text)
    assert code == 0 and [values[group]["views"] for group in ("all", "keyframes", "others")] == [
        4,
        2,
        2,
    ]
    assert values["all"]["psnr_db"] == pytest.approx(
        (values["keyframes"]["psnr_db"] + values["others"]["psnr_db"]) / 2
    )
    rows = (tmp_path / "views.csv").read_text().splitlines()
    assert len(rows) == 5 and rows[1].startswith("000000,1,")
    code, out_text, _ = command_here("evaluate", "views", out, *options)
    assert code == 0 and [line.split()[0] for line in out_text.splitlines()[1:]] == [
        "all",
        "keyframes",
        "others",
    ]
    code, out_text, _ = command_here(
        "evaluate", "views", truth, "--truth", truth, "--no-lpips", "--json"
    )
    assert code == 0 and json.loads(out_text)["all"]["psnr_db"] is None


def test_what_does_not_fit_is_refused_in_one_line(views, tmp_path):
    truth, out = views
    (tmp_path / "empty").mkdir()
    listed = tmp_path / "keyframes.txt"
    listed.write_text("000000\n77\n")
    with pytest.raises(
        InputError, match="views named as the images of .*, such as 000000.png, found none of them"
    ):
        view_errors(tmp_path / "empty", truth)
    with pytest.raises(
        InputError, match="keyframes.txt:2: expected the name, number or stamp of a frame, found 77"
    ):
        view_errors(out, truth, listed)
    write_png(out / "rgb/000001.png", np.zeros((20, 20, 3), np.uint8))
    with pytest.raises(
        InputError, match="rgb/000001.png: expected 64 x 48, as the true image, found 20 x 20"
    ):
        view_errors(out, truth)


def test_lpips_is_given_images_between_minus_one_and_one(views, monkeypatch):
    torch = pytest.importorskip("torch", reason="LPIPS needs PyTorch")
    truth, out = views
    given = []

    class Network:
        def __init__(self, net, verbose):
            assert net == "alex"

        def eval(self):
            return self

        def __call__(self, image, true):
            given.append((image, true))
            return torch.tensor(0.25)

    package = types.ModuleType("lpips")
    package.LPIPS, package.__spec__ = Network, types.SimpleNamespace(name="lpips")
    monkeypatch.setitem(sys.modules, "lpips", package)
    assert view_errors(out, truth).mean()["lpips"] == 0.25
    assert given[0][1].shape == (1, 3, 48, 64) and -1 <= given[0][1].min() < given[0][1].max() <= 1


def test_training_and_judging_need_the_files_alone(tmp_path, command_here):
    """A training program for transforms.json, here one that shows for each test view the nearest
    training image, is judged by the names that the file has for the test.
    """
    level = np.linspace(0, 1, 12 * 16).reshape(12, 16, 1) * np.ones(3)

    def load(number):
        return (level * number / 20).astype(np.float32), np.full((12, 16), 2, np.float32)

    positions = np.stack([np.arange(17) / 10, np.zeros(17), np.zeros(17)], 1)
    poses = SE3(np.tile(np.eye(3), (17, 1, 1)), positions)
    camera = PinholeCamera(16, 12, 9.0, 9.0, 7.5, 5.5)
    source = frames_from(camera, Trajectory.at_rate(poses), load)
    write_sequence(source, tmp_path / "nerf", formats=("nerf",), workers=1)
    content = json.loads((tmp_path / "nerf/transforms.json").read_text())
    place = {}
    for frame in content["frames"]:
        place[frame["file_path"]] = np.array(frame["transform_matrix"])[:3, 3]
    (tmp_path / "rendered/images").mkdir(parents=True)
    for name in content["test_filenames"]:

        def distance_m(other, name=name):
            return np.linalg.norm(place[other] - place[name])

        nearest = min(content["train_filenames"], key=distance_m)
        shutil.copy(tmp_path / "nerf" / nearest, tmp_path / "rendered" / name)
    judged = ("evaluate", "views", tmp_path / "rendered", "--truth", tmp_path / "nerf")
    code, said, notes = command_here(*judged, "--no-lpips", "--json")
    assert code == 0, notes
    found = json.loads(said)
    assert found["views"] == len(content["test_filenames"]) == 3
    assert len(found["missing"]) == len(content["train_filenames"]) == 14
    assert 20 < found["all"]["psnr_db"] < 40


PLAIN = ViewSettings(lpips=False)


@pytest.mark.parametrize(
    ("factor", "words"),
    [(1e3, "in millimetres (mm)"), (0.2, "five times the depth units"), (1, "")],
)
def test_depth_in_another_unit_is_named(views, factor, words):
    truth, out = views
    shutil.rmtree(out / "depth")
    (out / "depth").mkdir()
    for path in sorted((truth / "depth").glob("*.png")):
        write_array(out / "depth" / f"{path.stem}.npy", factor * read_depth16(path) / 5000)
    found = view_errors(out, truth, settings=PLAIN).warnings
    assert words in found[0] if words else found == ()


def test_depth_along_the_ray_and_swapped_channels_are_named(views):
    truth, out = views
    rays = np.linalg.norm(StoredSequence(truth).camera.pinhole.rays(), axis=-1)
    shutil.rmtree(out / "depth")
    (out / "depth").mkdir()
    for path in sorted((truth / "depth").glob("*.png")):
        write_array(out / "depth" / f"{path.stem}.npy", rays * read_depth16(path) / 5000)
    for path in (out / "rgb").iterdir():
        write_png(path, np.ascontiguousarray(read_colour8(path)[..., ::-1]))
    colour, depth = view_errors(out, truth, settings=PLAIN).warnings
    assert "red and blue swapped" in colour and "along the ray" in depth
