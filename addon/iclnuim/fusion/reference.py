"""Tracking against a model: frames are fused where they were found, and the next is aligned against the surface."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import InputError
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from ..odometry.protocol import Frame, Odometer, Result
from ..odometry.solver import PyramidOdometer, pyramid
from ..odometry.track import REFERENCES, Reference, reference, rotated
from ..odometry.track import View as ReferenceView
from .settings import PRESETS as VOLUMES
from .settings import VolumeSettings
from .volume import View, Volume

#: What `make_reference` understands.
NAMES = ("default", *REFERENCES, "model")


@dataclass(frozen=True)
class ModelSettings:
    """every: frames from one fusion and raycast to the next; in between the view stays, as does its pose. It stays
    up to max_age frames while the motion is certain to max_sigma_m, and the camera rotated by less than max_deg since.
    """

    volume: VolumeSettings
    every: int = 1
    max_age: int = 1
    max_sigma_m: float = 0.0002
    max_deg: float = 8.0


PRESETS = {
    "paper": ModelSettings(VOLUMES["paper"]),
    # what slanted views add completes a surface; 90 frames of clean kt2 were not tracked better by it
    "best": ModelSettings(replace(VOLUMES["best"], slanted=1), every=3, max_age=6),
}


def make_reference(name: str, odometer: Odometer, camera: PinholeCamera, preset: str = "best") -> Reference:
    """What to align against: "default" (what the odometer asks for), "frame", "keyframe", "entropy" or "model".

    Raises InputError for another name.
    """
    if name not in NAMES:
        raise InputError(f"a reference ({', '.join(NAMES)})", found=name)
    if name == "model":
        return ModelReference(odometer, camera, preset)
    return reference(odometer.reference if name == "default" else name)


class ModelReference(Reference):
    """A Reference whose view is the raycast of everything fused so far.

    An odometer is shown a Frame of the whole image; a PyramidOdometer only the levels that it reads, with the model's normals.
    Raises InputError for an unknown preset.
    """

    def __init__(self, odometer: Odometer, camera: PinholeCamera, preset: str = "best") -> None:
        if preset not in PRESETS:
            raise InputError(f"a preset of the model ({', '.join(PRESETS)})", found=preset)
        self.settings, self.odometer, self.camera = PRESETS[preset], odometer, camera
        geometry_alone = isinstance(odometer, PyramidOdometer) and not odometer.reads_grey
        self.volume = Volume(replace(self.settings.volume, channels=0 if geometry_alone else 1))
        self._view: Any = None
        self._T_world_view, self._age = SE3.identity(), 0

    def renew(self, frame: Frame, prepared: Any, T_world_camera: SE3, result: Result | None = None) -> ReferenceView:
        """Fuse the frame and look from its pose; or stay with the view."""
        self._age += 1
        if self._view is None or self._outdated(T_world_camera, result):
            self.volume.integrate(frame.depth_z_m, self.camera, T_world_camera, frame.grey)
            self._view, self._T_world_view = self._seen(frame, prepared, T_world_camera), T_world_camera
            self._age = 0
        return self._view, self._T_world_view

    def restart(self, frame: Frame, prepared: Any, T_world_camera: SE3) -> ReferenceView:
        """The frame alone, unfused: at a pose that was not measured it would spoil the model."""
        self._view, self._age = None, 0
        return prepared, T_world_camera

    def _outdated(self, T_world_camera: SE3, result: Result | None) -> bool:
        s = self.settings
        if not s.every <= self._age < s.max_age:
            return self._age >= s.every
        certain = result is not None and result.largest_sigma_m <= s.max_sigma_m
        return not certain or rotated(self._T_world_view, T_world_camera, s.max_deg)

    def _seen(self, frame: Frame, prepared: Any, T_world_camera: SE3) -> Any:
        """As prepare() would make it of a frame taken there. Coarser levels are means of the finest that is read."""
        one = self.odometer
        if not isinstance(one, PyramidOdometer):
            view = self.volume.raycast(self.camera, T_world_camera, normals=False)
            return one.prepare(_as_frame(view, frame.grey, frame.stamp_s), self.camera)
        finest = min(one.finest, len(prepared) - 1)
        first = prepared[finest]
        view = self.volume.raycast(first.camera, T_world_camera, one.reads_normals, one.reads_grey)
        seen = _as_frame(view, first.grey, frame.stamp_s)
        levels = pyramid(seen, first.camera, len(prepared) - finest, normal_step=first.normal_step)
        if one.reads_normals:
            # the gradient's normals, rather than those that differences of depth would give when first asked for
            vars(levels[0])["normals"] = np.nan_to_num(view.normals_camera)
        return [*prepared[:finest], *levels]


def _as_frame(view: View, grey: np.ndarray, stamp_s: float) -> Frame:
    """Where the model has a hole there is no depth, and the frame's own grey, so that the hole has no bright rim."""
    if view.colour.size:
        colour = view.colour[..., 0]
        grey = np.where(np.isfinite(colour), colour, grey)
    return Frame(grey, np.nan_to_num(view.depth_z_m), stamp_s)
