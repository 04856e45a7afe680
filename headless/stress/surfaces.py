"""Things put into the scene, exact in every frame: walls, panes, poles, bars, something that moves along; and gloss.

A pane, a pole or a bar would leave the view as the camera turns: new ones stand before it every `_EVERY_S`, each in the plane before the
camera at that moment, so that about the same share of the view stays covered.
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.sensor.depth_image import surface_normals
from iclnuim.sensor.transfer import light_from_srgb8, srgb8

from .stretch import Images, Stretch

_EVERY_S = 1.0
#: Grey of a wall and of poles, of 255.
_WALL, _POLE = 170.0, 40.0


@dataclass(frozen=True, eq=False)
class Hits:
    """Where the rays of a frame meet a plane: planar depth (h, w), not above 0 where they do not, and metres right and down from its centre."""

    depth_z_m: np.ndarray
    right_m: np.ndarray
    down_m: np.ndarray

    @classmethod
    def of(cls, camera: PinholeCamera, T_anchor_camera: SE3, distance_m: float) -> "Hits":
        """Of the plane at z = distance_m of an anchor's camera."""
        rays = camera.rays().astype(np.float32) @ T_anchor_camera.rotation.T.astype(np.float32)
        start = T_anchor_camera.translation.astype(np.float32)
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = (np.float32(distance_m) - start[2]) / rays[..., 2]
            depth[~(np.isfinite(depth) & (rays[..., 2] > 0))] = 0
            return cls(depth, start[0] + depth * rays[..., 0], start[1] + depth * rays[..., 1])

    def before(self, depth_z_m: np.ndarray) -> np.ndarray:
        """(h, w) whether the plane is nearer than what a frame sees there."""
        return (self.depth_z_m > 0) & ((self.depth_z_m < depth_z_m) | (depth_z_m == 0))


def bare_wall(stretch: Stretch, percent: float, distance_m: float) -> Stretch:
    """A wall without texture before the camera; at 100 % it has no end."""
    size = np.sqrt(percent / 100) if percent < 100 else np.inf
    half = [size * side for side in _half_view_m(stretch.true_camera, distance_m)]

    def seen(number: int, colour: np.ndarray, depth_z_m: np.ndarray, hits: Hits, anchor: int) -> Images:
        on = hits.before(depth_z_m) & (np.abs(hits.right_m) < half[0]) & (np.abs(hits.down_m) < half[1])
        return np.where(on[..., None], np.uint8(_WALL), colour), np.where(on, hits.depth_z_m, depth_z_m)

    return _with_planes(stretch, distance_m, lambda _: [stretch.middle], seen)


def glass(stretch: Stretch, percent: float, distance_m: float) -> Stretch:
    """Panes that the depth sensor sees and colour does not."""
    half = [np.sqrt(percent / 100) * side for side in _half_view_m(stretch.true_camera, distance_m)]

    def seen(number: int, colour: np.ndarray, depth_z_m: np.ndarray, hits: Hits, anchor: int) -> Images:
        on = hits.before(depth_z_m) & (np.abs(hits.right_m) < half[0]) & (np.abs(hits.down_m) < half[1])
        return colour, np.where(on, hits.depth_z_m, depth_z_m)

    return _with_planes(stretch, distance_m, _anchors, seen)


def thin_structures(stretch: Stretch, percent: float, distance_m: float, width_m: float) -> Stretch:
    """Upright poles that colour sees and the depth sensor looks past."""

    def seen(number: int, colour: np.ndarray, depth_z_m: np.ndarray, hits: Hits, anchor: int) -> Images:
        on = hits.before(depth_z_m) & _bars(stretch, hits, percent, distance_m, width_m)
        return np.where(on[..., None], np.uint8(_POLE), colour), depth_z_m

    return _with_planes(stretch, distance_m, _anchors, seen)


def mirror_bars(stretch: Stretch, percent: float, distance_m: float, width_m: float) -> Stretch:
    """Upright flat bars that mirror surroundings far away; the depth sensor sees the bars."""

    def seen(number: int, colour: np.ndarray, depth_z_m: np.ndarray, hits: Hits, anchor: int) -> Images:
        on = hits.before(depth_z_m) & _bars(stretch, hits, percent, distance_m, width_m)
        directions = _relative(stretch, anchor, number).rotation @ (stretch.true_camera.rays()[on]).T
        mirrored = directions.T * (1, 1, -1)  # at the plane z = constant of the anchor's camera
        shown = colour.copy()
        shown[on] = _surroundings(stretch, anchor, mirrored)
        return shown, np.where(on, hits.depth_z_m, depth_z_m)

    return _with_planes(stretch, distance_m, _anchors, seen)


def moving_object(stretch: Stretch, percent: float, distance_m: float, sway_m: float, hz: float) -> Stretch:
    """Something textured that moves along before the camera and sways to its left and right."""
    camera, anchor = stretch.true_camera, stretch.numbers[0]
    half = [np.sqrt(percent / 100) * side for side in _half_view_m(camera, distance_m)]
    texture = _texture(stretch)

    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        passed_s = stretch.stamps_s[number] - stretch.stamps_s[anchor]
        sway = np.array([sway_m * np.sin(2 * np.pi * hz * passed_s), 0, 0])
        hits = Hits.of(camera, SE3(np.eye(3), -sway), distance_m)
        on = hits.before(depth_z_m) & (np.abs(hits.right_m) < half[0]) & (np.abs(hits.down_m) < half[1])
        rows, columns = ((a[on] * 200).astype(int) % len(texture) for a in (hits.down_m, hits.right_m))
        shown = colour.copy()
        shown[on] = texture[rows, columns]
        return shown, np.where(on, hits.depth_z_m, depth_z_m)

    return stretch.with_images(change)


def gloss(stretch: Stretch, percent: float, smooth_px: float) -> Stretch:
    """All surfaces mirror this share of surroundings far away and lose as much of their own light. Normals are of depth smoothed over some pixels."""
    camera, share, side = stretch.true_camera, np.float32(percent / 100), int(smooth_px)

    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        inverse = cv2.blur(np.where(depth_z_m > 0, 1 / np.maximum(depth_z_m, 1e-3), 0).astype(np.float32), (side, side))
        found = surface_normals(np.where(inverse > 0, 1 / np.maximum(inverse, 1e-6), 0).astype(np.float32), camera)
        normals = np.stack([found.x, found.y, found.z], -1)
        normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-9)
        on = (depth_z_m > 0) & np.isfinite(normals).all(-1)
        rays, facing = camera.rays().astype(np.float32)[on], normals[on].astype(np.float32)
        mirrored = rays - 2 * (rays * facing).sum(-1, keepdims=True) * facing
        T_anchor_camera = _relative(stretch, stretch.middle, number)
        seen = light_from_srgb8(
            _surroundings(stretch, stretch.middle, mirrored @ T_anchor_camera.rotation.T.astype(np.float32))
        )
        light = light_from_srgb8(colour)
        light[on] = (1 - share) * light[on] + share * seen
        return srgb8(light), depth_z_m

    return stretch.with_images(change)


def _with_planes(
    stretch: Stretch,
    distance_m: float,
    anchors: Callable[[Stretch], list[int]],
    seen: Callable[[int, np.ndarray, np.ndarray, Hits, int], Images],
) -> Stretch:
    """A plane before the camera of each anchor; seen(number, colour, depth, hits, anchor) puts in what stands there."""
    numbers = anchors(stretch)

    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        colour_there, depth_there = colour, depth_z_m
        for anchor in numbers:
            hits = Hits.of(stretch.true_camera, _relative(stretch, anchor, number), distance_m)
            if (hits.depth_z_m > 0).any():
                colour_there, depth_there = seen(number, colour_there, depth_there, hits, anchor)
        return colour_there, depth_there

    return stretch.with_images(change)


def _anchors(stretch: Stretch) -> list[int]:
    stamps_s = np.array([stretch.stamps_s[number] for number in stretch.numbers])
    times = np.arange(stamps_s[0] + _EVERY_S / 2, max(stamps_s[-1], stamps_s[0] + _EVERY_S), _EVERY_S)
    return [stretch.numbers[int(np.argmin(np.abs(stamps_s - t)))] for t in times]


def _relative(stretch: Stretch, anchor: int, number: int) -> SE3:
    """T_anchor_camera."""
    return stretch.pose(stretch.stamps_s[anchor]).inverse() @ stretch.pose(stretch.stamps_s[number])


def _half_view_m(camera: PinholeCamera, distance_m: float) -> tuple[float, float]:
    return camera.width / 2 / camera.fx * distance_m, camera.height / 2 / camera.fy * distance_m


def _bars(stretch: Stretch, hits: Hits, percent: float, distance_m: float, width_m: float) -> np.ndarray:
    """(h, w) on one of the upright bars, which fill the view of their anchor."""
    half = _half_view_m(stretch.true_camera, distance_m)
    inside = (np.abs(hits.right_m) < half[0]) & (np.abs(hits.down_m) < half[1])
    return inside & (np.mod(hits.right_m, width_m / (percent / 100)) < width_m)


def _surroundings(stretch: Stretch, anchor: int, directions: np.ndarray) -> np.ndarray:
    """(n, 3) uint8 of directions (n, 3) in an anchor's camera: its own colours, spread over all directions and mirrored at their ends."""
    image = stretch.load(anchor)[0]
    h, w = image.shape[:2]
    azimuth = np.arctan2(directions[:, 0], directions[:, 2]) / np.pi  # -1..1
    height = np.arctan2(directions[:, 1], np.hypot(directions[:, 0], directions[:, 2])) / np.pi  # -0.5..0.5
    return image[((height + 0.5) * (h - 1)).astype(int), (np.abs(azimuth) * (w - 1)).astype(int)]


def _texture(stretch: Stretch) -> np.ndarray:
    """(64, 64, 3) uint8, of cells of half a centimetre each."""
    rng = stretch.generator(stretch.numbers[0])
    return np.kron(rng.integers(30, 226, (16, 16, 3)), np.ones((4, 4, 1))).astype(np.uint8)
