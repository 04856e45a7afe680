"""Which instants make up a frame: centred, close enough in pixels, and every row within a tenth of
a pixel of its own.
"""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory, sample
from iclnuim.sensor.exposure import Exposure, motion_px, plan


@pytest.mark.parametrize("seed", range(40))
def test_bands_cover_all_rows_and_keep_every_row_near_its_own_instant(seed):
    rng = np.random.default_rng(seed)
    height, (blur_px, skew_px), (open_s, readout_s) = (
        int(rng.integers(1, 500)),
        rng.uniform(0, 60, 2),
        rng.uniform(1e-4, 0.1, 2),
    )
    bands = plan(Exposure(open_s, readout_s), height, blur_px, skew_px)
    assert [b.top for b in bands] == [0, *(b.bottom for b in bands[:-1])] and bands[
        -1
    ].bottom == height
    for band in bands:
        middle = np.mean(band.offsets_s)
        rows = (np.arange(band.top, band.bottom) + 0.5) / height - 0.5
        off_px = np.abs(rows * readout_s - middle) / readout_s * skew_px
        assert off_px.max() <= 0.1 + 1e-9
        if len(band.offsets_s) > 1:
            assert np.diff(band.offsets_s).max() / open_s * blur_px <= 1 + 1e-9


def test_there_are_no_more_bands_and_instants_than_needed():
    bands = plan(Exposure(0.01, 0.02), 480, 7.0, 10.0)
    rows = [band.bottom - band.top for band in bands]
    assert max(rows) / 2 / 480 * 10.0 == pytest.approx(0.1, rel=0.1)
    assert np.diff(bands[0].offsets_s)[0] / 0.01 * 7.0 == pytest.approx(1.0, rel=0.01)


def test_no_exposure_is_one_instant():
    (band,) = plan(Exposure(), 480, 50.0, 50.0)
    assert (band.top, band.bottom, band.offsets_s) == (0, 480, (0.0,))
    assert Exposure().instant and not Exposure(0.01).instant


def _moves(*steps_m):
    """Poses that start at the frame's own and go step by step to the right, stamps 10 ms apart."""
    places = np.cumsum([0.0, *steps_m])
    positions = np.column_stack([places, np.zeros((len(places), 2))])
    return SE3(np.broadcast_to(np.eye(3), (len(places), 3, 3)), positions), 0.01 * np.arange(
        len(places)
    )


def test_motion_of_a_wall_follows_the_pinhole_formula():
    camera = PinholeCamera()
    moved = motion_px(np.full((480, 640), 2.0), camera, *_moves(0.02))
    assert moved == pytest.approx(camera.fx * 0.02 / 2.0)


def test_uneven_motion_counts_as_if_its_fastest_stretch_lasted_all_the_while():
    camera, wall = PinholeCamera(), np.full((480, 640), 2.0)
    assert motion_px(wall, camera, *_moves(0.0, 0.02)) == pytest.approx(2 * camera.fx * 0.02 / 2.0)
    assert motion_px(wall, camera, *_moves(0.01, -0.01)) == pytest.approx(camera.fx * 0.02 / 2.0)


def test_where_depth_is_missing_only_turning_counts():
    camera = PinholeCamera()
    assert motion_px(np.zeros((480, 640)), camera, *_moves(0.02)) < 1e-3


@pytest.mark.parametrize("seed", range(5))
def test_every_row_of_a_moving_frame_lies_within_a_tenth_of_a_pixel_of_its_own_instant(seed):
    rng = np.random.default_rng(seed)
    camera, readout_s = PinholeCamera.parse("160x120"), 0.03
    # jerky: speed and direction change at each pose
    path = Trajectory.at_rate(SE3.exp(np.cumsum(rng.normal(0, 0.02, (5, 6)), 0)))
    depth = np.repeat(rng.uniform(0.8, 4.0, 40), 4)[None] + np.zeros((120, 1))
    here, stamp_s = path.T_world_camera[2], path.stamps_s[2]
    stops = stamp_s + np.array([-0.5, 0.0, 0.5]) * readout_s
    moved = motion_px(depth, camera, here.inverse() @ sample(path, stops), stops)
    bands = plan(Exposure(readout_s=readout_s), camera.height, 0.0, moved)
    assert moved > 2 and len(bands) >= moved / 0.2
    points = here.apply((camera.rays() * depth[..., None]).reshape(-1, 3))
    worst_px = 0.0
    for band in bands:
        for row in range(band.top, band.bottom):
            own_s = stamp_s + ((row + 0.5) / camera.height - 0.5) * readout_s
            shown, own = (
                camera.project(sample(path, np.array([t]))[0].inverse().apply(points))
                for t in (stamp_s + band.offsets_s[0], own_s)
            )
            inside = (
                (np.abs(own[:, 1] - row) < 1) & (own[:, 0] > 0) & (own[:, 0] < camera.width - 1)
            )
            worst_px = max(worst_px, np.linalg.norm(shown - own, axis=1)[inside].max())
    assert 0.02 < worst_px <= 0.102  # a screw's speed is not quite even over the image


@pytest.mark.parametrize("wrong", [-0.1, 2, float("nan"), "0.1", True])
def test_a_time_that_cannot_be_is_refused(wrong):
    with pytest.raises(InputError, match=r"exposure_s: expected a number in 0\.\.1 \(s\)"):
        Exposure(exposure_s=wrong)
