"""`iclnuim trajectory plot --align` draws the others in the world of the first, as ATE aligns them."""

import iclnuim
import numpy as np
import pytest
from iclnuim.headless import cli
from iclnuim.headless.commands.trajectory import _aligned

POSES = iclnuim.SE3.exp(np.cumsum(np.random.default_rng(0).normal(size=(40, 6)) * 0.1, axis=0))
TRUTH = iclnuim.Trajectory.at_rate(POSES)


def written(path, trajectory):
    iclnuim.write_trajectory(path, trajectory, "tum")
    return path


@pytest.mark.parametrize(("method", "scale"), [("se3", 1.0), ("sim3", 0.25)])
def test_another_world_and_scale_are_taken_back(tmp_path, method, scale):
    T = iclnuim.SE3.exp([1, 2, 3, 0.3, 0.5, 1]) @ POSES
    moved = iclnuim.Trajectory(TRUTH.stamps_s, iclnuim.SE3(T.rotation, scale * T.translation))
    read = [
        iclnuim.read_trajectory(written(tmp_path / name, one))
        for name, one in (("gt.txt", TRUTH), ("est.txt", moved))
    ]
    found = _aligned(*read, method).trajectory
    np.testing.assert_allclose(found.positions_m, TRUTH.positions_m, atol=1e-5)
    ate = iclnuim.absolute_trajectory_error(TRUTH, moved, alignment=method)
    np.testing.assert_allclose(found.positions_m, ate.aligned.translation, atol=1e-5)


def test_the_option_draws_a_picture(tmp_path):
    file = str(written(tmp_path / "gt.txt", TRUTH))
    out = tmp_path / "a.png"
    assert cli.main(["trajectory", "plot", file, file, "--align", "sim3", "-o", str(out)]) == 0
    assert out.stat().st_size > 1000
