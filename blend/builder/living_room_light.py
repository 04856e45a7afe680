"""The living room's light."""

from __future__ import annotations

import numpy as np

from . import lights, paintings
from .living_room_measures import LAMPS, SPOTS, WINDOW, Y0, Z1
from .materials import image


def light(seed: int, detail: float) -> None:
    """Sun, sky, daylight through the window, four ceiling spots, two lamps."""
    warm = (1.0, 0.76, 0.48)
    day = (1.0, 0.93, 0.82)
    lights.sun("sun", azimuth_deg=247, elevation_deg=34, strength=8.0, colour=day)
    for k, (x, y) in enumerate(SPOTS, 1):
        place = (x, y, Z1 - 0.012)
        below = (x, y, 0)
        colour = (1.0, 0.84, 0.62)
        lights.spot(f"spot_{k}", place, below, 27.0, colour, cone_deg=96.0, soft=0.8, radius=0.03)
    for name, (x, y) in LAMPS.items():
        lights.lamp(f"lamp_light_{name}", (x, y, 1.595), 5.0, warm, 0.03)
    a, b, c, e = WINDOW
    lights.portal(
        "window_portal",
        ((a + b) / 2, Y0 - 0.10, (c + e) / 2),
        ((a + b) / 2, 0, (c + e) / 2),
        b - a,
        e - c,
    )
    outside = ((a + b) / 2, Y0 - 0.35, (c + e) / 2 + 0.2)
    inside = ((a + b) / 2 + 0.4, 0, 1.2)
    lights.daylight(
        "daylight", outside, inside, b - a, e - c, power=165.0, colour=(0.80, 0.90, 1.0)
    )
    size = max(32, int(512 * min(detail, 1.0)))
    rng = np.random.default_rng(np.random.SeedSequence([seed, 99]))
    lights.sky(image("living_room.sky", paintings.sky(rng, (size, 2 * size))), 1.8)
