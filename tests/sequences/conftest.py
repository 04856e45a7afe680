"""A small synthetic run, also one with ground truth."""

import json

import numpy as np
import pytest
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.sequences.frame_source import run_frames
from iclnuim.sequences.run_folder import open_run
from iclnuim.sequences.sequence_formats import FORMATS
from iclnuim.sequences.writer import write_sequence

#: class_id, class, nyu40_id, nyu40 of the objects 1, 2 ... of a run with ground truth
LABELS = ((1, "wall", 1, "wall"), (2, "floor", 2, "floor"), (9, "sofa", 6, "sofa"))
LABELS += ((9, "sofa", 6, "sofa"), (8, "backdrop", 0, "unlabelled"))


CAMERA = PinholeCamera(64, 48, 48.0, 48.0, 31.5, 23.5)
POSES = SE3.exp(np.linspace(0, 0.1, 24).reshape(4, 6))


def sloping_m(number):
    """(48, 64) depth of a plane, 2 to 6 m away: it fits the poses also in whole millimetres, so
    that nothing is searched."""
    inverse = np.array([-0.1, -0.2, 0.33])  # 1 / depth of a ray from where the path begins
    T = POSES[number]
    return (1 - inverse @ T.translation) / (CAMERA.rays() @ T.rotation.T @ inverse)


def make_run(folder, ground_truth=False):
    """Four frames of a sloping floor and a colour ramp, 64 x 48; with ground truth: a wall, a
    floor, two sofas, a backdrop and pixels without a surface.
    """
    truth = {"ground_truth": True} if ground_truth else {}
    recipe = {
        "job": {"camera": CAMERA.to_dict(), "samples": 1} | truth,
        "trajectory_sha256": "a",
        "scene_sha256": "b",
        "blender": "none",
    }
    run = open_run(folder, recipe, Trajectory.at_rate(POSES))
    v, u = np.mgrid[0:48, 0:64]
    for number in range(4):
        run.write_frame(
            number,
            np.stack([u / 64, v / 48, (u + v) / 112], -1),
            sloping_m(number),
            *([_further(number)] if ground_truth else []),
        )
    if ground_truth:
        (folder / "objects.json").write_text(json.dumps(_objects()))
    return run


def _further(number):
    """Instances and normals of a frame."""
    instance = np.ones((48, 64), np.float32)
    instance[30:] = 2
    instance[20:36, 5 + number : 20] = 3
    instance[20:36, 30:50] = 4
    instance[:8, 40:] = 5
    instance[:4, :4] = 0
    normal = {f"normal.{axis}": np.full((48, 64), -(axis == "Z"), np.float32) for axis in "XYZ"}
    return {"instance": instance, **normal}


def _objects():
    keys = ("id", "name", "nyu40_id", "nyu40")
    classes = [dict(zip(keys, row, strict=True)) for row in sorted({*LABELS})]
    objects = [{"id": k, "name": f"{x[1]}_{k}", "class_id": x[0]} for k, x in enumerate(LABELS, 1)]
    return {"objects": objects, "classes": classes}


@pytest.fixture
def run(tmp_path):
    """Four frames, a test's own."""
    return make_run(tmp_path / "raw")


@pytest.fixture(scope="session")
def shared_run(tmp_path_factory):
    """The same for tests that only read it."""
    return make_run(tmp_path_factory.mktemp("run") / "raw")


@pytest.fixture(scope="session")
def labelled_run(tmp_path_factory):
    """The folder of a run with ground truth, to be read only."""
    return make_run(tmp_path_factory.mktemp("labelled") / "raw", ground_truth=True).path


@pytest.fixture(scope="session")
def labelled_formats(labelled_run, tmp_path_factory):
    """That run as a sequence in every format, a folder each, to be read only."""
    out = tmp_path_factory.mktemp("labelled") / "out"
    write_sequence(run_frames(labelled_run), out, formats=tuple(FORMATS))
    return out


@pytest.fixture(scope="session")
def all_formats(shared_run, tmp_path_factory):
    """That run as a sequence in every format, a folder each, to be read only."""
    out = tmp_path_factory.mktemp("formats") / "out"
    write_sequence(run_frames(shared_run.path), out, formats=tuple(FORMATS))
    return out
