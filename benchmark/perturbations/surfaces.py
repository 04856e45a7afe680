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
from iclnuim.sensor.transfer import linear_from_srgb8, srgb8

from .registry import perturbation
from .segment import Images, Segment

_EVERY_S = 1.0
#: Grey value of a wall, 0..255.
_WALL = 170
#: Grey value of poles, 0..255.
_POLE = 40


@dataclass(frozen=True, eq=False)
class PlaneHits:
    """Intersections of a frame's rays with a plane in front of an anchor's camera: planar depth (h,
    w), 0 or less where there is none, and metres right and down from the plane's centre.
    half_view_m: (2,) half the width and height of the anchor's view on the plane.
    """

    depth_z_m: np.ndarray
    right_m: np.ndarray
    down_m: np.ndarray
    half_view_m: np.ndarray

    @classmethod
    def of(cls, camera: PinholeCamera, T_anchor_camera: SE3, distance_m: float) -> "PlaneHits":
        """Intersections with the plane z = distance_m of an anchor's camera."""
        rays = camera.rays().astype(np.float32) @ T_anchor_camera.rotation.T.astype(np.float32)
        start = T_anchor_camera.translation.astype(np.float32)
        half_view = np.array([camera.width / camera.fx, camera.height / camera.fy]) / 2
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = (np.float32(distance_m) - start[2]) / rays[..., 2]
            depth[~(np.isfinite(depth) & (rays[..., 2] > 0))] = 0
            right_m = start[0] + depth * rays[..., 0]
            down_m = start[1] + depth * rays[..., 1]
        return cls(depth, right_m, down_m, half_view * distance_m)

    def before(self, depth_z_m: np.ndarray) -> np.ndarray:
        """(h, w) whether the plane is nearer than the surface in the frame."""
        return (self.depth_z_m > 0) & ((self.depth_z_m < depth_z_m) | (depth_z_m == 0))

    def in_middle(self, percent: float) -> np.ndarray:
        """(h, w) whether a pixel is on the rectangle with this share of the anchor's view."""
        half_m = np.sqrt(percent / 100) * self.half_view_m
        return (np.abs(self.right_m) < half_m[0]) & (np.abs(self.down_m) < half_m[1])

    def on_bars(self, percent: float, width_m: float) -> np.ndarray:
        """(h, w) whether a pixel is on one of the vertical bars that cover this share of the
        anchor's view.
        """
        return self.in_middle(100) & (np.mod(self.right_m, width_m / (percent / 100)) < width_m)


@perturbation
def bare_wall(segment: Segment, percent: float, distance_m: float) -> Segment:
    """A wall without texture in front of the camera; at 100 % it is infinite."""

    def seen(
        number: int, colour: np.ndarray, depth_z_m: np.ndarray, hits: PlaneHits, anchor: int
    ) -> Images:
        on = hits.before(depth_z_m)
        if percent < 100:
            on &= hits.in_middle(percent)
        shown = np.where(on[..., None], np.uint8(_WALL), colour)
        return shown, np.where(on, hits.depth_z_m, depth_z_m)

    return _with_planes(segment, distance_m, [segment.middle], seen)


@perturbation
def glass(segment: Segment, percent: float, distance_m: float) -> Segment:
    """Panes that are visible in depth and invisible in colour."""

    def seen(
        number: int, colour: np.ndarray, depth_z_m: np.ndarray, hits: PlaneHits, anchor: int
    ) -> Images:
        on = hits.before(depth_z_m) & hits.in_middle(percent)
        return colour, np.where(on, hits.depth_z_m, depth_z_m)

    return _with_planes(segment, distance_m, _anchors(segment), seen)


@perturbation
def thin_structures(segment: Segment, percent: float, distance_m: float, width_m: float) -> Segment:
    """Vertical poles that are visible in colour and invisible in depth."""

    def seen(
        number: int, colour: np.ndarray, depth_z_m: np.ndarray, hits: PlaneHits, anchor: int
    ) -> Images:
        on = hits.before(depth_z_m) & hits.on_bars(percent, width_m)
        return np.where(on[..., None], np.uint8(_POLE), colour), depth_z_m

    return _with_planes(segment, distance_m, _anchors(segment), seen)


@perturbation
def mirror_bars(segment: Segment, percent: float, distance_m: float, width_m: float) -> Segment:
    """Vertical flat bars that reflect distant surroundings; depth is that of the bars."""

    def seen(
        number: int, colour: np.ndarray, depth_z_m: np.ndarray, hits: PlaneHits, anchor: int
    ) -> Images:
        on = hits.before(depth_z_m) & hits.on_bars(percent, width_m)
        R_anchor_camera = _relative(segment, anchor, number).rotation
        directions = R_anchor_camera @ segment.true_camera.rays()[on].T
        mirrored = directions.T * (1, 1, -1)  # at the plane z = constant of the anchor's camera
        shown = colour.copy()
        shown[on] = _surroundings(segment, anchor, mirrored)
        return shown, np.where(on, hits.depth_z_m, depth_z_m)

    return _with_planes(segment, distance_m, _anchors(segment), seen)


@perturbation
def moving_object(
    segment: Segment, percent: float, distance_m: float, sway_m: float, hz: float
) -> Segment:
    """A textured object that moves along in front of the camera and sways left and right."""
    start_s = segment.stamps_s[segment.numbers[0]]
    texture = _texture(segment)

    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        passed_s = segment.stamps_s[number] - start_s
        sway = np.array([sway_m * np.sin(2 * np.pi * hz * passed_s), 0, 0])
        hits = PlaneHits.of(segment.true_camera, SE3(np.eye(3), -sway), distance_m)
        on = hits.before(depth_z_m) & hits.in_middle(percent)
        rows = (hits.down_m[on] * 200).astype(int) % len(texture)
        columns = (hits.right_m[on] * 200).astype(int) % len(texture)
        shown = colour.copy()
        shown[on] = texture[rows, columns]
        return shown, np.where(on, hits.depth_z_m, depth_z_m)

    return segment.with_images(change)


@perturbation
def gloss(segment: Segment, percent: float, smooth_px: float) -> Segment:
    """All surfaces reflect this share of distant surroundings and lose the same share of their own
    radiance. Normals come from depth smoothed over `smooth_px`.
    """
    share = np.float32(percent / 100)
    all_rays = segment.true_camera.rays().astype(np.float32)

    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        normals = _smooth_normals(depth_z_m, segment.true_camera, int(smooth_px))
        on = (depth_z_m > 0) & np.isfinite(normals).all(-1)
        rays = all_rays[on]
        facing = normals[on].astype(np.float32)
        mirrored = rays - 2 * (rays * facing).sum(-1, keepdims=True) * facing
        R_anchor_camera = _relative(segment, segment.middle, number).rotation.astype(np.float32)
        seen = _surroundings(segment, segment.middle, mirrored @ R_anchor_camera.T)
        light = linear_from_srgb8(colour)
        light[on] = (1 - share) * light[on] + share * linear_from_srgb8(seen)
        return srgb8(light), depth_z_m

    return segment.with_images(change)


def _smooth_normals(depth_z_m: np.ndarray, camera: PinholeCamera, side_px: int) -> np.ndarray:
    """(h, w, 3) unit normals of depth that is averaged, as inverse depth, over side_px."""
    inverse = np.where(depth_z_m > 0, 1 / np.maximum(depth_z_m, 1e-3), 0).astype(np.float32)
    inverse = np.asarray(cv2.blur(inverse, (side_px, side_px)))
    smooth_m = np.where(inverse > 0, 1 / np.maximum(inverse, 1e-6), 0).astype(np.float32)
    found = surface_normals(smooth_m, camera)
    normals = np.stack([found.x, found.y, found.z], -1)
    return normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-9)


def _with_planes(
    segment: Segment,
    distance_m: float,
    anchors: list[int],
    seen: Callable[[int, np.ndarray, np.ndarray, PlaneHits, int], Images],
) -> Segment:
    """The segment with a plane in front of the camera of each anchor; seen(number, colour, depth,
    hits, anchor) draws the object on it.
    """

    def change(number: int, colour: np.ndarray, depth_z_m: np.ndarray) -> Images:
        for anchor in anchors:
            T_anchor_camera = _relative(segment, anchor, number)
            hits = PlaneHits.of(segment.true_camera, T_anchor_camera, distance_m)
            if (hits.depth_z_m > 0).any():
                colour, depth_z_m = seen(number, colour, depth_z_m, hits, anchor)
        return colour, depth_z_m

    return segment.with_images(change)


def _anchors(segment: Segment) -> list[int]:
    """The frames nearest to the middle of each interval of _EVERY_S."""
    stamps_s = np.array([segment.stamps_s[number] for number in segment.numbers])
    end_s = max(stamps_s[-1], stamps_s[0] + _EVERY_S)
    times_s = np.arange(stamps_s[0] + _EVERY_S / 2, end_s, _EVERY_S)
    return [segment.numbers[int(np.argmin(np.abs(stamps_s - t)))] for t in times_s]


def _relative(segment: Segment, anchor: int, number: int) -> SE3:
    """T_anchor_camera."""
    return segment.pose(segment.stamps_s[anchor]).inverse() @ segment.pose(segment.stamps_s[number])


def _surroundings(segment: Segment, anchor: int, directions: np.ndarray) -> np.ndarray:
    """(n, 3) uint8 colours of directions (n, 3) in an anchor's camera: its image, mapped to all
    directions and mirrored at its borders.
    """
    image = segment.load(anchor)[0]
    h, w = image.shape[:2]
    x, y, z = directions.T
    azimuth = np.arctan2(x, z) / np.pi  # -1..1
    height = np.arctan2(y, np.hypot(x, z)) / np.pi  # -0.5..0.5
    return image[((height + 0.5) * (h - 1)).astype(int), (np.abs(azimuth) * (w - 1)).astype(int)]


def _texture(segment: Segment) -> np.ndarray:
    """(64, 64, 3) uint8 random texture; one texel is half a centimetre wide."""
    rng = segment.generator(segment.numbers[0])
    return np.kron(rng.integers(30, 226, (16, 16, 3)), np.ones((4, 4, 1))).astype(np.uint8)
