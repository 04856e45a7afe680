"""Accuracy, completion, F score and Depth L1 of a reconstruction, over samples uniform by area, of
the surface that a trajectory saw.

Accuracy, completion, completion ratio and Depth L1 are defined as in NICE-SLAM (Zhu et al., CVPR
2022) and Co-SLAM's evaluation (Wang et al., CVPR 2023); precision, recall and F as in Tanks and
Temples (Knapitsch et al., SIGGRAPH 2017).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from iclnuim.console import Meter, advance_of
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3, Poses
from iclnuim.raycast.caster import RayCaster
from iclnuim.raycast.distance import TriangleDistance, slabs
from iclnuim.raycast.visibility import seen_points
from iclnuim.shown import MM, Shown, plot_shares

from .samples import areas_m2, sampled, thinned, within_reach
from .settings import QualitySettings
from .surface_error import TrueSurface

if TYPE_CHECKING:
    from iclnuim.shown import Axes

#: Thresholds for precision, recall and F.
NEAR_M = (0.01, 0.02, 0.05)
#: If a smaller share of the model's samples is seen, the model is sampled again ...
_MIN_SEEN = 0.9
#: ... with more samples, up to this factor.
_MAX_FACTOR = 20


@dataclass(frozen=True, eq=False)
class SeenBy:
    """A camera (or its text) and its poses (k,) in the model's world (or matrices (k, 4, 4)): a
    reconstruction is evaluated on the surface that they see.
    """

    camera: PinholeCamera
    T_world_camera: SE3

    def __post_init__(self) -> None:
        object.__setattr__(self, "camera", PinholeCamera.of(self.camera))
        object.__setattr__(self, "T_world_camera", SE3.of(self.T_world_camera))


@dataclass(frozen=True, eq=False)
class SeenSurface:
    """The part of a model that views see; it does not depend on the reconstruction. points_m (n,
    3): samples, uniform over the seen area area_m2; the views; depth_z_m (k, h, w): depth of the
    model in each view, at a quarter of the image size.
    """

    points_m: np.ndarray
    area_m2: float
    views: SeenBy
    depth_z_m: np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class SurfaceQuality(Shown):
    """reconstruction_m (n,): distance of each sample of the reconstruction to the model. model_m
    (m,): distance of each sample of the model (with a trajectory: each seen sample) to the
    reconstruction. seen_m2: seen area of the model. depth_l1_m: None without a trajectory or faces.
    """

    reconstruction_m: np.ndarray
    model_m: np.ndarray | None = None
    seen_m2: float | None = None
    depth_l1_m: float | None = None

    @property
    def accuracy_m(self) -> float:
        """Mean distance from the reconstruction to the model."""
        return float(self.reconstruction_m.mean())

    @property
    def completion_m(self) -> float | None:
        """Mean distance from the model to the reconstruction."""
        return None if self.model_m is None else float(self.model_m.mean())

    def precision(self, near_m: float) -> float:
        """Share of the reconstruction within near_m of the model."""
        return float((self.reconstruction_m <= near_m).mean())

    def recall(self, near_m: float) -> float | None:
        """Share of the model within near_m of the reconstruction: the completion ratio."""
        return None if self.model_m is None else float((self.model_m <= near_m).mean())

    def f_score(self, near_m: float) -> float | None:
        """Harmonic mean of precision and recall."""
        precision = self.precision(near_m)
        recall = self.recall(near_m)
        return None if recall is None else 2 * precision * recall / max(precision + recall, 1e-300)

    def summary(self) -> str:
        words = [f"accuracy {MM * self.accuracy_m:.4g} mm"]
        f_score = self.f_score(NEAR_M[-1])
        if self.completion_m is not None and f_score is not None:
            words.append(f"completion {MM * self.completion_m:.4g} mm")
            words.append(f"F {f_score:.3f} at {MM * NEAR_M[-1]:g} mm")
        return ", ".join(words)

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Draw precision and recall over the distance; returns the Matplotlib axes."""
        axes = plot_shares(axes, self.reconstruction_m, "precision")
        if self.model_m is not None:
            plot_shares(axes, self.model_m, "recall")
        return axes

    def to_dict(self) -> dict[str, Any]:
        """The results as a dict, without values that are None."""
        model_m = np.zeros(0) if self.model_m is None else self.model_m
        found = {
            "accuracy_m": self.accuracy_m,
            "completion_m": self.completion_m,
            "depth_l1_m": self.depth_l1_m,
            "seen_m2": self.seen_m2,
            "precision": _at_distances(self.precision),
            "recall": _at_distances(self.recall),
            "f_score": _at_distances(self.f_score),
            "samples": len(self.reconstruction_m),
            "model_samples": len(model_m),
        }
        return {name: value for name, value in found.items() if value is not None}


def _at_distances(share: Callable[[float], float | None]) -> dict | None:
    """`{"1cm": 0.93, ...}`, None without shares."""
    if share(NEAR_M[0]) is None:
        return None
    return {f"{100 * near_m:g}cm": share(near_m) for near_m in NEAR_M}


def surface_quality(
    surface: TrueSurface,
    points: np.ndarray,
    triangles: np.ndarray,
    T_model_mesh: Poses | None = None,
    seen_by: SeenBy | SeenSurface | None = None,
    whole: bool = False,
    settings: QualitySettings | None = None,
    progress: Meter = None,
) -> SurfaceQuality:
    """Quality of a reconstruction with points (n, 3) in metres and triangles (m, 3), m = 0 for a
    cloud.

    Accuracy is the distance to the whole model, so that surfaces that no pose saw count as well.
    Completion is measured over the part of the model that `seen_by` saw, or over the whole model
    (whole), else not at all. For several reconstructions, call `what_was_seen` once and pass its
    result as `seen_by`. progress: as of render_frames(). Raises InputError if no pose sees any of
    the model, or no triangle has an area; WorkError if embreex or libigl is missing.
    """
    settings = settings or QualitySettings()
    if T_model_mesh is not None:
        points = SE3.of(T_model_mesh).apply(points)
    if isinstance(seen_by, SeenBy):
        seen_by = what_was_seen(surface, seen_by, settings, progress)
    to_samples = settings.nearest == "sample"
    is_cloud = not len(triangles)
    if is_cloud:
        samples_m = thinned(points, settings.samples, settings.seed)
    else:
        samples_m = sampled(points, triangles, settings.samples, settings.seed)
    model_m = np.zeros((0, 3))
    if to_samples or seen_by is None:
        model_m = sampled(surface.vertices, surface.triangles, settings.samples, settings.seed)
    accuracy_m = _to_points(samples_m, model_m) if to_samples else surface.distance(samples_m)
    if seen_by is not None:
        model_m = seen_by.points_m
    elif not whole:
        return SurfaceQuality(accuracy_m)
    if is_cloud:
        completion_m = _to_points(model_m, points)
    elif to_samples:
        completion_m = _to_points(model_m, samples_m)
    else:
        completion_m = TriangleDistance(points, triangles).distance(model_m)
    if seen_by is None:
        return SurfaceQuality(accuracy_m, completion_m)
    depth_l1_m = None if is_cloud else _depth_l1_m(seen_by, points, triangles, settings.far_m)
    return SurfaceQuality(accuracy_m, completion_m, seen_by.area_m2, depth_l1_m)


def what_was_seen(
    surface: TrueSurface,
    seen_by: SeenBy,
    settings: QualitySettings | None = None,
    progress: Meter = None,
) -> SeenSurface:
    """About settings.samples points, uniform over the part of the model that every
    settings.every-th pose saw.

    A first set of samples gives the seen share; if that is small, a second, larger set replaces it.
    progress: as of render_frames(). Raises InputError if nothing is seen, WorkError if
    embreex is missing.
    """
    settings = settings or QualitySettings()
    camera = seen_by.camera
    T = seen_by.T_world_camera[:: settings.every]
    # ratio of the largest distance to depth, at a corner of the image
    slant = float(np.linalg.norm(camera.rays(), axis=2).max())
    corners = surface.vertices[surface.triangles]
    corners = within_reach(corners, T.translation, slant * settings.far_m)
    places = corners.reshape(-1, 3)
    rows = np.arange(len(places)).reshape(-1, 3)
    count = settings.samples
    for attempt in range(2):
        points = sampled(places, rows, count, settings.seed) if len(rows) else places
        on_pose = advance_of(progress, len(T), "evaluate", "poses")
        seen = seen_points(surface.caster, points, camera, T, settings.far_m, on_pose)
        if not seen.any():
            raise InputError(
                "a trajectory that sees something of the model",
                found="nothing seen",
                hint="a trajectory in the model's world",
            )
        if attempt or seen.mean() > _MIN_SEEN:
            break
        count = int(min(count / seen.mean(), _MAX_FACTOR * count))
    quarter = camera.halved().halved()
    depth_z_m = np.array([surface.caster.depth(quarter, T[k]) for k in range(len(T))], np.float32)
    area_m2 = float(seen.mean() * areas_m2(places, rows).sum())
    return SeenSurface(points[seen], area_m2, SeenBy(camera, T), depth_z_m)


def _to_points(points: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(n,) distance of each point to the nearest of `others`."""
    from scipy.spatial import cKDTree

    return cKDTree(others).query(points, workers=-1)[0]


def _depth_l1_m(
    seen: SeenSurface, points: np.ndarray, triangles: np.ndarray, far_m: float
) -> float | None:
    """Mean over the views of the mean |depth of the model - depth of the reconstruction| over
    pixels where the model has depth; a hole in the reconstruction has depth 0.
    """
    camera = seen.views.camera.halved().halved()
    T = seen.views.T_world_camera
    samples_m = np.full(seen.depth_z_m.shape, np.inf, np.float32)
    for rows in slabs(points, triangles):
        part = RayCaster(points, triangles[rows])
        for k in range(len(T)):
            depth = part.depth(camera, T[k])
            samples_m[k] = np.minimum(samples_m[k], np.where(depth > 0, depth, np.inf))
    errors_m = []
    for truth, depth in zip(seen.depth_z_m, samples_m, strict=True):
        valid = (truth > 0) & (truth <= far_m)
        if valid.any():
            depth = np.where(np.isfinite(depth), depth, 0)
            errors_m.append(np.abs(truth - depth)[valid].mean())
    return float(np.mean(errors_m)) if errors_m else None
