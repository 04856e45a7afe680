"""What a frame is aligned against: the frame before, or a keyframe; fusion/reference.py renders a
fused model.
"""

import math
from typing import Any

import numpy as np
from iclnuim.errors import InputError
from iclnuim.geometry import so3
from iclnuim.geometry.se3 import SE3

from .protocol import Frame, OdometryResult, OdometryStatus

#: Output of an odometer's prepare() for a frame, or its equivalent for a rendered model, and
#: T_world_camera of that frame.
View = tuple[Any, SE3]


class Reference:
    """Chooses the view that the next frame is aligned against. This class returns the current
    frame, subclasses an earlier one.

    tries_last: whether a frame that does not fit the view is aligned with the frame before instead.
    """

    tries_last = False

    def renew(
        self, frame: Frame, prepared: Any, T_world_camera: SE3, result: OdometryResult | None = None
    ) -> View:
        """The view after a tracked frame. prepared: output of prepare(); result: output of align(),
        None for the first frame.
        """
        return self.restart(frame, prepared, T_world_camera)

    def restart(self, frame: Frame, prepared: Any, T_world_camera: SE3) -> View:
        """The view after lost frames, at a pose that was not measured."""
        return prepared, T_world_camera


class KeyframeReference(Reference):
    """A keyframe is used while the camera is within max_m and max_deg of it: drift accumulates per
    keyframe, not per frame.

    The next keyframe is a frame from half that distance on, not the last one. The baseline is then
    never too small to separate a glass pane from the scene behind it by parallax. Errors of a
    keyframe stay. So it is a frame with the status OK, if there is one: the one that adds the
    smallest variance per distance from the keyframe before, or the first one if variances are
    unknown. Raises InputError unless both distances are positive.
    """

    def __init__(self, max_m: float = 0.2, max_deg: float = 10.0) -> None:
        if not (max_m > 0 and max_deg > 0):
            raise InputError(
                "a keyframe distance above 0 m and 0 degrees",
                found=f"{max_m:g} m, {max_deg:g} degrees",
            )
        self.max_m = max_m
        self.max_deg = max_deg
        self.keyframe: View | None = None
        self.candidate: View | None = None
        self.variance = math.inf  # the candidate's
        self.far = False  # whether the frame before was beyond the distance

    def renew(
        self, frame: Frame, prepared: Any, T_world_camera: SE3, result: OdometryResult | None = None
    ) -> View:
        if self.keyframe is None:
            return self.restart(frame, prepared, T_world_camera)
        current = (prepared, T_world_camera)
        trusted = result is None or result.status is OdometryStatus.OK
        distance = self._distance(self.keyframe, T_world_camera)
        if distance >= 1.0 and (trusted or self.far):  # a single DEGENERATE frame may be an outlier
            candidate = self.candidate
            if candidate is None or self._distance(candidate, T_world_camera) >= 1.0:
                candidate = current
            self.keyframe = candidate
            self.candidate = None
            distance = self._distance(candidate, T_world_camera)
        self.far = distance >= 1.0
        if trusted and distance >= 0.5:
            variance = result.largest_sigma_m**2 / distance if result else math.nan
            if self.candidate is None or variance < self.variance:
                self.candidate = current
                self.variance = variance
        return self.keyframe

    def restart(self, frame: Frame, prepared: Any, T_world_camera: SE3) -> View:
        self.keyframe = (prepared, T_world_camera)
        self.candidate = None
        self.far = False
        return self.keyframe

    def _distance(self, view: View, T_world_camera: SE3) -> float:
        """Distance of the camera from a view: the larger one of translation and rotation, as shares
        of max_m and max_deg.
        """
        moved_m = float(np.linalg.norm(T_world_camera.translation - view[1].translation))
        turned_deg = math.degrees(so3.angle(view[1].rotation.T @ T_world_camera.rotation))
        return max(moved_m / self.max_m, turned_deg / self.max_deg)


class MatchesReference(Reference):
    """A reference frame is used while at least `min_matches` features match (Huang 2011, section
    3.6; 150 in the authors' program).
    """

    def __init__(self, min_matches: int = 150) -> None:
        self.min_matches = min_matches
        self.view: View | None = None

    def renew(
        self, frame: Frame, prepared: Any, T_world_camera: SE3, result: OdometryResult | None = None
    ) -> View:
        if self.view is None or result is None or result.matches < self.min_matches:
            return self.restart(frame, prepared, T_world_camera)
        return self.view

    def restart(self, frame: Frame, prepared: Any, T_world_camera: SE3) -> View:
        self.view = (prepared, T_world_camera)
        return self.view


class MatchedKeyframeReference(KeyframeReference):
    """A keyframe as above, replaced by the current frame as soon as fewer than `min_share` of the
    matches of its first alignment are left: points that move differently are few between close
    frames, and may be the majority between far ones.

    0.75 is ORB-SLAM2's bound for RGB-D cameras (R. Mur-Artal, J. D. Tardos, T-RO 2017; `thRefRatio`
    in its Tracking.cc). A frame that does not fit the keyframe is aligned with the frame before, as
    in the authors' program of FOVIS; after MAX_LOST such frames in a row the current one is the
    keyframe.
    """

    tries_last = True

    def __init__(self, min_share: float = 0.75) -> None:
        super().__init__()
        self.min_share = min_share
        self.first_matches: int | None = None  # of the keyframe's first alignment

    def renew(
        self, frame: Frame, prepared: Any, T_world_camera: SE3, result: OdometryResult | None = None
    ) -> View:
        before = self.keyframe
        view = super().renew(frame, prepared, T_world_camera, result)
        if view is not before or result is None:
            self.first_matches = None
        elif self.first_matches is None:
            self.first_matches = result.matches
        elif result.matches < self.min_share * self.first_matches:
            return self.restart(frame, prepared, T_world_camera)
        return view

    def restart(self, frame: Frame, prepared: Any, T_world_camera: SE3) -> View:
        self.first_matches = None
        return super().restart(frame, prepared, T_world_camera)


class EntropyReference(KeyframeReference):
    """A keyframe is used while the ratio of the motion's entropy to that of the keyframe's first
    motion is at least min_ratio: C. Kerl, J. Sturm, D. Cremers, "Dense visual SLAM for RGB-D
    cameras", IROS 2013, section IV-B (0.91 in their program dvo_slam). The next keyframe is the
    last frame for which this was true.
    """

    def __init__(self, min_ratio: float = 0.91) -> None:
        super().__init__()
        self.min_ratio = min_ratio
        self.first_entropy = math.nan

    def renew(
        self, frame: Frame, prepared: Any, T_world_camera: SE3, result: OdometryResult | None = None
    ) -> View:
        entropy = _entropy(result)
        if self.keyframe is None or not math.isfinite(entropy):
            return self.restart(frame, prepared, T_world_camera)
        if math.isnan(self.first_entropy):
            self.first_entropy = entropy
        elif entropy / self.first_entropy < self.min_ratio:
            # both are negative if the motion is certain to millimetres
            self.keyframe = self.candidate or self.keyframe
            self.first_entropy = math.nan
        self.candidate = (prepared, T_world_camera)
        return self.keyframe

    def restart(self, frame: Frame, prepared: Any, T_world_camera: SE3) -> View:
        self.first_entropy = math.nan
        return super().restart(frame, prepared, T_world_camera)


def _entropy(result: OdometryResult | None) -> float:
    """ln of the determinant of the covariance, without the constants of a normal distribution; NaN
    without information.
    """
    if result is None or not result.residual > 0:
        return math.nan
    information = result.information
    if not math.isfinite(result.largest_sigma_m):  # without a noise model
        information = information / result.residual**2
    values = np.linalg.eigvalsh(information)
    return -float(np.log(values).sum()) if values[0] > 0 else math.nan


#: Valid values of an odometer's `reference`.
REFERENCES = {
    "frame": Reference,
    "keyframe": KeyframeReference,
    "entropy": EntropyReference,
    "matches": MatchesReference,
    "matched-keyframe": MatchedKeyframeReference,
}
#: References that fusion/reference.py makes: a fused model whose window is around the camera, and
#: one whose window is before it.
MODELS = ("model", "model-ahead")


def reference(name: str) -> Reference:
    """A new Reference by name. Raises InputError for an unknown name."""
    if name not in REFERENCES:
        raise InputError(f"a reference ({', '.join(REFERENCES)})", found=name)
    return REFERENCES[name]()
