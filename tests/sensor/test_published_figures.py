"""The figures that are printed of devices, as the picture of docs/measured/sensor.md shows them."""

import pytest
from iclnuim.tools.sensor_curves import PUBLISHED, WHITE, figures


@pytest.mark.parametrize("point", PUBLISHED, ids=lambda p: f"{p.model} {p.what} {p.depth_m:g} m")
def test_models_are_within_15_percent_of_printed_figures_and_below_printed_bounds(point):
    ours_mm = figures(point.model, point.depth_m, 0, WHITE)[point.what]
    if point.is_bound:
        assert abs(ours_mm) <= point.value_mm
    else:
        assert ours_mm == pytest.approx(point.value_mm, rel=0.15)
