"""Image pyramids: each level has its own camera, and is the 2x2 mean of the one before, so that K
is defined at pixel centres on every level.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from iclnuim.geometry.camera import PinholeCamera

from . import kernels
from .protocol import Frame

#: An image with fewer rows or columns than this has no coarser level.
MIN_SIDE = 32
#: An image with a smaller standard deviation (grey levels) is black, white or covered.
MIN_CONTRAST = 1.0


@dataclass(frozen=True, eq=False)
class Level:
    """grey and depth_z_m (h, w) float32; normals (h, w, 3) are computed at first use."""

    grey: np.ndarray
    depth_z_m: np.ndarray
    camera: PinholeCamera
    normal_step: int = 1
    rendered: bool = False  # a view of a model of many frames
    calibrated: bool = False  # Frame.calibrated
    rough: bool = False  # its depth has the noise of a sensor

    @cached_property
    def _gradient_points(self) -> dict[tuple, kernels.GradientPoints]:
        return {}

    def gradient_points(self, rule: tuple) -> kernels.GradientPoints:
        """kernels.gradient_points() with `rule`, computed once: many frames are aligned with one
        keyframe.
        """
        found = self._gradient_points
        if rule not in found:
            image = (self.grey, self.depth_z_m)
            found[rule] = kernels.gradient_points(self.camera.intrinsics, image, rule)
        return found[rule]

    @cached_property
    def normals(self) -> np.ndarray:
        """Unit normals towards the camera, in its frame; 0 at depth edges and where a neighbour is
        missing.
        """
        return kernels.normals(self.depth_z_m, self.camera.intrinsics, self.normal_step)


def pyramid(
    frame: Frame,
    camera: PinholeCamera,
    levels: int,
    *,
    median_depth: bool = False,
    normal_step: int = 1,
) -> list[Level]:
    """Levels, fine to coarse.

    Depth is halved by kernels.halve_depth(), or by the 3x3 median of every second pixel.
    """
    halve = kernels.halve_depth_median if median_depth else kernels.halve_depth
    level = Level(frame.grey, frame.depth_z_m, camera, normal_step, calibrated=frame.calibrated)
    result = [level]
    while len(result) < levels and min(level.camera.width, level.camera.height) >= MIN_SIDE:
        level = replace(
            level,
            grey=kernels.halve_grey(level.grey),
            depth_z_m=halve(level.depth_z_m),
            camera=level.camera.halved(),
        )
        result.append(level)
    return result


class Pair(NamedTuple):
    """What is aligned: the levels of the reference and of the current frame, fine to coarse."""

    reference: list[Level]
    current: list[Level]

    @property
    def rough(self) -> bool:
        """Whether the current frame's depth has the noise of a sensor."""
        return self.current[0].rough

    @property
    def rendered(self) -> bool:
        """Whether the reference is a view of a model."""
        return self.reference[-1].rendered

    @property
    def calibrated(self) -> bool:
        return self.current[0].calibrated

    def no_contrast(self) -> bool:
        """Whether one of the images has too little contrast for photometric alignment."""
        return any(float(levels[-1].grey.std()) < MIN_CONTRAST for levels in self)


class PyramidOdometer:
    """An odometer whose prepare() returns a list of Level, fine to coarse.

    settings have `iterations`, the maximum number on each level, fine to coarse (0: the level is
    not used), and `reference`. reads_normals, reads_grey: whether a rendered reference needs
    normals and grey values.
    """

    reads_normals = reads_grey = False

    @property
    def reads_depth_alone(self) -> bool:
        return not self.reads_grey

    def __init__(self, settings: Any) -> None:
        self.settings = settings
        self.iterations: tuple[int, ...] = settings.iterations
        self.reference: str = settings.reference
        self.finest = next(n for n, count in enumerate(self.iterations) if count)

    def schedule(self, levels: list[Level]) -> list[tuple[int, int]]:
        """(level, iterations) from coarse to fine.

        If the images are too small for these levels, the coarsest one available.
        """
        used = [n for n in reversed(range(len(levels))) if self.iterations[n]]
        if not used:
            return [(len(levels) - 1, self.iterations[self.finest])]
        return [(n, self.iterations[n]) for n in used]
