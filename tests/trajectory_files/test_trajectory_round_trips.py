"""Every trajectory format that can be written: what is read back is what was written."""

from dataclasses import replace

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.trajectory_files.number_rows import NumberRows
from iclnuim.trajectory_files.number_table import PoseColumns
from iclnuim.trajectory_files.stamps import Stamps, stamp_text
from iclnuim.trajectory_files.trajectories import (
    FORMATS,
    FileOptions,
    format_for_name,
    read_trajectory,
    write_trajectory,
)

#: A name under which each format that can be written is recognised; a new format joins these tests
#: by its entry in FORMATS.
NAMES = {
    name: f"path{known.writer.endings[-1]}"
    if known.writer.endings
    else f"path_{known.writer.word}.txt"
    for name, known in FORMATS.items()
    if known.writer
}
KEEPS_THE_WORLD = [name for name in NAMES if name not in ("gt.freiburg", "gt.sim")]
TOLERANCE = 1e-9


def random_trajectory(seed: int, frames: int = 40) -> Trajectory:
    """Poses all over the group, half turns and no turns among them, within some metres."""
    rng = np.random.default_rng([5, seed])
    vectors = rng.normal(size=(frames, 3))
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    angles = np.choose(
        rng.integers(0, 4, frames),
        [np.zeros(frames), 1e-6, rng.uniform(0, np.pi, frames), np.pi - 1e-7],
    )
    return Trajectory.at_rate(
        SE3.exp(
            np.concatenate([rng.normal(size=(frames, 3)) * 5, vectors * angles[:, None]], axis=1)
        )
    )


def assert_same(a: SE3, b: SE3) -> None:
    np.testing.assert_allclose(a.translation, b.translation, rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(a.rotation, b.rotation, rtol=0, atol=TOLERANCE)


def test_the_formats_that_can_be_written():
    assert {"tum", "kitti", "pov-matrix", "gt.freiburg", "gt.sim", "pov-commands", "euroc"} <= set(
        NAMES
    )


def wrong_entries():
    """(name, entry) of formats with one part that does not fit the others."""
    for name, entry in FORMATS.items():
        if entry.writer:
            line = entry.writer.line
            for other in (f"%f {line}", line.replace("%", "%%", 1), f"{line}%"):
                yield name, entry._replace(writer=replace(entry.writer, line=other))
        rows = entry.reader.rows
        if isinstance(rows, NumberRows):
            for by in (-1, 1):
                columns = entry.reader.columns.shifted(by)
                yield name, entry._replace(reader=replace(entry.reader, columns=columns))
            twice = PoseColumns(entry.reader.columns.position, (1,) * 4)
            yield name, entry._replace(reader=replace(entry.reader, columns=twice))
            other = Stamps.SECONDS if rows.stamps is Stamps.NONE else Stamps.NONE
            for wrong in (
                replace(rows, counts=(min(rows.counts) - 1,)),
                replace(rows, stamps=other),
            ):
                yield name, entry._replace(reader=replace(entry.reader, rows=wrong))


def test_an_entry_whose_parts_do_not_fit_is_refused_in_one_line():
    wrong = list(wrong_entries())
    assert len(wrong) > 40
    for name, entry in wrong:
        with pytest.raises(InputError, match=f"^trajectory format {name}: expected .*") as error:
            entry.check(name)
        assert "\n" not in str(error.value)
    for name, entry in FORMATS.items():
        entry.check(name)


def test_stamps_as_seconds_and_numbers_as_whole_numbers_are_told_apart():
    tum = FORMATS["tum"]
    line = tum.writer.line.replace("%s", "%d")
    with pytest.raises(InputError, match=r"a stamp in seconds \(%s\) and 7 numbers"):
        tum._replace(writer=replace(tum.writer, line=line)).check("tum")


@pytest.mark.parametrize("format", NAMES)
def test_a_written_file_is_recognised_and_its_name_names_its_format(tmp_path, format):
    path = tmp_path / NAMES[format]
    write_trajectory(path, random_trajectory(0), format)
    assert read_trajectory(path).read_as.format == format
    assert format_for_name(path) == format


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("format", KEEPS_THE_WORLD)
def test_what_is_read_back_is_what_was_written(tmp_path, format, seed):
    written, path = random_trajectory(seed), tmp_path / NAMES[format]
    write_trajectory(path, written, format)
    back = read_trajectory(path).trajectory
    assert_same(back.T_world_camera, written.T_world_camera)
    np.testing.assert_allclose(back.stamps_s, written.stamps_s, rtol=0, atol=TOLERANCE)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize(("format", "anchor"), [("gt.freiburg", 1), ("gt.sim", 0)])
def test_anchored_formats_put_their_anchor_at_the_originals_start(tmp_path, format, anchor, seed):
    written, path = random_trajectory(seed), tmp_path / NAMES[format]
    write_trajectory(path, written, format)
    back = read_trajectory(path).trajectory
    start = SE3(np.eye(3), np.array([0, 0, -2.25]))
    # image 0 has no pose in these files
    expected = start @ written.T_world_camera[anchor].inverse() @ written.T_world_camera[1:]
    assert_same(back.T_world_camera, expected)
    np.testing.assert_array_equal(back.stamps_s, written.stamps_s[1:])


@pytest.mark.parametrize("format", ["gt.freiburg", "gt.sim"])
def test_writing_an_anchored_trajectory_again_leaves_it_where_it_is(tmp_path, format):
    first, second = tmp_path / NAMES[format], tmp_path / f"again_{NAMES[format]}"
    near_start = SE3.exp(np.random.default_rng(0).normal(size=(40, 6)) * 1e-3)
    write_trajectory(first, Trajectory.at_rate(near_start), format)
    write_trajectory(second, read_trajectory(first).trajectory, format)
    assert_same(
        read_trajectory(second).trajectory.T_world_camera,
        read_trajectory(first).trajectory.T_world_camera,
    )


@pytest.mark.parametrize("start_z_m", [-2.25, -2.5])
def test_the_anchored_start_can_be_the_offices(tmp_path, start_z_m):
    path = tmp_path / "office.gt.freiburg"
    write_trajectory(path, random_trajectory(3), "gt.freiburg", FileOptions(start_z_m=start_z_m))
    np.testing.assert_allclose(np.loadtxt(path)[0], [1, 0, 0, start_z_m, 0, 0, 0, 1], atol=1e-12)


def test_a_trajectory_without_image_one_is_anchored_at_its_first_pose(tmp_path):
    path, written = tmp_path / "part.gt.freiburg", random_trajectory(4)[10:]
    write_trajectory(path, written, "gt.freiburg")
    rows = np.loadtxt(path)
    np.testing.assert_allclose(rows[0], [10, 0, 0, -2.25, 0, 0, 0, 1], atol=1e-12)
    assert len(rows) == len(written)


@pytest.mark.parametrize("format", ["gt.freiburg", "pov-matrix", "pov-commands"])
def test_frame_numbers_survive_gaps(tmp_path, format):
    written, path = random_trajectory(5)[np.array([3, 4, 9, 31])], tmp_path / NAMES[format]
    write_trajectory(path, written, format)
    np.testing.assert_array_equal(read_trajectory(path).trajectory.stamps_s, written.stamps_s)


@pytest.mark.parametrize(
    ("stamp_s", "text"),
    [
        (1.0, "1.000000"),
        (1.033333, "1.033333"),
        (1305031102.175304, "1305031102.175304"),
        (1 / 30, "0.033333333"),
        (0.0000001, "0.0000001"),
        (1.0000000000001, "1.000000"),
    ],
)
def test_stamps_have_six_digits_and_more_only_where_they_need_them(stamp_s, text):
    assert stamp_text(stamp_s) == text


@pytest.mark.parametrize("format", ["tum", "euroc"])
def test_stamps_of_real_recordings_survive(tmp_path, format):
    written, path = random_trajectory(6), tmp_path / NAMES[format]
    written = Trajectory(
        1305031102.175304 + np.cumsum(np.random.default_rng(0).uniform(1e-3, 0.1, 40)),
        written.T_world_camera,
    )
    write_trajectory(path, written, format)
    np.testing.assert_allclose(
        read_trajectory(path).trajectory.stamps_s, written.stamps_s, rtol=0, atol=5e-7
    )


@pytest.mark.parametrize("format", KEEPS_THE_WORLD)
def test_a_unit_of_length_goes_out_and_in(tmp_path, format):
    written, path = random_trajectory(7), tmp_path / NAMES[format]
    write_trajectory(path, written, format, FileOptions(unit_m=0.01))
    assert_same(
        read_trajectory(path, unit_m=0.01).trajectory.T_world_camera, written.T_world_camera
    )
    names_the_unit = format in ("euroc", "vslam-lab")
    unlabelled = read_trajectory(path).trajectory.positions_m
    factor = 1 if names_the_unit else 100
    np.testing.assert_allclose(unlabelled, factor * written.positions_m, atol=1e-7)


@pytest.mark.parametrize("format", ["gt.freiburg", "gt.sim", "pov-matrix", "pov-commands", "kitti"])
def test_a_frame_rate_goes_out_and_in(tmp_path, format):
    path = tmp_path / NAMES[format]
    written = Trajectory.at_rate(random_trajectory(8).T_world_camera, 120)
    write_trajectory(path, written, format, FileOptions(rate_hz=120))
    back = read_trajectory(path, rate_hz=120).trajectory
    np.testing.assert_allclose(
        back.stamps_s, written.stamps_s[len(written) - len(back) :], atol=1e-12
    )


def test_the_same_trajectory_gives_the_same_bytes(tmp_path):
    for format, name in NAMES.items():
        write_trajectory(tmp_path / name, random_trajectory(9), format)
        once = (tmp_path / name).read_bytes()
        write_trajectory(tmp_path / name, random_trajectory(9), format)
        assert (tmp_path / name).read_bytes() == once


@pytest.mark.parametrize("format", ["gt.freiburg", "pov-matrix", "pov-commands", "gt.sim"])
@pytest.mark.parametrize("shift_s", [0.01, -1.0, 1e12])
def test_stamps_between_frames_cannot_become_frame_numbers(tmp_path, format, shift_s):
    path, written = tmp_path / NAMES[format], random_trajectory(10)
    moved = Trajectory(
        np.arange(40) * (1 if shift_s > 1e9 else 1 / 30) + shift_s, written.T_world_camera
    )
    with pytest.raises(InputError, match="stamps"):
        write_trajectory(path, moved, format)
    assert not list(tmp_path.iterdir())


def test_blocks_without_numbers_cannot_have_gaps(tmp_path):
    with pytest.raises(InputError, match="without a gap"):
        write_trajectory(
            tmp_path / "x.gt.sim", random_trajectory(11)[np.array([0, 1, 2, 4])], "gt.sim"
        )


def test_image_zero_alone_cannot_be_anchored(tmp_path):
    with pytest.raises(InputError, match="image 0 alone"):
        write_trajectory(tmp_path / "x.gt.freiburg", random_trajectory(12)[:1], "gt.freiburg")


@pytest.mark.parametrize(
    ("poses", "message"),
    [
        (
            SE3(np.full((2, 3, 3), np.nan), np.zeros((2, 3))),
            "finite positions and rotation matrices",
        ),
        (
            SE3(np.broadcast_to(np.eye(3), (2, 3, 3)), np.full((2, 3), np.inf)),
            "finite positions and rotation matrices",
        ),
        (SE3(np.broadcast_to(np.eye(3), (2, 3, 3)), np.full((2, 3), 1e9)), "positions of at most"),
        (SE3.identity((0,)), "at least one pose"),
    ],
)
@pytest.mark.parametrize("format", NAMES)
def test_poses_that_no_reader_would_take_are_not_written(tmp_path, format, poses, message):
    with pytest.raises(InputError, match=message):
        write_trajectory(tmp_path / NAMES[format], Trajectory.at_rate(poses), format)
    assert not list(tmp_path.iterdir())


def test_formats_that_are_only_read_say_so(tmp_path):
    with pytest.raises(InputError, match="that can be written"):
        write_trajectory(tmp_path / "x", random_trajectory(0), "pov-cameras")


@pytest.mark.parametrize("name", ["x", "x.dat", "x.gt.freiburg.gz", ""])
def test_a_name_that_says_nothing_is_refused(name):
    with pytest.raises(InputError, match="try to FORMAT"):
        format_for_name(name)
