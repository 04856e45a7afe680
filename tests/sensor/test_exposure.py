"""Which instants make up a frame: centred, close enough in pixels, and every row within a tenth of a pixel of its own."""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.sensor.exposure import ROW_ERROR_PX, STEP_PX, Exposure, motion_px, plan


@pytest.mark.parametrize("seed", range(40))
def test_bands_cover_all_rows_and_keep_every_row_near_its_own_instant(seed):
    rng = np.random.default_rng(seed)
    height, (blur_px, skew_px), (open_s, readout_s) = (
        int(rng.integers(1, 500)),
        rng.uniform(0, 60, 2),
        rng.uniform(1e-4, 0.1, 2),
    )
    bands = plan(Exposure(open_s, readout_s), height, blur_px, skew_px)
    assert [b.top for b in bands] == [0, *(b.bottom for b in bands[:-1])] and bands[-1].bottom == height
    for band in bands:
        middle = np.mean(band.offsets_s)
        rows = (np.arange(band.top, band.bottom) + 0.5) / height - 0.5
        off_px = np.abs(rows * readout_s - middle) / readout_s * skew_px
        # a row cannot be cut in two, and bands are whole rows
        assert off_px.max() <= ROW_ERROR_PX + skew_px / height
        if len(band.offsets_s) > 1:
            assert np.diff(band.offsets_s).max() / open_s * blur_px <= STEP_PX + 1e-9


def test_no_exposure_is_one_instant():
    (band,) = plan(Exposure(), 480, 50.0, 50.0)
    assert (band.top, band.bottom, band.offsets_s) == (0, 480, (0.0,))
    assert Exposure().instant and not Exposure(0.01).instant


def test_motion_of_a_wall_follows_the_pinhole_formula():
    camera = PinholeCamera()
    T_b_a = SE3(np.eye(3), np.array([-0.02, 0.0, 0.0]))
    assert motion_px(np.full((480, 640), 2.0), camera, T_b_a) == pytest.approx(camera.fx * 0.02 / 2.0)


def test_where_depth_is_missing_only_turning_counts():
    camera = PinholeCamera()
    assert motion_px(np.zeros((480, 640)), camera, SE3(np.eye(3), np.array([-0.02, 0.0, 0.0]))) < 1e-3


@pytest.mark.parametrize("wrong", [-0.1, 2, float("nan"), "0.1", True])
def test_a_time_that_cannot_be_is_refused(wrong):
    with pytest.raises(InputError, match="seconds"):
        Exposure(exposure_s=wrong)
