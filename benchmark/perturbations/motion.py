"""Perturbations of time: faster motion, missing frames, motion blur, rolling shutter, colour
delayed against depth.

The image at a time between two frames is warped from the nearest frame, with its depth and the true
poses (`Shift`). Reflections move with the surface that reflects.
"""

from dataclasses import replace

import cv2
import numpy as np
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.sensor.transfer import linear_from_srgb8, srgb8

from .registry import perturbation
from .segment import Images, Segment

#: Median motion in the image between two instants of an exposure.
_STEP_PX = 2.0
#: Maximum number of instants of an exposure.
_MAX_INSTANTS = 16
#: Neighbouring depths with a larger relative difference belong to different surfaces.
_EDGE = 0.03


@perturbation
def speed(segment: Segment, factor: float) -> Segment:
    """Only every `factor`-th frame: the same trajectory at `factor` times the speed."""
    return replace(segment, numbers=segment.numbers[:: int(factor)])


@perturbation
def dropped_frames(segment: Segment, percent: float) -> Segment:
    """Some frames, never the first, are missing."""
    first, *rest = segment.numbers
    kept = [number for number in rest if segment.generator(number).random() >= percent / 100]
    return replace(segment, numbers=(first, *kept))


@perturbation
def frozen_frames(segment: Segment, percent: float, run: float) -> Segment:
    """Runs of `run` frames that repeat the frame before the run."""
    first = segment.numbers[0]
    length = int(run)
    load = segment.load

    def is_frozen(number: int) -> bool:
        run_start = number // length * length
        return segment.generator(run_start).random() < percent / 100

    def shown(number: int) -> Images:
        while number > first and is_frozen(number):
            number = number // length * length - 1
        return load(max(number, first))

    return replace(segment, load=shown)


@perturbation
def motion_blur(segment: Segment, exposure_ms: float) -> Segment:
    """Colour is the mean radiance of an exposure around the stamp.

    An exposure longer than a frame lowers the frame rate. Depth stays sharp.
    """
    exposure_s = exposure_ms / 1e3
    load = segment.load
    step_s = segment.stamps_s[segment.numbers[1]] - segment.stamps_s[segment.numbers[0]]
    keep = max(1, int(np.ceil(exposure_s / step_s - 1e-6)))

    def blurred(number: int) -> Images:
        return srgb8(exposed(segment, segment.stamps_s[number], exposure_s)), load(number)[1]

    return replace(segment, numbers=segment.numbers[::keep], load=blurred)


@perturbation
def rolling_shutter(segment: Segment, readout_ms: float) -> Segment:
    """Rows of colour and depth are exposed one after another, the middle row at the stamp."""
    half_s = readout_ms / 2e3
    load = segment.load

    def rolled(number: int) -> Images:
        colour, depth_z_m = load(number)
        h = len(depth_z_m)
        shares = (2 * (np.arange(h, dtype=np.float32) + 0.5) / h - 1)[:, None]
        early = Shift.between(segment, number, segment.stamps_s[number] - half_s)
        late = Shift.between(segment, number, segment.stamps_s[number] + half_s)
        shift = Shift(np.where(shares < 0, -shares * early.arrays, shares * late.arrays))
        return shift.colour(colour), shift.depth(depth_z_m)

    return replace(segment, load=rolled)


@perturbation
def out_of_step(segment: Segment, late_ms: float) -> Segment:
    """Colour is taken `late_ms` after depth; the frame has the stamp of depth."""
    load = segment.load

    def shown(number: int) -> Images:
        return srgb8(_light_at(segment, segment.stamps_s[number] + late_ms / 1e3)), load(number)[1]

    return replace(segment, load=shown)


def exposed(segment: Segment, stamp_s: float, exposure_s: float) -> np.ndarray:
    """Mean scene-linear radiance (h, w, 3) over an exposure around any time within the sequence."""
    end = Shift.between(segment, _nearest(segment, stamp_s), stamp_s + exposure_s / 2)
    instants = int(np.clip(np.ceil(2 * end.median_px / _STEP_PX), 1, _MAX_INSTANTS))
    offsets_s = ((np.arange(instants) + 0.5) / instants - 0.5) * exposure_s
    light = np.zeros((segment.true_camera.height, segment.true_camera.width, 3), np.float32)
    for offset_s in offsets_s:
        light += _light_at(segment, stamp_s + offset_s)
    return light / np.float32(instants)


def depth_at(segment: Segment, stamp_s: float) -> np.ndarray:
    """Depth (h, w) in metres at any time."""
    number = _nearest(segment, stamp_s)
    return Shift.between(segment, number, stamp_s).depth(segment.load(number)[1])


def _nearest(segment: Segment, stamp_s: float) -> int:
    return int(np.argmin(np.abs(segment.truth.stamps_s - stamp_s)))


def _light_at(segment: Segment, stamp_s: float) -> np.ndarray:
    """Scene-linear radiance (h, w, 3) at any time, warped from the nearest frame."""
    number = _nearest(segment, stamp_s)
    shift = Shift.between(segment, number, stamp_s)
    return shift.colour(linear_from_srgb8(segment.load(number)[0]))


class Shift:
    """arrays (3, h, w), for each pixel of another view: the offset in columns and rows to its
    position in a frame's image, and its relative increase of depth over that frame.
    """

    def __init__(self, arrays: np.ndarray) -> None:
        self.arrays = arrays

    @classmethod
    def between(cls, segment: Segment, number: int, stamp_s: float) -> "Shift":
        """The shift from a frame to the view at another time close to its stamp."""
        T_frame_other = segment.pose(segment.stamps_s[number]).inverse() @ segment.pose(stamp_s)
        return cls.to(segment.load(number)[1], segment.true_camera, T_frame_other)

    @classmethod
    def to(cls, depth_z_m: np.ndarray, camera: PinholeCamera, T_frame_other: SE3) -> "Shift":
        """The shift to the view of a nearby camera; pixels without depth count as far away."""
        far = np.where(depth_z_m > 0, depth_z_m, np.float32(1e3)).astype(np.float32)
        f = np.array((camera.fx, camera.fy), np.float32)
        c = np.array((camera.cx, camera.cy), np.float32)
        rotated = camera.rays().astype(np.float32) @ T_frame_other.rotation.T.astype(np.float32)
        back = T_frame_other.inverse()
        row = back.rotation[2].astype(np.float32)
        offset_m = np.float32(back.translation[2])
        pixels = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), -1)
        own = pixels.astype(np.float32)
        place = own
        z = found = far
        for _ in range(2):  # fixed-point iterations for the depth at a pixel's origin
            points = rotated * z[..., None] + T_frame_other.translation.astype(np.float32)
            place = f * points[..., :2] / np.maximum(points[..., 2:], np.float32(1e-3)) + c
            found = _depth_at(far, place[..., 0], place[..., 1])
            z = found * ((place - c) / f @ row[:2] + row[2]) + offset_m
        moved = place - own
        return cls(np.stack([moved[..., 0], moved[..., 1], z / found - 1]))

    @property
    def median_px(self) -> float:
        """Median motion of the pixels."""
        return float(np.median(np.hypot(self.arrays[0], self.arrays[1])))

    def colour(self, image: np.ndarray) -> np.ndarray:
        """The colours of the other view, of any data type."""
        return cv2.remap(image, *self._places(), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)

    def depth(self, depth_z_m: np.ndarray) -> np.ndarray:
        """The depth of the other view: that of the surface, changed by the motion."""
        found = _depth_at(depth_z_m, *self._places()) * (1 + self.arrays[2])
        return np.maximum(found, 0).astype(np.float32)

    def _places(self) -> tuple[np.ndarray, np.ndarray]:
        h, w = self.arrays.shape[1:]
        u = np.arange(w, dtype=np.float32) + self.arrays[0]
        v = np.arange(h, dtype=np.float32)[:, None] + self.arrays[1]
        return u.astype(np.float32), v.astype(np.float32)


def _depth_at(depth_z_m: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Depth between pixels: linear within a surface, that of the nearest pixel at edges; the border
    of the image is replicated.
    """
    border = cv2.BORDER_REPLICATE
    linear = np.asarray(cv2.remap(depth_z_m, u, v, cv2.INTER_LINEAR, borderMode=border))
    nearest = np.asarray(cv2.remap(depth_z_m, u, v, cv2.INTER_NEAREST, borderMode=border))
    return np.where(np.abs(linear - nearest) < _EDGE * nearest, linear, nearest)
