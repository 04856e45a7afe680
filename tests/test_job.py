"""A job that cannot be rendered is refused when it is made: before a scene is opened."""

import pytest
from iclnuim.errors import InputError
from iclnuim.job import RenderJob, shipped_job


@pytest.mark.parametrize("samples", [1, 0, 65537])
def test_samples_of_a_light_map_come_in_two_halves(samples):
    with pytest.raises(InputError, match="map_samples.*2..65536"):
        shipped_job("living_room/kt0").changed(map_samples=samples)
    assert shipped_job("living_room/kt0").changed(map_samples=2).map_samples == 2


def test_textures_have_no_mipmaps_where_samples_filter_them():
    job = RenderJob("kt2", "living_room", "living_room/kt2")
    assert job.mipmaps and job.changed(antialias=True).mipmaps  # one sample
    assert job.changed(samples=4).mipmaps  # all go through the pixel's centre
    assert not job.changed(samples=4, antialias=True).mipmaps
