"""Sequences as others leave them: lost images and lines, other first numbers, names without zeros
in front, stamps in other units. Every image gets its own pose, or the sequence is refused.
"""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from iclnuim import frames_from
from iclnuim.errors import InputError
from iclnuim.evaluation.associate import nearest
from iclnuim.formats.images import read_colour8
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.sequences.inspection import inspect_sequence
from iclnuim.sequences.stored_sequence import StoredSequence
from iclnuim.sequences.writer import write_sequence

FRAMES = 12
CAMERA = PinholeCamera(80, 60, 60.0, 60.0, 39.5, 29.5)
#: Pose i is at x = z = i**2 / 40: the camera moves on a line, faster and faster.
X_M = np.arange(FRAMES) ** 2 / 40
#: Where the images of a format are.
FOLDERS = {
    "replica": ("results/frame{:06}.jpg", "results/depth{:06}.png", "traj.txt"),
    "tartanair": (
        "image_left/{:06}_left.png",
        "depth_left/{:06}_left_depth.npy",
        "pose_left.txt",
    ),
}


def _depth_m(x_m: float) -> np.ndarray:
    """Planar depth of a wall at z = 6 m above a floor, seen from (x_m, 0, x_m)."""
    down = (np.arange(CAMERA.height) - CAMERA.cy) / CAMERA.fy
    row = np.minimum(6 - x_m, 1.2 / np.maximum(down, 1e-6))
    return np.repeat(row[:, None], CAMERA.width, axis=1).astype(np.float32)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Twelve frames in some formats; the grey value of an image tells its number."""
    out = tmp_path_factory.mktemp("written") / "out"
    poses = SE3(np.broadcast_to(np.eye(3), (FRAMES, 3, 3)), np.outer(X_M, [1, 0, 1]))

    def load(number):
        return np.full((60, 80, 3), (number + 1) / 16, np.float32), _depth_m(X_M[number])

    source = frames_from(CAMERA, Trajectory.at_rate(poses), load)
    write_sequence(source, out, formats=(*FOLDERS, "scannet", "tum"), workers=1)
    return out


@pytest.fixture
def copied(written, tmp_path):
    def copy(format: str) -> Path:
        return Path(shutil.copytree(written / format, tmp_path / format))

    return copy


def number_of(image: Path) -> int:
    """The number of the frame that an image shows, from its grey value."""
    level = np.round(read_colour8(image).mean() / 255, 3)
    linear = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4)
    return round(float(linear) * 16) - 1


def numbers_with_poses(folder: Path, loaded=None) -> list[int]:
    """The numbers of the frames that have a pair and a pose, each of which must be its own."""
    loaded = loaded or StoredSequence(folder).loaded_truth
    found = []
    for pair in StoredSequence(folder).pairs:
        row, off_s = (
            part[0] for part in nearest(np.array([pair.stamp_s]), loaded.trajectory.stamps_s)
        )
        if off_s < 1e-3:
            number = number_of(pair.rgb)
            assert loaded.trajectory.positions_m[row] == pytest.approx(
                [X_M[number], 0, X_M[number]], abs=1e-6
            )
            found.append(number)
    return found


def change_lines(folder: Path, format: str, change) -> None:
    file = folder / FOLDERS[format][2]
    lines = file.read_text().splitlines()
    file.write_text("\n".join(change(lines)) + "\n")


def rename(folder: Path, format: str, name_of) -> None:
    """Rename the images: name_of(number) -> text in place of six digits, None to lose the frame."""
    moved = []
    for template in FOLDERS[format][:2]:
        for number in range(FRAMES):
            old = folder / template.format(number)
            name = name_of(number)
            if name is None:
                old.unlink()
            else:
                new = folder / template.replace("{:06}", name)
                moved.append((old.rename(old.with_name(f"moved-{old.name}")), new))
    for old, new in moved:
        old.rename(new)


both = pytest.mark.parametrize("format", FOLDERS)
EVERY = list(range(FRAMES))


def without(*lost: int) -> list[int]:
    return [number for number in EVERY if number not in lost]


@both
@pytest.mark.parametrize("first", [0, 1, 5, 995])
@pytest.mark.parametrize("digits", [1, 4])
def test_whatever_the_first_number_and_the_digits_equal_counts_are_in_order(
    copied, format, first, digits
):
    folder = copied(format)
    rename(folder, format, lambda number: f"{first + number:0{digits}}")
    assert numbers_with_poses(folder) == EVERY


@both
@pytest.mark.parametrize("step", [5, 10])
def test_every_fifth_image_with_as_many_lines(copied, format, step):
    folder = copied(format)
    rename(folder, format, lambda number: str(number * step))
    assert numbers_with_poses(folder) == EVERY


@both
@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("lost", [(4,), (4, 5), (3, 8), (1,)])
def test_images_lost_in_the_middle_shift_no_pose(copied, format, first, lost):
    folder = copied(format)
    rename(folder, format, lambda n: None if n in lost else f"{n + first:06}")
    assert numbers_with_poses(folder) == without(*lost)
    assert f"{len(lost)} poses without a frame" in inspect_sequence(folder).warnings


@both
@pytest.mark.parametrize(("first", "lost"), [(0, 0), (1, 11), (3, 0), (3, 11)])
def test_depth_decides_whether_the_first_or_the_last_image_is_lost(copied, format, first, lost):
    folder = copied(format)
    rename(folder, format, lambda n: None if n == lost else f"{n + first:06}")
    assert numbers_with_poses(folder) == without(lost)
    figures = r"\d % with \d.*\d % with \d"
    assert re.search(figures, StoredSequence(folder).loaded_truth.read_as.sentence)
    assert re.search(figures, "\n".join(inspect_sequence(folder).warnings))


def test_a_conversion_says_how_lines_were_tied_and_which_were_lost(copied, tmp_path, command_here):
    folder = copied("replica")
    rename(folder, "replica", lambda n: None if n == 0 else f"{n:06}")
    code, _, noted = command_here("convert", folder, tmp_path / "tied")
    assert code == 0 and re.search(r"\d % with 0.*\d % with 1", noted)
    change_lines(folder, "replica", lambda lines: [*lines[:5], "nan " * 16, *lines[6:]])
    code, _, noted = command_here("convert", folder, tmp_path / "lost")
    assert code == 0 and "1 of 12 rows have no finite pose" in noted
    assert numbers_with_poses(tmp_path / "lost") == without(0, 5)


@both
def test_where_depth_cannot_decide_both_readings_are_refused(copied, format):
    folder = copied(format)
    rename(folder, format, lambda n: None if n == 0 else f"{n:06}")
    change_lines(folder, format, lambda lines: lines[:1] * len(lines))
    with pytest.raises(InputError, match=r"0 or 1.*12 lines for 11 images, 1 to 11"):
        assert StoredSequence(folder).loaded_truth


@both
@pytest.mark.parametrize("kept", [slice(0, 11), slice(1, 12), slice(0, 12, 2)])
def test_more_images_than_lines_are_refused_with_both_counts(copied, format, kept):
    folder = copied(format)
    change_lines(folder, format, lambda lines: lines[kept])
    with pytest.raises(InputError, match=rf"12 images, found {len(EVERY[kept])} lines"):
        assert StoredSequence(folder).loaded_truth
    assert any("12 images" in sentence for sentence in inspect_sequence(folder).errors)


@both
@pytest.mark.parametrize("row", ["nan", "-inf", ""])
@pytest.mark.parametrize("lost", [(0,), (5, 6), (11,)])
def test_a_lost_line_leaves_its_image_without_a_pose(copied, format, row, lost):
    folder = copied(format)

    def lose(lines):
        for number in lost:
            lines[number] = " ".join([row] * len(lines[number].split())).strip()
        return lines

    change_lines(folder, format, lose)
    if row == "" and lost in ((0,), (11,)):  # no row begins or ends a file with an empty line
        with pytest.raises(InputError, match="12 images, found 11 lines"):
            assert StoredSequence(folder).loaded_truth
        return
    assert numbers_with_poses(folder) == without(*lost)
    odd = "\n".join(inspect_sequence(folder).warnings)
    assert f"{len(lost)} frames without a pose" in odd and f"{len(lost)} of 12 rows" in odd


@both
@pytest.mark.parametrize("kind", [0, 1])
@pytest.mark.parametrize("first", [0, 1])
def test_a_missing_depth_or_colour_image_leaves_its_frame_out(copied, format, kind, first):
    folder = copied(format)
    rename(folder, format, lambda n: f"{n + first:06}")
    (folder / FOLDERS[format][kind].format(4 + first)).unlink()
    assert numbers_with_poses(folder) == without(4)
    found = inspect_sequence(folder)
    assert found.errors == [] and found.figures["pairs"] == 11
    assert any(f"{4 + first:06}" in sentence for sentence in found.warnings)


def test_a_missing_depth_image_of_scannet_and_of_lists_leaves_its_frame_out(copied):
    for format, image in (("scannet", "frames/depth/000004.png"), ("tum", "depth/000004.png")):
        folder = copied(format)
        (folder / image).unlink()
        assert numbers_with_poses(folder) == without(4)
        found = inspect_sequence(folder)
        assert found.errors == [] and any("1 images" in sentence for sentence in found.warnings)


@pytest.mark.parametrize("lists", [True, False])
@pytest.mark.parametrize("first", [0, 1])
def test_lines_in_a_folder_of_rgb_and_depth(copied, written, lists, first):
    """slambook2's data: rgb/1.png, depth/1.png ... and a file with a pose in each line."""
    folder = copied("tum")
    for name in ("rgb.txt", "depth.txt", "associations.txt", "groundtruth.txt"):
        (folder / name).unlink()
    for kind in ("rgb", "depth"):
        for number in reversed(EVERY):
            (folder / f"{kind}/{number:06}.png").rename(folder / f"{kind}/{number + first}.png")
        if lists:
            names = (f"{1305031102.1 + n / 30:.6f} {kind}/{n + first}.png" for n in EVERY)
            (folder / f"{kind}.txt").write_text("\n".join(names) + "\n")
    poses = shutil.copy(written / "replica/traj.txt", folder / "pose.txt")
    assert numbers_with_poses(folder, StoredSequence(folder).load_poses(poses)) == EVERY
    (folder / f"rgb/{3 + first}.png").unlink()
    assert numbers_with_poses(folder, StoredSequence(folder).load_poses(poses)) == without(3)


@pytest.mark.parametrize("form", ["redwood", "kitti with numbers", "matrices", "kitti"])
@pytest.mark.parametrize(("first", "lost"), [(0, ()), (1, ()), (1, (4,)), (0, (11,)), (0, (4, 5))])
def test_numbers_that_count_the_lines_from_0(copied, written, form, first, lost):
    """Redwood's .log numbers its poses from 0, its images from 1."""
    folder = copied("replica")
    rename(folder, "replica", lambda n: None if n in lost else f"{n + first:06}")
    blocks = []
    for number, line in enumerate((folder / "traj.txt").read_text().splitlines()):
        values = line.split()
        rows = [" ".join(values[start : start + 4]) for start in (0, 4, 8, 12)]
        if form == "redwood":
            rows.insert(0, f"{number} {number} {number + 1}")
        if form.startswith("kitti"):
            rows = [" ".join([str(number)] * (form != "kitti") + values[:12])]
        blocks += rows
    (folder / "poses.log").write_text("\n".join(blocks) + "\n")
    assert numbers_with_poses(
        folder, StoredSequence(folder).load_poses(folder / "poses.log")
    ) == without(*lost)


@pytest.mark.parametrize("ticks", [1e3, 1e6, 1e9])
@pytest.mark.parametrize("rate_hz", [3.0, 30.0])
def test_stamps_in_names_have_their_unit(copied, ticks, rate_hz):
    folder = copied("tum")
    for name in ("rgb.txt", "depth.txt", "associations.txt"):
        (folder / name).unlink()
    for kind in ("rgb", "depth"):
        for number in EVERY:
            stamp = round(1403636579.763555 * ticks) + round(number / rate_hz * ticks)
            (folder / f"{kind}/{number:06}.png").rename(folder / f"{kind}/{stamp}.png")
    pairs = StoredSequence(folder).pairs
    assert pairs[0].stamp_s == pytest.approx(1403636579.763555, abs=1e-3)
    steps = np.diff([pair.stamp_s for pair in pairs])
    np.testing.assert_allclose(steps, 1 / rate_hz, atol=1.1 / ticks + 1e-6)


@pytest.mark.parametrize("format", [*FOLDERS, "scannet", "tum"])
def test_what_file_managers_leave_in_folders_is_ignored(copied, format):
    folder = copied(format)
    for path in list(folder.rglob("*")):
        if path.is_dir():
            for name in (".DS_Store", "Thumbs.db", "desktop.ini"):
                (path / name).write_bytes(b"x")
        else:
            path.with_name(f"._{path.name}").write_bytes(b"Mac OS X")
    for lists in folder.glob("*.txt"):
        if lists.name in ("rgb.txt", "depth.txt", "associations.txt"):
            lists.unlink()
    assert numbers_with_poses(folder) == EVERY
    found = inspect_sequence(folder)
    assert found.errors == [] and not any("._" in sentence for sentence in found.warnings)
