"""A reconstruction against the true surface, all at once: the paper's distances, the quality over
the part that was seen, and labels.
"""

from dataclasses import dataclass
from typing import Any

from iclnuim.console import Meter
from iclnuim.geometry.se3 import SE3
from iclnuim.labels.classes import OURS
from iclnuim.labels.errors import LabelErrors
from iclnuim.shown import Shown

from .alignment import FitEffect, fit_effect
from .labels import TrueLabels, label_samples, surface_labels
from .quality import SeenBy, SurfaceQuality, surface_quality, what_was_seen
from .reconstruction import Reconstruction
from .settings import QualitySettings
from .surface_error import SurfaceError, TrueSurface


@dataclass(frozen=True, eq=False)
class Placement:
    """T_model_mesh of a reconstruction. given: without a fit; fitted: by picked points or along a
    trajectory, None without; icp: whether ICP then aligns it with the model. unit_m, model_unit_m:
    units from which the reconstruction and the model were converted to metres, for warnings.
    """

    given: SE3
    fitted: SE3 | None = None
    icp: bool = False
    unit_m: float = 1.0
    model_unit_m: float = 1.0

    def T_model_mesh(self, surface: TrueSurface, mesh: Reconstruction) -> SE3:
        """Raises InputError if ICP has surfaces that do not determine a rigid motion."""
        T = self.given if self.fitted is None else self.fitted
        return surface.aligned(mesh.points, T) if self.icp else T


@dataclass(frozen=True, eq=False, repr=False)
class SurfaceEvaluation(Shown):
    """error: distances of the vertices as in the paper. quality: over samples, with its settings.
    fit: what a fit changed, None without. labels: None if they were not requested.
    """

    error: SurfaceError
    quality: SurfaceQuality
    settings: QualitySettings
    fit: FitEffect | None = None
    labels: LabelErrors | None = None

    def summary(self) -> str:
        return f"{self.error.summary()}; {self.quality.summary()}"

    def to_dict(self) -> dict[str, Any]:
        found = self.error.to_dict()
        found["quality"] = {**self.settings.to_dict(), **self.quality.to_dict()}
        if self.fit is not None:
            found["fit"] = self.fit.to_dict()
        if self.labels is not None:
            found["labels"] = self.labels.to_dict()
        return found


def evaluate_surface(
    mesh: Reconstruction,
    surface: TrueSurface,
    placement: Placement,
    *,
    seen_by: SeenBy | None = None,
    whole: bool = False,
    settings: QualitySettings | None = None,
    labels: TrueLabels | None = None,
    classes: str = OURS,
    progress: Meter = None,
) -> SurfaceEvaluation:
    """Evaluate a reconstruction against the true surface.

    Completion is measured over the part of the model that `seen_by` saw, or over all of it
    (whole), else not at all. labels: the classes of the model, if labels are compared, which the
    reconstruction has in the numbering `classes`. progress: of what was seen, as of
    what_was_seen().

    Raises InputError if no pose sees any of the model, or there are no labels to compare, WorkError
    if embreex or libigl is missing.
    """
    settings = settings or QualitySettings()
    T_model_mesh = placement.T_model_mesh(surface, mesh)
    error = surface.error(mesh.points, T_model_mesh, placement.unit_m, placement.model_unit_m)
    fit = None
    if T_model_mesh is not placement.given:
        fit = fit_effect(surface, mesh.points, placement.given, T_model_mesh)
    seen = None
    if seen_by is not None:
        seen = what_was_seen(surface, seen_by, settings, progress)
    quality = surface_quality(
        surface,
        mesh.points,
        mesh.triangles,
        T_model_mesh=T_model_mesh,
        seen_by=seen,
        whole=whole,
        settings=settings,
    )
    found = None
    if labels is not None:
        samples_m = label_samples(surface, seen, settings)
        found = surface_labels(
            surface, labels, mesh, T_model_mesh, samples_m=samples_m, classes=classes
        )
    return SurfaceEvaluation(error, quality, settings, fit, found)
