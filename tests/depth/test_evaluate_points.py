"""`iclnuim evaluate points` and point_errors: point maps in files, in the world or the camera."""

import json

import numpy as np
import pytest
from iclnuim import SE3, open_sequence, point_errors
from iclnuim.errors import InputError
from iclnuim.formats.exr import write_exr

MOVED = SE3.exp(np.array([0.1, 0.2, -0.3, 0.5, 0.1, 0.2]))


def world_points(truth):
    sequence = open_sequence(truth)
    for frame in sequence:
        points = sequence.camera.unproject(frame.depth_z_m.astype(float)).reshape(-1, 3)
        shape = (*frame.depth_z_m.shape, 3)
        yield frame.T_world_camera.apply(points).reshape(shape)


def as_npy(folder, row, points):
    np.save(folder / f"{row:06}.npy", points)


def as_npz(folder, row, points):
    np.savez(folder / f"{row:06}.npz", world_points=points[None], depth=points[None, ..., 2:])


def as_exr(folder, row, points):
    channels = dict(zip("RGB", np.moveaxis(points.astype(np.float32), -1, 0), strict=True))
    (folder / f"{row:06}").mkdir()
    write_exr(folder / f"{row:06}/points.exr", channels)


@pytest.mark.parametrize("write", [as_npy, as_npz, as_exr])
def test_moved_and_scaled_points_of_the_world_are_exact(truth, tmp_path, write):
    for row, points in enumerate(world_points(truth)):
        moved = MOVED.apply(points.reshape(-1, 3)).reshape(points.shape) * 0.5
        write(tmp_path, row, moved)
    found = point_errors(tmp_path, truth)
    assert found.errors.scale == pytest.approx(2, rel=1e-5) and found.errors.mean_m < 1e-5
    assert len(found.errors.frames) == 4 and found.missing == ()


def test_one_array_for_all_frames_of_another_size(truth, tmp_path):
    stack = np.stack(list(world_points(truth)))[:, ::2, ::2]
    np.savez(tmp_path / "predictions.npz", world_points=stack)
    assert point_errors(tmp_path, truth, "none").errors.mean_m < 0.2


def test_points_in_the_frame_of_the_camera(truth, tmp_path, command_here):
    sequence = open_sequence(truth)
    for row, frame in enumerate(sequence):
        points = sequence.camera.unproject(frame.depth_z_m.astype(float))
        np.save(tmp_path / f"{row:06}.npy", points / 3)
    words = ["evaluate", "points", tmp_path, "--truth", truth, "--frame", "camera"]
    words += ["--align", "scale", "--csv", tmp_path / "points.csv"]
    code, text, _ = command_here(*words, "--json")
    values = json.loads(text)
    assert code == 0 and values["scale"] == pytest.approx(3) and values["mean_m"] < 1e-9
    assert len((tmp_path / "points.csv").read_text().splitlines()) == 5
    code, text, _ = command_here(*words)
    assert code == 0 and "mean [mm]" in text
    only = point_errors(tmp_path, truth, "scale", "camera", only=["sofa"]).errors
    assert 0 < only.to_dict()["points"] < values["points"]


def test_points_of_the_world_need_poses(truth, tmp_path):
    import shutil

    bare = shutil.copytree(truth, tmp_path / "bare")
    (bare / "groundtruth.txt").unlink()
    folder = tmp_path / "points"
    folder.mkdir()
    for row, points in enumerate(world_points(truth)):
        np.save(folder / f"{row:06}.npy", points)
    with pytest.raises(InputError, match="frames with true poses"):
        point_errors(folder, bare)
