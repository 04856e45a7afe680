"""Objects put into the scene, geometrically exact in every frame: walls, panes, poles, bars, an
object that moves with the camera; and gloss.

A pane, a pole or a bar would leave the view when the camera rotates. Every `_EVERY_S`, new ones are
put in the plane in front of the camera at that time, so that about the same share of the view stays
covered.
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.sensor.depth_image import surface_normals
from iclnuim.sensor.transfer import light_from_srgb8, srgb8

from .segment import Images, Segment

_EVERY_S = 1.0
#: Grey values of a wall and of poles, 0..255.
_WALL, _POLE = 170.0, 40.0


@dataclass(frozen=True, eq=False)
class Hits:
    """Intersections of a frame's rays with a plane: planar depth (h, w), 0 or less where there is
    none, and metres right and down from the plane's centre.
    """

    depth_z_m: np.ndarray
    right_m: np.ndarray
    down_m: np.ndarray

    @classmethod
    def of(cls, camera: PinholeCamera, T_anchor_camera: SE3, distance_m: float) -> "Hits":
        """Intersections with the plane z = distance_m of an anchor's camera."""
        rays = camera.rays().astype(np.float32) @ T_anchor_camera.rotation.T.astype(np.float32)
        start = T_anchor_camera.translation.astype(np.float32)
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = (np.float32(distance_m) - start[2]) / rays[..., 2]
            depth[~(np.isfinite(depth) & (rays[..., 2] > 0))] = 0
            return cls(depth, start[0] + depth * rays[..., 0], start[1] + depth * rays[..., 1])

    def before(self, depth_z_m: np.ndarray) -> np.ndarray:
        """(h, w) whether the plane is nearer than the surface in the frame."""
        return (self.depth_z_m > 0) & ((self.depth_z_m < depth_z_m) | (depth_z_m == 0))


def bare_wall(segment: Segment, percent: float, distance_m: float) -> Segment:
    """A wall without texture in front of the camera; at 100 % it is infinite."""
    size = np.sqrt(percent / 100) if percent < 100 else np.inf
    half = [size * side for side in _half_view_m(segment.true_camera, distance_m)]

    def seen(
        number: int, colour: np.ndarray, depth_z_m: np.ndarray, hits: Hits, anchor: int
    ) -> Images:
        on = (
            hits.before(depth_z_m)
            & (np.abs(hits.right_m) < half[0])
            & (np.abs(hits.down_m) < half[1])
        )
        return np.where(on[..., None], np.uint8(_WALL), colour), np.where(
            on, hits.depth_z_m, depth_z_m
        )

    return _with_planes(segment, distance_m, lambda _: [segment.middle], seen)


def glass(segment: Segment, percent: float, distance_m: float) -> Segment:
    """Panes that are visible in depth and invisible in colour."""
    half = [np.sqrt(percent / 100) * side for side in _half_view_m(segment.true_camera, distance_m)]

    def seen(
        number: int, colour: np.ndarray, depth_z_m: np.ndarray, hits: Hits, anchor: int
    ) -> Images:
        on = (
            hits.before(depth_z_m)
            & (np.abs(hits.right_m) < half[0])
            & (np.abs(hits.down_m) < half[1])
        )
        return colour, np.where(on, hits.depth_z_m, depth_z_m)

    return _with_planes(segment, distance_m, _anchors, seen)


def thin_structures(segment: Segment, percent: float, distance_m: float, width_m: float) -> Segment:
    """Vertical poles that are visible in colour and invisible in depth."""

    def seen(
        number: int, colour: np.ndarray, depth_z_m: np.ndarray, hits: Hits, anchor: int
    ) -> Images:
        on = hits.before(depth_z_m) & _bars(segment, hits, percent, distance_m, width_m)
        return np.where(on[..., None], np.uint8(_POLE), colour), depth_z_m

    return _with_planes(segment, distance_m, _anchors, seen)


def mirror_bars(segment: Segment, percent: float, distance_m: float, width_m: float) -> Segment:
    """Vertical flat bars that reflect distant surroundings; depth is that of the bars."""

    def seen(
        number: int, colour: np.ndarray, depth_z_m: np.ndarray, hits: Hits, anchor: int
    ) -> Images:
        on = hits.before(depth_z_m) & _bars(segment, hits, percent, distance_m, width_m)
        directions = (
            _relative(segment, anchor, number).rotation @ (segment.true_camera.rays()[on]).T
        )
        mirrored = directions.T * (1, 1, -1)  # at the plane z = constant of the anchor's camera
        shown = colour.copy()
        shown[on] = _surroundings(segment, anchor, mirrored)
        return shown, np.where(on, hits.depth_z_m, depth_z_m)

    return _with_planes(segment, distance_m, _anchors, seen)


def moving_object(
    segment: Segment, percent: float, distance_m: float, sway_m: float, hz: float
) -> Segment:
    """A textured object that moves along in front of the camera and sways left and right."""
    camera, anchor = segment.true_camera, segment.numbers[0]
    half = [np.sqrt(percent / 100) * side for side in _half_view_m(camera, distance_m)]
    texture = _texture(segment)

    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        passed_s = segment.stamps_s[number] - segment.stamps_s[anchor]
        sway = np.array([sway_m * np.sin(2 * np.pi * hz * passed_s), 0, 0])
        hits = Hits.of(camera, SE3(np.eye(3), -sway), distance_m)
        on = (
            hits.before(depth_z_m)
            & (np.abs(hits.right_m) < half[0])
            & (np.abs(hits.down_m) < half[1])
        )
        rows, columns = (
            (a[on] * 200).astype(int) % len(texture) for a in (hits.down_m, hits.right_m)
        )
        shown = colour.copy()
        shown[on] = texture[rows, columns]
        return shown, np.where(on, hits.depth_z_m, depth_z_m)

    return segment.with_images(change)


def gloss(segment: Segment, percent: float, smooth_px: float) -> Segment:
    """All surfaces reflect this share of distant surroundings and lose the same share of their own
    radiance. Normals come from depth smoothed over `smooth_px`.
    """
    camera, share, side = segment.true_camera, np.float32(percent / 100), int(smooth_px)

    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        inverse = cv2.blur(
            np.where(depth_z_m > 0, 1 / np.maximum(depth_z_m, 1e-3), 0).astype(np.float32),
            (side, side),
        )
        found = surface_normals(
            np.where(inverse > 0, 1 / np.maximum(inverse, 1e-6), 0).astype(np.float32), camera
        )
        normals = np.stack([found.x, found.y, found.z], -1)
        normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-9)
        on = (depth_z_m > 0) & np.isfinite(normals).all(-1)
        rays, facing = camera.rays().astype(np.float32)[on], normals[on].astype(np.float32)
        mirrored = rays - 2 * (rays * facing).sum(-1, keepdims=True) * facing
        T_anchor_camera = _relative(segment, segment.middle, number)
        seen = light_from_srgb8(
            _surroundings(
                segment, segment.middle, mirrored @ T_anchor_camera.rotation.T.astype(np.float32)
            )
        )
        light = light_from_srgb8(colour)
        light[on] = (1 - share) * light[on] + share * seen
        return srgb8(light), depth_z_m

    return segment.with_images(change)


def _with_planes(
    segment: Segment,
    distance_m: float,
    anchors: Callable[[Segment], list[int]],
    seen: Callable[[int, np.ndarray, np.ndarray, Hits, int], Images],
) -> Segment:
    """The segment with a plane in front of the camera of each anchor; seen(number, colour, depth,
    hits, anchor) draws the object on it.
    """
    numbers = anchors(segment)

    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        colour_there, depth_there = colour, depth_z_m
        for anchor in numbers:
            hits = Hits.of(segment.true_camera, _relative(segment, anchor, number), distance_m)
            if (hits.depth_z_m > 0).any():
                colour_there, depth_there = seen(number, colour_there, depth_there, hits, anchor)
        return colour_there, depth_there

    return segment.with_images(change)


def _anchors(segment: Segment) -> list[int]:
    stamps_s = np.array([segment.stamps_s[number] for number in segment.numbers])
    times = np.arange(
        stamps_s[0] + _EVERY_S / 2, max(stamps_s[-1], stamps_s[0] + _EVERY_S), _EVERY_S
    )
    return [segment.numbers[int(np.argmin(np.abs(stamps_s - t)))] for t in times]


def _relative(segment: Segment, anchor: int, number: int) -> SE3:
    """T_anchor_camera."""
    return segment.pose(segment.stamps_s[anchor]).inverse() @ segment.pose(segment.stamps_s[number])


def _half_view_m(camera: PinholeCamera, distance_m: float) -> tuple[float, float]:
    return camera.width / 2 / camera.fx * distance_m, camera.height / 2 / camera.fy * distance_m


def _bars(
    segment: Segment, hits: Hits, percent: float, distance_m: float, width_m: float
) -> np.ndarray:
    """(h, w) whether a pixel is on one of the vertical bars, which fill the view of their anchor."""
    half = _half_view_m(segment.true_camera, distance_m)
    inside = (np.abs(hits.right_m) < half[0]) & (np.abs(hits.down_m) < half[1])
    return inside & (np.mod(hits.right_m, width_m / (percent / 100)) < width_m)


def _surroundings(segment: Segment, anchor: int, directions: np.ndarray) -> np.ndarray:
    """(n, 3) uint8 colours of directions (n, 3) in an anchor's camera: its image, mapped to all
    directions and mirrored at its borders.
    """
    image = segment.load(anchor)[0]
    h, w = image.shape[:2]
    azimuth = np.arctan2(directions[:, 0], directions[:, 2]) / np.pi  # -1..1
    height = (
        np.arctan2(directions[:, 1], np.hypot(directions[:, 0], directions[:, 2])) / np.pi
    )  # -0.5..0.5
    return image[((height + 0.5) * (h - 1)).astype(int), (np.abs(azimuth) * (w - 1)).astype(int)]


def _texture(segment: Segment) -> np.ndarray:
    """(64, 64, 3) uint8 random texture; one texel is half a centimetre wide."""
    rng = segment.generator(segment.numbers[0])
    return np.kron(rng.integers(30, 226, (16, 16, 3)), np.ones((4, 4, 1))).astype(np.uint8)
