"""Accuracy, completion, F score and Depth L1 of a reconstruction, over samples uniform by area, of
the surface that a trajectory saw.

Accuracy, completion, completion ratio and Depth L1 are defined as in NICE-SLAM (Zhu et al., CVPR
2022) and Co-SLAM's evaluation (Wang et al., CVPR 2023); precision, recall and F as in Tanks and
Temples (Knapitsch et al., SIGGRAPH 2017).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.raycast.caster import RayCaster, seen_points
from iclnuim.raycast.distance import TriangleDistance, slabs

from .samples import areas_m2, sampled, thinned, within_reach
from .settings import QualitySettings
from .surface_error import TrueSurface

#: Thresholds for precision, recall and F.
NEAR_M = (0.01, 0.02, 0.05)
#: If a smaller share of the model's samples is seen, the model is sampled again with more samples,
#: up to this factor.
_MIN_SEEN, _MAX_FACTOR = 0.9, 20


@dataclass(frozen=True, eq=False)
class SeenBy:
    """A camera and its poses (k,) in the model's world: a reconstruction is evaluated on the
    surface that they see.
    """

    camera: PinholeCamera
    T_world_camera: SE3


@dataclass(frozen=True, eq=False)
class Seen:
    """The part of a model that views see; it does not depend on the reconstruction. points_m (n,
    3): samples, uniform over the seen
    area area_m2; the views; depth_z_m (k, h, w): depth of the model in each view, at a quarter of
    the image size.
    """

    points_m: np.ndarray
    area_m2: float
    views: SeenBy
    depth_z_m: np.ndarray


@dataclass(frozen=True, eq=False)
class SurfaceQuality:
    """reconstruction_m (n,): distance of each sample of the reconstruction to the model. model_m
    (m,): distance of each sample of the
    model (with a trajectory: each seen sample) to the reconstruction. seen_m2: seen area of the
    model. depth_l1_m: None without a trajectory or faces.
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
        precision, recall = self.precision(near_m), self.recall(near_m)
        return None if recall is None else 2 * precision * recall / max(precision + recall, 1e-300)

    def to_dict(self) -> dict:
        """The results as a dict, without values that are None."""
        shares = {
            name: {f"{100 * d:g}cm": share(d) for d in NEAR_M}
            for name, share in (
                ("precision", self.precision),
                ("recall", self.recall),
                ("f_score", self.f_score),
            )
            if name == "precision" or self.model_m is not None
        }
        lengths = {
            name: getattr(self, name)
            for name in ("accuracy_m", "completion_m", "depth_l1_m", "seen_m2")
        }
        samples = {
            "samples": len(self.reconstruction_m),
            "model_samples": 0 if self.model_m is None else len(self.model_m),
        }
        return (
            {name: value for name, value in lengths.items() if value is not None} | shares | samples
        )


def surface_quality(
    surface: TrueSurface,
    points: np.ndarray,
    triangles: np.ndarray,
    T_model_mesh: SE3 | None = None,
    seen_by: SeenBy | Seen | None = None,
    whole: bool = False,
    settings: QualitySettings | None = None,
    on_pose: Callable[[], object] = lambda: None,
) -> SurfaceQuality:
    """Quality of a reconstruction with points (n, 3) in metres and triangles (m, 3), m = 0 for a
    cloud.

    Accuracy is the distance to the whole model, so that surfaces that no pose saw count as well.
    Completion is measured over the part of the model that `seen_by` saw, or over the whole model
    (whole), else not at all. For several reconstructions, call `what_was_seen` once and pass its
    result as `seen_by`. Raises InputError if no pose sees any of the model, or no triangle has an
    area; WorkError if embreex or libigl is missing.
    """
    settings = settings or QualitySettings()
    moved, cloud = (
        points if T_model_mesh is None else T_model_mesh.apply(points),
        not len(triangles),
    )
    spread = thinned if cloud else partial(sampled, triangles=triangles)
    samples_m, to_samples = (
        spread(moved, count=settings.samples, seed=settings.seed),
        settings.nearest == "sample",
    )
    model = np.zeros((0, 3))
    seen = (
        what_was_seen(surface, seen_by, settings, on_pose)
        if isinstance(seen_by, SeenBy)
        else seen_by
    )
    if to_samples or seen is None:
        model = sampled(surface.vertices, surface.triangles, settings.samples, settings.seed)
    accuracy_m = _to_points(samples_m, model) if to_samples else surface.distance(samples_m)
    if seen is None and not whole:
        return SurfaceQuality(accuracy_m)
    truth = model if seen is None else seen.points_m
    if cloud or to_samples:
        completion_m = _to_points(truth, moved if cloud else samples_m)
    else:
        completion_m = TriangleDistance(moved, triangles).distance(truth)
    if seen is None:
        return SurfaceQuality(accuracy_m, completion_m)
    depth_l1_m = None if cloud else _depth_l1_m(seen, moved, triangles, settings.far_m)
    return SurfaceQuality(accuracy_m, completion_m, seen.area_m2, depth_l1_m)


def what_was_seen(
    surface: TrueSurface,
    seen_by: SeenBy,
    settings: QualitySettings | None = None,
    on_pose: Callable[[], object] = lambda: None,
) -> Seen:
    """About settings.samples points, uniform over the part of the model that every
    settings.every-th pose saw.

    A first set of samples gives the seen share; if that is small, a second, larger set replaces it.
    Raises InputError if nothing is seen, WorkError if embreex is missing.
    """
    settings = settings or QualitySettings()
    camera, T = seen_by.camera, seen_by.T_world_camera[:: settings.every]
    # ratio of the largest distance to depth, at a corner of the image
    slant = float(np.linalg.norm(camera.rays(), axis=2).max())
    corners = within_reach(
        surface.vertices[surface.triangles], T.translation, slant * settings.far_m
    )
    places, rows, count = (
        corners.reshape(-1, 3),
        np.arange(3 * len(corners)).reshape(-1, 3),
        settings.samples,
    )
    for attempt in range(2):
        points = sampled(places, rows, count, settings.seed) if len(rows) else places
        seen = seen_points(surface.caster, points, camera, T, settings.far_m, on_pose)
        if not seen.any():
            hint = "a trajectory in the model's world"
            raise InputError(
                "a trajectory that sees something of the model", found="nothing seen", hint=hint
            )
        if attempt or seen.mean() > _MIN_SEEN:
            break
        count = int(min(count / seen.mean(), _MAX_FACTOR * count))
    quarter = camera.halved().halved()
    depth_z_m = np.array([surface.caster.depth(quarter, T[k]) for k in range(len(T))], np.float32)
    return Seen(
        points[seen],
        float(seen.mean() * areas_m2(places, rows).sum()),
        SeenBy(camera, T),
        depth_z_m,
    )


def _to_points(points: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(n,) distance of each point to the nearest of `others`."""
    from scipy.spatial import cKDTree

    return cKDTree(others).query(points, workers=-1)[0]


def _depth_l1_m(
    seen: Seen, points: np.ndarray, triangles: np.ndarray, far_m: float
) -> float | None:
    """Mean over the views of the mean |depth of the model - depth of the reconstruction| over
    pixels where the model has depth; a hole in
    the reconstruction has depth 0."""
    camera, T = seen.views.camera.halved().halved(), seen.views.T_world_camera
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
            errors_m.append(np.abs(truth - np.where(np.isfinite(depth), depth, 0))[valid].mean())
    return float(np.mean(errors_m)) if errors_m else None
