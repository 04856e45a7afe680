"""Image pyramids with the camera of each level (2x2 means, so that K keeps to pixel centres), and odometers on them."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np

from ..geometry.camera import PinholeCamera
from . import kernels
from .protocol import Frame

#: No level is made of an image with fewer rows or columns than this.
MIN_SIDE = 32


@dataclass(frozen=True, eq=False)
class Level:
    """grey and depth_z_m (h, w) float32; normals (h, w, 3) are made when asked for."""

    grey: np.ndarray
    depth_z_m: np.ndarray
    camera: PinholeCamera
    normal_step: int = 1

    @cached_property
    def k(self) -> np.ndarray:
        """(4,): fx, fy, cx, cy."""
        c = self.camera
        return np.array([c.fx, c.fy, c.cx, c.cy])

    @cached_property
    def normals(self) -> np.ndarray:
        """Towards the camera, in its frame; 0 at depth edges and where a neighbour is missing."""
        return kernels.normals(self.depth_z_m, self.k, self.normal_step)


class PyramidOdometer:
    """An odometer whose prepare() makes a list of Level, fine to coarse, and what it reads of them.

    settings have `iterations`, at most so many on each level, fine to coarse (0: the level is not read), and `reference`.
    reads_normals, reads_grey: what a rendered reference needs to hold.
    """

    reads_normals = reads_grey = False

    def __init__(self, settings: Any) -> None:
        self.settings, self.iterations, self.reference = settings, settings.iterations, settings.reference
        self.finest = next(n for n, count in enumerate(self.iterations) if count)

    def schedule(self, levels: list[Level]) -> list[tuple[int, int]]:
        """(level, iterations) from coarse to fine; of images too small for any, the coarsest there is."""
        used = [(n, self.iterations[n]) for n in reversed(range(len(levels))) if self.iterations[n]]
        return used or [(len(levels) - 1, self.iterations[self.finest])]


def pyramid(
    frame: Frame, camera: PinholeCamera, levels: int, *, median_depth: bool = False, normal_step: int = 1
) -> list[Level]:
    """Fine to coarse. Depth is halved by means of what belongs together, or by a 3x3 median and every second pixel."""
    grey, z = frame.grey, frame.depth_z_m
    result = [Level(grey, z, camera, normal_step)]
    for _ in range(levels - 1):
        if min(camera.width, camera.height) < MIN_SIDE:
            break
        camera = camera.halved()
        grey = kernels.halve_grey(grey)
        if median_depth:
            z = np.ascontiguousarray(cv2.medianBlur(z, 3)[: 2 * camera.height : 2, : 2 * camera.width : 2])
        else:
            z = kernels.halve_depth(z)
        result.append(Level(grey, z, camera, normal_step))
    return result
