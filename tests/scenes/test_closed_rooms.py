"""No outside is seen through the gaps of a room: under and past its skirting, round its door."""

import numpy as np
import pytest

bpy = pytest.importorskip(
    "bpy", reason="needs the bpy package"
)  # before open3d: both bring a TBB, and bpy 5.2 needs its own
pytest.importorskip("embreex")

from iclnuim.blend.builder import living_room_measures, office_measures  # noqa: E402
from iclnuim.blender.open.model_file import read_model  # noqa: E402
from iclnuim.raycast.caster import RayCaster  # noqa: E402

MEASURES = {"living_room": living_room_measures, "office": office_measures}
#: Heights above the floor and distances from the edges of the leaf at which a gap would be seen.
GAPS_M = np.array([-0.004, -0.002, -0.0005, 0.0002, 0.0005, 0.001, 0.002, 0.003, 0.004])


def round_the_door(m, room):
    """Points (n, 3) along the edges of the leaf, in the plane of the wall."""
    x0, x1, top = m.DOOR
    top += m.Z0 if room == "office" else 0.0
    inset = (
        0.095 if room == "living_room" else 0.055
    )  # of the leaf within the outer edge of its casing
    z, x = np.linspace(m.Z0, top, 200), np.linspace(x0, x1, 200)
    upright = []
    for edge in (x0 + inset, x1 - inset):
        for d in GAPS_M:
            upright.append(np.stack(np.broadcast_arrays(edge + d, m.Y1, z), -1))
    level = [np.stack(np.broadcast_arrays(x, m.Y1, top - inset + d), -1) for d in GAPS_M]
    below = [np.stack(np.broadcast_arrays(x, m.Y1, m.Z0 + d), -1) for d in GAPS_M]
    return np.concatenate([*upright, *level, *below])


def under_the_skirting(m):
    """Points (n, 3) at the foot of the three walls without a window, 12 mm behind the front of the
    skirting.
    """
    x, y = np.linspace(m.X0, m.X1, 300)[2:-2], np.linspace(m.Y0, m.Y1, 300)[2:-2]
    feet = [(x, m.Y1), (m.X0, y), (m.X1, y)]
    return np.concatenate(
        [np.stack(np.broadcast_arrays(a, b, m.Z0 + d), -1) for a, b in feet for d in GAPS_M]
    )


def past_the_skirting(m, room):
    """Points (n, 3) on the lines where the skirting meets the casing of the door, up to its height,
    before and behind its front.
    """
    height = m.SKIRT_TOP if room == "living_room" else 0.06
    z = m.Z0 + np.linspace(0.002, height - 0.03, 40)
    places = []
    for x in m.DOOR[:2]:
        for d in np.linspace(0.0, 0.02, 9):
            places.append((x, m.Y1 - 0.0255 + d))
    return np.concatenate([np.stack(np.broadcast_arrays(x, y, z), -1) for x, y in places])


@pytest.mark.parametrize("room", MEASURES)
def test_nothing_outside_is_seen_through_gaps(room):
    m = MEASURES[room]
    caster = RayCaster(*read_model(room))
    targets = np.concatenate(
        [round_the_door(m, room), under_the_skirting(m), past_the_skirting(m, room)]
    )
    middle = np.array([(m.X0 + m.X1) / 2, (m.Y0 + m.Y1) / 2, m.Z0 + 1.2])
    for eye in (middle, middle + (0.8, -0.9, 0.4), middle + (-0.7, 0.6, -0.6)):
        missed = np.isinf(caster.cast(eye, targets - eye).distance)
        assert not missed.any(), targets[missed][:3]
