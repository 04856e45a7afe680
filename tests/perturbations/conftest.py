"""What the textured box shows at any time."""

import pytest
from box_scene import look, pose_at, segment, truth  # noqa: F401
from iclnuim.sensor.transfer import srgb8


@pytest.fixture(scope="session")
def look_at():
    """look_at(stamp_s): what the scene shows then, sRGB and depth; the judge of what is made
    between frames.
    """

    def seen(stamp_s):
        light, depth_z_m = look(pose_at(stamp_s))
        return srgb8(light), depth_z_m

    return seen
