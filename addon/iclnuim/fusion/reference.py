"""What a model shows to an odometer: frames are fused where they were found, and the next is aligned against the surface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import InputError
from ..geometry.camera import PinholeCamera
from ..odometry.protocol import Frame, Odometer, Result
from ..odometry.pyramid import Level, pyramid
from ..odometry.reference import turned
from .volume import PRESETS as VOLUMES
from .volume import View, Volume, VolumeSettings


@dataclass(frozen=True)
class ModelSettings:
    """every: frames from one fusion and raycast to the next; in between the view is kept, as is its pose. It is kept
    up to `longest` frames while it tells the motion to most_sigma_m, and the camera turned by less than most_deg since.
    """

    volume: VolumeSettings
    every: int = 1
    longest: int = 1
    most_sigma_m: float = 0.0002
    most_deg: float = 8.0


PRESETS = {
    "paper": ModelSettings(VOLUMES["paper"]),
    "best": ModelSettings(VOLUMES["best"], every=3, longest=6),
}


class ModelReference:
    """A Reference whose view is the raycast of everything fused so far; `leaving`: as a Volume's."""

    def __init__(
        self, odometer: Odometer, camera: PinholeCamera, preset: str = "best", leaving: Callable | None = None
    ) -> None:
        if preset not in PRESETS:
            raise InputError(f"a preset of the model ({', '.join(PRESETS)})", found=preset)
        self.settings, self.odometer, self.camera = PRESETS[preset], odometer, camera
        # what only asks for geometry is spared the colours
        grey = 1 if _asks_for(odometer)[1] else 0
        self.volume = Volume(replace(self.settings.volume, channels=grey), leaving)
        self._view, self._T_world_view, self._age = None, np.eye(4), 0

    def renew(
        self, frame: Frame, prepared: Any, T_world_camera: np.ndarray, result: Result | None = None
    ) -> tuple[Any, np.ndarray]:
        """Fuse the frame and look from its pose; or keep the view. Returns the view and its T_world_camera."""
        self._age += 1
        if self._view is None or self._outdated(T_world_camera, result):
            self.volume.integrate(frame.depth_z_m, self.camera, T_world_camera, frame.grey)
            self._view, self._T_world_view = self._seen(frame, prepared, T_world_camera), T_world_camera
            self._age = 0
        return self._view, self._T_world_view

    def _outdated(self, T_world_camera: np.ndarray, result: Result | None) -> bool:
        s = self.settings
        if not s.every <= self._age < s.longest:
            return self._age >= s.every
        sure = result is not None and result.weakest_sigma_m <= s.most_sigma_m
        return not sure or turned(self._T_world_view, T_world_camera, s.most_deg)

    def restart(self, frame: Frame, prepared: Any, T_world_camera: np.ndarray) -> tuple[Any, np.ndarray]:
        """The frame alone, unfused: at a pose that nobody measured it would spoil the model."""
        self._view, self._age = None, 0
        return prepared, T_world_camera

    def _seen(self, frame: Frame, prepared: Any, T_world_camera: np.ndarray) -> Any:
        """As prepare() would make it of a frame taken there. Coarser levels are means of the finest that is used."""
        if not (isinstance(prepared, list) and isinstance(prepared[0], Level)):
            view = self.volume.raycast(self.camera, T_world_camera, normals=False)
            return self.odometer.prepare(_as_frame(view, frame.grey, frame.stamp_s), self.camera)
        finest, (planes, light) = _finest(self.odometer.settings), _asks_for(self.odometer)
        first = prepared[finest]
        view = self.volume.raycast(first.camera, T_world_camera, planes, light)
        seen = _as_frame(view, first.grey, frame.stamp_s)
        levels = pyramid(seen, first.camera, len(prepared) - finest, normal_step=first.normal_step)
        if planes:
            # the gradient's normals, rather than those that differences of depth would give when first asked for
            vars(levels[0])["normals"] = np.nan_to_num(view.normals_camera)
        return [*prepared[:finest], *levels]


def _asks_for(odometer: Odometer) -> tuple[bool, bool]:
    """Whether an odometer looks at normals, and whether at grey levels; a peer may look at all."""
    settings = getattr(odometer, "settings", None)
    if settings is None:
        return True, True
    return hasattr(settings, "most_angle_deg"), hasattr(settings, "most_dz_m")


def _finest(settings: Any) -> int:
    """The finest level that an odometer of ours looks at."""
    if hasattr(settings, "levels"):
        return min(settings.levels)
    return next(n for n, count in enumerate(settings.iterations) if count)


def _as_frame(view: View, grey: np.ndarray, stamp_s: float) -> Frame:
    """Where the model has a hole there is no depth, and the frame's own grey, so that the hole has no bright rim."""
    if view.colour.size:
        colour = view.colour[..., 0]
        grey = np.where(np.isfinite(colour), colour, grey)
    return Frame(grey, np.nan_to_num(view.depth_z_m), stamp_s)
