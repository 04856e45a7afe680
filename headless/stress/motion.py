"""Changes of when things are seen: faster motion, frames that are missing, light gathered over a while, rows and streams out of step.

What is seen between two frames is made from the nearest one: its depth and the true poses say where each pixel goes (`Shift`). Surfaces
that mirror move with the surface that mirrors.
"""

from dataclasses import replace

import cv2
import numpy as np
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.sensor.transfer import light_from_srgb8, srgb8

from .stretch import Images, Stretch

#: Two instants of an exposure lie this far apart in the image where anything moves at the median, and there are no more of them than this.
_STEP_PX, _MAX_INSTANTS = 2.0, 16
#: Rounds of looking up the depth where a pixel came from.
_ROUNDS = 2
#: Neighbouring depths that differ by a larger share of themselves are not of one surface.
_EDGE = 0.03


def speed(stretch: Stretch, factor: float) -> Stretch:
    """Every so many frames only: the same path as fast a motion."""
    return replace(stretch, numbers=stretch.numbers[:: int(factor)])


def dropped_frames(stretch: Stretch, percent: float) -> Stretch:
    """Frames, the first never, that do not arrive."""
    first, *rest = stretch.numbers
    kept = [number for number in rest if stretch.generator(number).random() >= percent / 100]
    return replace(stretch, numbers=(first, *kept))


def frozen_frames(stretch: Stretch, percent: float, run: float) -> Stretch:
    """Runs of so many frames that show what the frame before the run showed."""
    first, length = stretch.numbers[0], int(run)
    froze = {k for k in range(first // length, stretch.numbers[-1] // length + 1)}
    froze = {k for k in froze if stretch.generator(k * length).random() < percent / 100}
    load = stretch.load

    def shown(number: int) -> Images:
        while number > first and number // length in froze:
            number = number // length * length - 1
        return load(max(number, first))

    return replace(stretch, load=shown)


def motion_blur(stretch: Stretch, exposure_ms: float) -> Stretch:
    """Colour is the mean light of an exposure around the stamp; where it is longer than a frame, as many fewer frames are taken. Depth stays sharp."""
    exposure_s, load = exposure_ms / 1e3, stretch.load
    step_s = stretch.stamps_s[stretch.numbers[1]] - stretch.stamps_s[stretch.numbers[0]]
    keep = max(1, int(np.ceil(exposure_s / step_s - 1e-6)))

    def blurred(number: int) -> Images:
        return srgb8(exposed(stretch, stretch.stamps_s[number], exposure_s)), load(number)[1]

    return replace(stretch, numbers=stretch.numbers[::keep], load=blurred)


def rolling_shutter(stretch: Stretch, readout_ms: float) -> Stretch:
    """Rows of colour and depth are taken one after another, the middle one at the stamp."""
    half_s, load = readout_ms / 2e3, stretch.load

    def rolled(number: int) -> Images:
        colour, depth_z_m = load(number)
        h = len(depth_z_m)
        shares = (2 * (np.arange(h, dtype=np.float32) + 0.5) / h - 1)[:, None]
        early, late = (Shift.between(stretch, number, stretch.stamps_s[number] + s) for s in (-half_s, half_s))
        pairs = zip(early.arrays, late.arrays, strict=True)
        shift = Shift(*(np.where(shares < 0, -shares * a, shares * b) for a, b in pairs))
        return shift.colour(colour), shift.depth(depth_z_m)

    return replace(stretch, load=rolled)


def out_of_step(stretch: Stretch, late_ms: float) -> Stretch:
    """Colour is that of so much later than depth, whose stamp the frame has."""
    load = stretch.load

    def shown(number: int) -> Images:
        return srgb8(_light_at(stretch, stretch.stamps_s[number] + late_ms / 1e3)), load(number)[1]

    return replace(stretch, load=shown)


def exposed(stretch: Stretch, stamp_s: float, exposure_s: float) -> np.ndarray:
    """Mean scene-linear light (h, w, 3) over an exposure around any time within the sequence."""
    moved_px = Shift.between(stretch, _nearest(stretch, stamp_s), stamp_s + exposure_s / 2).median_px
    instants = int(np.clip(np.ceil(2 * moved_px / _STEP_PX), 1, _MAX_INSTANTS))
    offsets_s = ((np.arange(instants) + 0.5) / instants - 0.5) * exposure_s
    light = np.zeros((stretch.true_camera.height, stretch.true_camera.width, 3), np.float32)
    for offset_s in offsets_s:
        light += _light_at(stretch, stamp_s + offset_s)
    return light / np.float32(instants)


def depth_at(stretch: Stretch, stamp_s: float) -> np.ndarray:
    """Depth (h, w) seen at any time, in metres."""
    number = _nearest(stretch, stamp_s)
    return Shift.between(stretch, number, stamp_s).depth(stretch.load(number)[1])


def _nearest(stretch: Stretch, stamp_s: float) -> int:
    return int(np.argmin(np.abs(stretch.truth.stamps_s - stamp_s)))


def _light_at(stretch: Stretch, stamp_s: float) -> np.ndarray:
    """Scene-linear light (h, w, 3) seen at any time, of the nearest frame."""
    number = _nearest(stretch, stamp_s)
    shift = Shift.between(stretch, number, stamp_s)
    return shift.colour(light_from_srgb8(stretch.load(number)[0]))


class Shift:
    """Where in a frame's image each pixel (h, w) of another view lies, from its own place, in pixels; and how much farther it is
    than in the frame, as a share.
    """

    def __init__(self, u_px: np.ndarray, v_px: np.ndarray, farther: np.ndarray) -> None:
        self.arrays = (u_px, v_px, farther)

    @classmethod
    def between(cls, stretch: Stretch, number: int, stamp_s: float) -> "Shift":
        """To what is seen at another time near a frame's own."""
        T_frame_other = stretch.pose(stretch.stamps_s[number]).inverse() @ stretch.pose(stamp_s)
        return cls.to(stretch.load(number)[1], stretch.true_camera, T_frame_other)

    @classmethod
    def to(cls, depth_z_m: np.ndarray, camera: PinholeCamera, T_frame_other: SE3) -> "Shift":
        """To the view of a camera close by; what has no depth counts as far away."""
        far = np.where(depth_z_m > 0, depth_z_m, np.float32(1e3)).astype(np.float32)
        f, c = (np.array(pair, np.float32) for pair in ((camera.fx, camera.fy), (camera.cx, camera.cy)))
        turned = camera.rays().astype(np.float32) @ T_frame_other.rotation.T.astype(np.float32)
        back = T_frame_other.inverse()
        row, offset_m = back.rotation[2].astype(np.float32), np.float32(back.translation[2])
        own = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), -1).astype(np.float32)
        place, z, found = own, far, far
        for _ in range(_ROUNDS):
            points = turned * z[..., None] + T_frame_other.translation.astype(np.float32)
            place = f * points[..., :2] / np.maximum(points[..., 2:], np.float32(1e-3)) + c
            u, v = place[..., 0], place[..., 1]
            found = _depth_at(far, u, v)
            z = found * ((place - c) / f @ row[:2] + row[2]) + offset_m
        moved = place - own
        return cls(moved[..., 0], moved[..., 1], z / found - 1)

    @property
    def median_px(self) -> float:
        """How far pixels move, at the median."""
        return float(np.median(np.hypot(self.arrays[0], self.arrays[1])))

    def colour(self, image: np.ndarray) -> np.ndarray:
        """The other view's colours, of any type."""
        return cv2.remap(image, *self._places(), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)

    def depth(self, depth_z_m: np.ndarray) -> np.ndarray:
        """The other view's depth: that of its surface, moved as that is."""
        return np.maximum(_depth_at(depth_z_m, *self._places()) * (1 + self.arrays[2]), 0).astype(np.float32)

    def _places(self) -> tuple[np.ndarray, np.ndarray]:
        h, w = self.arrays[0].shape
        u, v = np.arange(w, dtype=np.float32)[None], np.arange(h, dtype=np.float32)[:, None]
        return (u + self.arrays[0]).astype(np.float32), (v + self.arrays[1]).astype(np.float32)


def _depth_at(depth_z_m: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Between pixels: linear within a surface, that of the nearest pixel at its edge; the image's border goes on."""
    linear, nearest = (
        np.asarray(cv2.remap(depth_z_m, u, v, how, borderMode=cv2.BORDER_REPLICATE), np.float32)
        for how in (cv2.INTER_LINEAR, cv2.INTER_NEAREST)
    )
    return np.where(np.abs(linear - nearest) < _EDGE * nearest, linear, nearest)
