"""The figures that are printed of devices, as docs/measured/sensors.md shows them."""

import pytest
from iclnuim.tools.sensor_curves import PUBLISHED, of_model


@pytest.mark.parametrize("point", PUBLISHED, ids=lambda p: f"{p.model} {p.what} {p.depth_m:g} m")
def test_models_are_within_15_percent_of_printed_figures_and_below_printed_bounds(point):
    """Or apart from them, for a reason that the page says."""
    assert (point.low <= of_model(point) <= point.high) != bool(point.apart)
