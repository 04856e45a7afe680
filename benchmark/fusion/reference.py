"""Tracking against a model: each frame is fused at its estimated pose, and the next one is aligned
against a raycast of the surface.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

from ..odometry.levels import PyramidOdometer, pyramid
from ..odometry.protocol import Frame, Odometer, OdometryResult
from ..odometry.references import MODELS, REFERENCES, KeyframeReference, Reference, reference
from ..odometry.references import View as ReferenceView
from ..odometry.watch import rotated
from .settings import PRESETS as VOLUMES
from .settings import VolumeSettings
from .volume import RaycastView, Volume

#: Names that `make_reference` accepts.
NAMES = ("default", *REFERENCES, *MODELS)


@dataclass(frozen=True)
class ModelSettings:
    """every: number of frames from one fusion and raycast to the next; in between the view and its
    pose do not change. The view is used for up to max_age frames while the standard deviation of
    the motion is at most max_sigma_m, and the camera has rotated by less than max_deg since.
    """

    volume: VolumeSettings
    every: int = 1
    max_age: int = 1
    max_sigma_m: float = 0.0002
    max_deg: float = 8.0


PRESETS = {
    "paper": ModelSettings(VOLUMES["paper"]),
    # slanted=4 makes a surface more complete, but did not improve tracking on 90 frames of clean
    # kt2
    "best": ModelSettings(replace(VOLUMES["best"], slanted=1), every=3, max_age=6),
}


def make_reference(
    name: str, odometer: Odometer, camera: PinholeCamera, preset: str = "best"
) -> Reference:
    """A new Reference by name: "default" (the one that the odometer declares), one of REFERENCES,
    or of MODELS.

    Raises InputError for another name.
    """
    if name not in NAMES:
        raise InputError(f"a reference ({', '.join(NAMES)})", found=name)
    if name in MODELS:
        return ModelReference(odometer, camera, preset, ahead=name == "model-ahead")
    return reference(odometer.reference if name == "default" else name)


class ModelReference(Reference):
    """A Reference whose view is a raycast of the fused model, or a keyframe where the raycast does
    not determine the motion to max_sigma_m.

    A raycast has fewer pixels than a frame, and no sharp edges. So it can leave a motion open that
    the frames themselves determine, along a bare wall with a narrow frame or leaf, and frames fused
    meanwhile would move the model along. After a motion that is less certain, the view is a
    keyframe until the next keyframe is chosen, at another place. An odometer without a noise model
    does not know it, and keeps the model.

    ahead: the window is before the camera instead of around it. An odometer gets a Frame of the
    whole image; a PyramidOdometer only the levels that it reads, with the normals of the model.
    Raises InputError for an unknown preset.
    """

    def __init__(
        self, odometer: Odometer, camera: PinholeCamera, preset: str = "best", ahead: bool = False
    ) -> None:
        if preset not in PRESETS:
            raise InputError(f"a preset of the model ({', '.join(PRESETS)})", found=preset)
        self.settings = PRESETS[preset]
        self.odometer = odometer
        self.camera = camera
        geometry_alone = isinstance(odometer, PyramidOdometer) and not odometer.reads_grey
        self.volume = Volume(
            replace(
                self.settings.volume,
                channels=0 if geometry_alone else 1,
                ahead=1.0 if ahead else 0.0,
            )
        )
        self._keyframes = KeyframeReference()
        self._instead: ReferenceView | None = None  # the keyframe that is the view for now
        self._view: Any = None
        self._T_world_view = SE3.identity()
        self._age = 0

    def renew(
        self, frame: Frame, prepared: Any, T_world_camera: SE3, result: OdometryResult | None = None
    ) -> ReferenceView:
        """Fuse the frame and raycast from its pose, or keep the view."""
        keyframe = self._keyframes.renew(frame, prepared, T_world_camera, result)
        if result is not None and result.largest_sigma_m > self.settings.max_sigma_m:
            self._instead = keyframe
        if self._instead is keyframe:
            self._view = None
            return keyframe
        self._instead = None
        self._age += 1
        if self._view is None or self._outdated(T_world_camera, result):
            self.volume.integrate(frame.depth_z_m, self.camera, T_world_camera, frame.grey)
            self._view = self._rendered(frame, prepared, T_world_camera)
            self._T_world_view = T_world_camera
            self._age = 0
        return self._view, self._T_world_view

    def restart(self, frame: Frame, prepared: Any, T_world_camera: SE3) -> ReferenceView:
        """The view of the frame alone.

        It is not fused, because its pose was not measured and would corrupt the model.
        """
        self._view = None
        self._age = 0
        self._instead = None
        return self._keyframes.restart(frame, prepared, T_world_camera)

    def _outdated(self, T_world_camera: SE3, result: OdometryResult | None) -> bool:
        s = self.settings
        if not s.every <= self._age < s.max_age:
            return self._age >= s.every
        certain = result is not None and result.largest_sigma_m <= s.max_sigma_m
        return not certain or rotated(self._T_world_view, T_world_camera, s.max_deg)

    def _rendered(self, frame: Frame, prepared: Any, T_world_camera: SE3) -> Any:
        """The equivalent of prepare() for a raycast at this pose.

        Coarser levels are means of the finest one that is read.
        """
        odometer = self.odometer
        if not isinstance(odometer, PyramidOdometer):
            view = self.volume.raycast(self.camera, T_world_camera, normals=False)
            return odometer.prepare(_as_frame(view, frame.grey, frame.stamp_s), self.camera)
        finest = min(odometer.finest, len(prepared) - 1)
        first = prepared[finest]
        view = self.volume.raycast(
            first.camera, T_world_camera, odometer.reads_normals, odometer.reads_grey
        )
        rendered = _as_frame(view, first.grey, frame.stamp_s)
        views = pyramid(
            rendered, first.camera, len(prepared) - finest, normal_step=first.normal_step
        )
        levels = [replace(one, rendered=True) for one in views]
        if odometer.reads_normals:
            # normals from the gradient of the volume replace those from depth differences, which
            # are computed at first use
            vars(levels[0])["normals"] = np.nan_to_num(view.normals_camera)
        return [*prepared[:finest], *levels]


def _as_frame(view: RaycastView, grey: np.ndarray, stamp_s: float) -> Frame:
    """The view as a Frame.

    A hole in the model has no depth, and the grey values of the frame, so that it has no bright
    edge.
    """
    if view.colour.size:
        colour = view.colour[..., 0]
        grey = np.where(np.isfinite(colour), colour, grey)
    return Frame(grey, np.nan_to_num(view.depth_z_m), stamp_s)
