"""Image pyramids with the camera of each level: 2x2 means, so that K keeps to pixel centres."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from ..geometry.camera import PinholeCamera
from . import kernels
from .protocol import Frame


@dataclass(frozen=True, eq=False)
class Level:
    """grey and depth_z_m (h, w) float32; normals (h, w, 3) are made when asked for."""

    grey: np.ndarray
    depth_z_m: np.ndarray
    camera: PinholeCamera
    normal_step: int = 1

    @cached_property
    def k(self) -> np.ndarray:
        c = self.camera
        return np.array([c.fx, c.fy, c.cx, c.cy])

    @cached_property
    def normals(self) -> np.ndarray:
        """Towards the camera, in its frame; 0 at depth edges and where a neighbour is missing."""
        normals = np.zeros((*self.depth_z_m.shape, 3), np.float32)
        kernels.normals(self.depth_z_m, self.k, self.normal_step, normals)
        return normals


def pyramid(
    frame: Frame, camera: PinholeCamera, levels: int, *, depth: str = "mean", normal_step: int = 1
) -> list[Level]:
    """Fine to coarse. depth: "mean" of what belongs together, or "median-pick" (3x3 median, every second pixel)."""
    grey, z = frame.grey, frame.depth_z_m
    result = [Level(grey, z, camera, normal_step)]
    for _ in range(levels - 1):
        if min(camera.width, camera.height) < 32:
            break
        camera = camera.halved()
        grey = _halved(kernels.halve_grey, grey)
        z = _median_picked(z) if depth == "median-pick" else _halved(kernels.halve_depth, z)
        result.append(Level(grey, z, camera, normal_step))
    return result


def _halved(kernel: Callable, image: np.ndarray) -> np.ndarray:
    half = np.empty((image.shape[0] // 2, image.shape[1] // 2), np.float32)
    kernel(image, half)
    return half


def _median_picked(z: np.ndarray) -> np.ndarray:
    height, width = z.shape
    return np.ascontiguousarray(cv2.medianBlur(z, 3)[: height // 2 * 2 : 2, : width // 2 * 2 : 2])
