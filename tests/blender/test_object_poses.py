"""The poses of what moves, beside the table of objects."""

import csv
import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")
sys.path.insert(0, str(Path(__file__).parent))
import own_scene_files as made  # noqa: E402
from iclnuim.blender.render import ground_truth, worker  # noqa: E402
from iclnuim.geometry.camera import PinholeCamera  # noqa: E402
from iclnuim.geometry.se3 import SE3  # noqa: E402
from iclnuim.geometry.trajectory import Trajectory  # noqa: E402
from iclnuim.job import RenderJob  # noqa: E402
from iclnuim.sequences.run_folder import FurtherImages  # noqa: E402
from iclnuim.trajectory_files.trajectories import write_trajectory  # noqa: E402

FRAMES = 5


@pytest.fixture
def crate():
    """A crate of twice the size over a floor, which is not moved yet."""
    scene = made.fresh(bpy)
    scene.frame_set(0)
    corners = [(-3, -3, 0), (3, -3, 0), (3, 3, 0), (-3, 3, 0)]
    made.add(bpy, "floor", corners, [(0, 1, 2, 3)], made.material(bpy, "floor"))
    made.lamp(bpy, location=(0, 0, 4))
    crate = made.box(bpy, "crate", (-0.4, -0.4, 1), (0.4, 0.4, 1.8), made.material(bpy, "red"))
    crate.scale = (2, 2, 2)
    return crate


def run_of(folder, **settings):
    file = folder / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(file))
    pose = np.diag([1.0, -1, -1, 1])
    pose[2, 3] = 6
    whole = Trajectory.at_rate(SE3.from_matrix(np.repeat(pose[None], FRAMES, 0)))
    write_trajectory(folder / "poses.txt", whole, "tum")
    camera = PinholeCamera(48, 36, 36, 36, 23.5, 17.5)
    job = RenderJob("own", str(file), str(folder / "poses.txt"), camera=camera, **settings)
    job = job.changed(light="path", samples=1)
    with worker.Session(job, folder / "run", lambda event: None, threads=1) as session:
        session.render([1], lambda: False)
    return folder / "run", job, whole


def test_what_moves_has_its_pose_at_every_stamp(crate, tmp_path):
    for frame in range(FRAMES):
        crate.location.x = frame / 10
        crate.rotation_euler.z = frame / 4
        crate.keyframe_insert("location", frame=frame)
        crate.keyframe_insert("rotation_euler", frame=frame)
    run, job, whole = run_of(tmp_path, ground_truth=True)
    with open(run / "object_poses.csv", newline="") as text:
        rows = list(csv.DictReader(text))
    objects = json.loads((run / "objects.json").read_text())["objects"]
    number = next(row["id"] for row in objects if row["name"] == "crate")
    assert [int(row["id"]) for row in rows] == [number] * FRAMES
    for frame, row in enumerate(rows):
        found = [float(row[name]) for name in ("stamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw")]
        turn = (math.sin(frame / 8), math.cos(frame / 8))
        expected = [whole.stamps_s[frame], frame / 10, 0, 0, 0, 0, *turn]
        assert found == pytest.approx(expected, abs=2e-6)
    (tmp_path / "sequence").mkdir()
    FurtherImages(run, job.further).write_tables(tmp_path / "sequence")
    copied = (tmp_path / "sequence/object_poses.csv").read_bytes()
    assert copied == (run / "object_poses.csv").read_bytes()


def test_the_table_of_objects_is_that_of_frame_0_whichever_the_file_shows(crate, tmp_path):
    for frame in range(FRAMES):
        crate.location.x = frame / 10
        crate.keyframe_insert("location", frame=frame)
    bpy.context.scene.frame_set(3)
    run, *_ = run_of(tmp_path, ground_truth=True)
    objects = json.loads((run / "objects.json").read_text())["objects"]
    matrix = next(row["T_world_object"] for row in objects if row["name"] == "crate")
    assert [row[3] for row in matrix] == [0, 0, 0, 1]


@pytest.mark.parametrize("is_driven", [False, True])
def test_what_appears_later_has_a_row_and_poses_from_then_on(is_driven, crate, tmp_path):
    crate.hide_render = True
    if is_driven:
        crate.driver_add("hide_render").driver.expression = "frame < 3"
    else:
        for frame, hidden in ((2, True), (3, False)):
            crate.hide_render = hidden
            crate.keyframe_insert("hide_render", frame=frame)
    run, *_ = run_of(tmp_path, ground_truth=True)
    objects = json.loads((run / "objects.json").read_text())["objects"]
    number = next(row["id"] for row in objects if row["name"] == "crate")
    with open(run / "object_poses.csv", newline="") as text:
        rows = list(csv.DictReader(text))
    assert [float(row["stamp"]) for row in rows] == pytest.approx(
        [1 + 3 / 30, 1 + 4 / 30], abs=1e-6
    )
    assert {int(row["id"]) for row in rows} == {number}


def test_what_disappears_has_a_row_and_poses_until_then(crate, tmp_path):
    crate.driver_add("hide_render").driver.expression = "frame > 1"
    run, *_ = run_of(tmp_path, ground_truth=True)
    objects = json.loads((run / "objects.json").read_text())["objects"]
    assert "crate" in [row["name"] for row in objects]
    assert len((run / "object_poses.csv").read_text().splitlines()) == 3


@pytest.mark.parametrize("moves, truth", [(False, True), (True, False)])
def test_without_motion_or_ground_truth_there_is_none(crate, tmp_path, moves, truth):
    for frame in (0, FRAMES):
        crate.location.x = frame * moves
        crate.keyframe_insert("location", frame=frame)
    run, _, _ = run_of(tmp_path, ground_truth=truth)
    assert not (run / "object_poses.csv").exists()


@pytest.mark.parametrize(
    ("stamp_s", "covered"), [(2.0, True), (2.0000009, True), (2.0000015, False)]
)
def test_a_table_reaches_the_stamp_that_was_rounded_to_its_last(tmp_path, stamp_s, covered):
    file = tmp_path / "poses.csv"
    file.write_text(
        "stamp,id,tx,ty,tz,qx,qy,qz,qw\n1.000000,1,0,0,0,0,0,0,1\n2.000000,1,0,0,0,0,0,0,1\n"
    )
    assert ground_truth._covers(file, stamp_s) is covered
