"""Labels on a reconstruction against the classes of the model, over samples uniform by area of the
surface that was seen: the figures do not depend on how finely either mesh is divided.
"""

from collections import Counter
from dataclasses import dataclass

import numpy as np
from iclnuim.errors import InputError
from iclnuim.formats.ply import MeshLabels
from iclnuim.geometry.se3 import SE3
from iclnuim.labels.classes import FIRST_OWN, OURS, ClassMap, LabelClass, class_map, read_class_map
from iclnuim.labels.errors import LabelErrors
from iclnuim.labels.scores import VOID, label_confusion, label_figures
from iclnuim.raycast.distance import TriangleDistance

from .quality import NEAR_M, SeenSurface
from .reconstruction import Reconstruction
from .samples import sampled
from .settings import QualitySettings
from .surface_error import TrueSurface

#: A sample without a part of the reconstruction within this distance has no label.
_REACH_M = NEAR_M[-1]


@dataclass(frozen=True, eq=False)
class TrueLabels:
    """Classes of a model, and the index (m,) of each triangle's."""

    kinds: tuple[LabelClass, ...]
    of_triangles: np.ndarray

    @classmethod
    def of_names(cls, names: tuple[str, ...], of_triangles: np.ndarray) -> "TrueLabels":
        """From names of classes, "" for none. Other names than ours are numbered as in frames, and
        may be NYU40 labels.
        """
        known = {kind.name: kind for kind in read_class_map(OURS).classes}
        own = sorted({name for name in names if name} - known.keys())
        known |= {name: LabelClass(k, name, name) for k, name in enumerate(own, FIRST_OWN)}
        known[""] = LabelClass(0, "")
        return cls(tuple(known[name] for name in names), of_triangles)

    @classmethod
    def of_mesh(cls, labels: MeshLabels) -> "TrueLabels":
        """From the faces of a mesh, labelled in our numbering. Raises InputError for others."""
        if not labels.of_triangles:
            raise InputError("a model with labels of its faces", found="labels of its vertices")
        table = read_class_map(OURS)
        indices = table.indices(labels.values)
        if indices.unknown:
            found = ", ".join(list(indices.unknown)[:3])
            raise InputError("a model labelled in our numbering", found=found)
        return cls((LabelClass(0, ""), *table.classes), indices.values)


def label_samples(
    surface: TrueSurface, seen: SeenSurface | None, settings: QualitySettings | None = None
) -> np.ndarray:
    """(n, 3) points, uniform by area over the part of the model that was seen, or, for None, over
    all of it.
    """
    if seen is not None:
        return seen.points_m
    settings = settings or QualitySettings()
    return sampled(surface.vertices, surface.triangles, settings.samples, settings.seed)


def surface_labels(
    surface: TrueSurface,
    truth: TrueLabels,
    mesh: Reconstruction,
    T_model_mesh: SE3,
    samples_m: np.ndarray,
    classes: str = OURS,
) -> LabelErrors:
    """Compare the labels of a reconstruction with the classes of the model at samples (n, 3) of the
    model. A sample has the label of the nearest triangle (or its nearest corner, or the nearest
    point of a cloud) within 5 cm.

    Raises InputError if the reconstruction has no labels, or no sample has a true class.
    """
    if mesh.labels is None:
        raise InputError("a reconstruction with labels", found="none")
    known = {kind.id: kind for kind in truth.kinds if kind.id}
    table = class_map(classes, ClassMap(OURS, tuple(known.values())))
    of_kinds = np.array([table.of_truth(kind) for kind in truth.kinds], np.int32)
    kinds = truth.of_triangles[surface.nearest(samples_m).triangle]
    points_m = T_model_mesh.apply(mesh.points)
    labels, distances_m = _nearest_labels(samples_m, points_m, mesh.triangles, mesh.labels)
    predicted = table.indices(labels)
    values = np.where(distances_m <= _REACH_M, predicted.values, VOID)
    without = Counter(truth.kinds[k].name for k in kinds[of_kinds[kinds] == VOID].tolist())
    without.pop("", None)
    return LabelErrors(
        table,
        label_figures(label_confusion(of_kinds[kinds], values, len(table.classes))),
        unknown=tuple(predicted.unknown.items()),
        without=tuple(without.items()),
    )


def _nearest_labels(
    samples_m: np.ndarray, points_m: np.ndarray, triangles: np.ndarray, labels: MeshLabels
) -> tuple[np.ndarray, np.ndarray]:
    """The label of each sample's nearest triangle, corner or point, and the distance."""
    if not len(triangles):
        from scipy.spatial import cKDTree

        distances_m, nearest = cKDTree(points_m).query(samples_m)
        return labels.values[nearest], distances_m
    found = TriangleDistance(points_m, triangles).nearest(samples_m)
    if labels.of_triangles:
        return labels.values[found.triangle], found.distance_m
    corners = triangles[found.triangle]
    off_m = np.linalg.norm(points_m[corners] - found.point_m[:, None], axis=2)
    nearest = np.take_along_axis(corners, off_m.argmin(axis=1)[:, None], axis=1)[:, 0]
    return labels.values[nearest], found.distance_m
