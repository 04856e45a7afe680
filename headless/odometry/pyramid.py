"""Image pyramids with the camera of each level: 2x2 means, so that K keeps to pixel centres."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from iclnuim.geometry.camera import PinholeCamera

from . import kernels
from .protocol import Frame


@dataclass(frozen=True, eq=False)
class Level:
    """grey and depth_z_m (h, w) float32; gradients in grey levels a pixel, normals (h, w, 3), made when asked for."""

    grey: np.ndarray
    depth_z_m: np.ndarray
    camera: PinholeCamera
    normal_step: int = 1

    @cached_property
    def k(self) -> np.ndarray:
        c = self.camera
        return np.array([c.fx, c.fy, c.cx, c.cy])

    @cached_property
    def gradients(self) -> tuple[np.ndarray, np.ndarray]:
        """Central differences, the slope at the pixel itself."""
        centre = np.array([[-0.5, 0, 0.5]], np.float32)
        return cv2.filter2D(self.grey, -1, centre), cv2.filter2D(self.grey, -1, centre.T)

    @cached_property
    def normals(self) -> np.ndarray:
        """Towards the camera, in its frame; 0 at depth edges and where a neighbour is missing."""
        normals = np.zeros((*self.depth_z_m.shape, 3), np.float32)
        kernels.normals(self.depth_z_m, self.k, self.normal_step, normals)
        return normals


def pyramid(
    frame: Frame, camera: PinholeCamera, levels: int, *, depth: str = "mean", normal_step: int = 1
) -> list[Level]:
    """Fine to coarse. depth: "mean" of what belongs together, or "median-pick" (Kerl: 3x3 median, every second pixel)."""
    grey, z = frame.grey, frame.depth_z_m
    result = [Level(grey, z, camera, normal_step)]
    for _ in range(levels - 1):
        if min(camera.width, camera.height) < 32:
            break
        height, width = camera.height // 2 * 2, camera.width // 2 * 2
        grey = cv2.resize(grey[:height, :width], (width // 2, height // 2), interpolation=cv2.INTER_AREA)
        if depth == "median-pick":
            z = np.ascontiguousarray(cv2.medianBlur(z, 3)[:height:2, :width:2])
        else:
            coarse = np.empty((height // 2, width // 2), np.float32)
            kernels.halve_depth(z, coarse)
            z = coarse
        camera = camera.halved()
        result.append(Level(grey, z, camera, normal_step))
    return result
