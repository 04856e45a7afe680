"""People who walk around the camera: surfaces that move independently of it, in depth and in
colour.
"""

import numpy as np

from .registry import perturbation
from .segment import Images, Segment

#: Half the width of a person in metres.
_HALF_M = 0.25
#: Height of the head above the camera's mean height in metres.
_ABOVE_M = 0.35
#: Patches of clothes around a person.
_AROUND = 12
#: Patches of clothes in a metre of its height.
_PER_M = 8


@perturbation
def people(segment: Segment, count: float, radius_m: float, speed_m_s: float) -> Segment:
    """This number of people walk one behind the other on a circle around the camera; the first
    crosses the view's centre half-way.

    Each is an upright cylinder with random clothes, whose axis is vertical (z of the world). The
    circle's centre is the camera's mean position.
    """
    rays = segment.true_camera.rays().astype(np.float32)
    places = np.stack([segment.pose(segment.stamps_s[n]).translation for n in segment.numbers])
    centre = places.mean(0).astype(np.float32)
    middle_s = segment.stamps_s[segment.middle]
    ahead = segment.pose(middle_s).rotation[:2, 2]
    patches = (int(count), 4 * _PER_M, _AROUND, 3)
    clothes = segment.generator(segment.numbers[0]).integers(30, 226, patches)

    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        stamp_s = segment.stamps_s[number]
        T_world_camera = segment.pose(stamp_s)
        directions = rays @ T_world_camera.rotation.T.astype(np.float32)
        start = T_world_camera.translation.astype(np.float32)
        shown = colour.copy()
        nearest = depth_z_m
        for k in range(int(count)):
            angle = np.arctan2(ahead[1], ahead[0]) + 2 * np.pi * k / count
            angle += speed_m_s / radius_m * (stamp_s - middle_s)
            axis = centre[:2] + radius_m * np.array([np.cos(angle), np.sin(angle)])
            z = _cylinder(directions[..., :2], start[:2] - axis.astype(np.float32))
            points = start + z[..., None] * directions
            in_front = (z > 0) & ((z < nearest) | (nearest == 0))
            on = in_front & (points[..., 2] < centre[2] + _ABOVE_M)
            x, y, height = points[on].T
            around = np.arctan2(y - axis[1], x - axis[0]) - angle
            column = (around / (2 * np.pi) * _AROUND).astype(int) % _AROUND
            row = ((centre[2] + _ABOVE_M - height) * _PER_M).astype(int) % len(clothes[k])
            shown[on] = clothes[k, row, column]
            nearest = np.where(on, z, nearest).astype(np.float32)
        return shown, nearest

    return segment.with_images(change)


def _cylinder(directions: np.ndarray, start: np.ndarray) -> np.ndarray:
    """(h, w) parameter of the first intersection of each ray with a vertical cylinder about the
    origin; 0 where there is none in front.

    directions: (h, w, 2) and start: (2,), their horizontal parts.
    """
    a = np.square(directions).sum(-1)
    b = directions @ start
    inside = b * b - a * (start @ start - np.float32(_HALF_M**2))
    with np.errstate(invalid="ignore", divide="ignore"):
        z = (-b - np.sqrt(inside)) / a
    return np.where((inside > 0) & (z > 0), z, 0).astype(np.float32)
