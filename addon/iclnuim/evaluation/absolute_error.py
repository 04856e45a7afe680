"""Absolute trajectory error (ATE): the difference of each aligned estimated pose to the
ground-truth pose at the same time.

Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012, section VII; the
paper's Table II has such errors. This module also has the six statistics of any list of errors, and
the scores that include missing frames.
"""

from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..geometry import so3
from ..geometry.se3 import SE3, read_only
from ..geometry.trajectory import Trajectory
from ..shown import MM, Shown, plot_over_time
from .align import Alignment, AlignmentSettings, MirrorCheck, align, check_mirror
from .associate import Association, AssociationSettings, pair_up

if TYPE_CHECKING:
    from ..shown import Axes

#: Recall is the share of ground-truth frames within these distances; the last is also the limit of
#: the area under the error curve.
RECALL_M = (0.01, 0.05, 0.10)


@dataclass(frozen=True)
class ErrorStatistics:
    """Statistics of errors in one unit. std is the population's (divided by n), so that rmse^2 =
    mean^2 + std^2.
    """

    rmse: float
    mean: float
    median: float
    std: float
    min: float
    max: float

    @classmethod
    def of(cls, errors: np.ndarray, factor: float = 1.0) -> "ErrorStatistics":
        """Statistics of errors (n,), n >= 1, multiplied by `factor` to change their unit."""
        e = np.asarray(errors, float) * factor
        values = (np.sqrt(np.mean(e * e)), e.mean(), np.median(e), e.std(), e.min(), e.max())
        return cls(*map(float, values))

    def to_dict(self) -> dict[str, float]:
        return asdict(self)


@dataclass(frozen=True, eq=False, repr=False)
class PoseErrors(Shown):
    """Errors of m compared poses or RPE pairs: translation_error_m (m,), rotation_error_rad (m,) in
    0..pi.

    reference (n,): the associated poses of the ground truth, stamps_s (n,) their stamps. warnings:
    sentences, as those of `iclnuim evaluate`.
    """

    reference: SE3
    stamps_s: np.ndarray
    association: Association
    mirror: MirrorCheck
    translation_error_m: np.ndarray
    rotation_error_rad: np.ndarray
    warnings: tuple[str, ...] = field(default=(), kw_only=True)

    @property
    def translation_m(self) -> ErrorStatistics:
        return ErrorStatistics.of(self.translation_error_m)

    @property
    def rmse_m(self) -> float:
        """The value that papers report, in metres."""
        return self.translation_m.rmse

    @property
    def rmse_mm(self) -> float:
        """The same in millimetres."""
        return MM * self.translation_m.rmse

    @property
    def rotation_deg(self) -> ErrorStatistics:
        return ErrorStatistics.of(self.rotation_error_rad, 180 / np.pi)

    @property
    def error_stamps_s(self) -> np.ndarray:
        """(m,) stamps of the errors in seconds."""
        return self.stamps_s

    def summary(self) -> str:
        words = [f"RMSE {MM * self.translation_m.rmse:.4g} mm"]
        if self._has_rotations():
            words.append(f"{self.rotation_deg.rmse:.4g} deg")
        text = ", ".join([*words, f"{len(self.translation_error_m)} errors"])
        return "; warning: ".join([text, *self.warnings])

    def _has_rotations(self) -> bool:
        return bool(np.isfinite(self.rotation_error_rad).all())

    def to_dict(self) -> dict[str, Any]:
        """Number of associated pairs and of errors, and the six statistics of each kind, with the
        names of `iclnuim evaluate`'s JSON; rotation_error_deg is None for positions alone.
        """
        return {
            "pairs": len(self.association),
            "errors": len(self.translation_error_m),
            "translation_error_m": self.translation_m.to_dict(),
            "rotation_error_deg": self.rotation_deg.to_dict() if self._has_rotations() else None,
        }

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Draw the translation error over time, in millimetres; returns the Matplotlib axes."""
        errors_mm = MM * self.translation_error_m
        axes = plot_over_time(axes, self.error_stamps_s, errors_mm, "translation error (mm)")
        rmse_mm = MM * self.translation_m.rmse
        axes.axhline(rmse_mm, color="0.2", linestyle="--", label=f"RMSE {rmse_mm:.4g} mm")
        axes.set_ylim(bottom=0)
        axes.legend()
        return axes


@dataclass(frozen=True)
class Completeness:
    """Scores over all ground-truth frames, each 0..1. A frame without an estimate counts as missed.

    coverage: share of frames with an estimate. recall: share of frames within 1, 5 and 10 cm
    (RECALL_M). area_under_curve: mean recall over all thresholds from 0 to 10 cm, so 1 is perfect.
    An estimator that stops early keeps its ATE but has lower scores.
    """

    coverage: float
    recall: dict[float, float]
    area_under_curve: float

    @classmethod
    def of(cls, errors_m: np.ndarray, frames: int) -> "Completeness":
        """errors_m (m,): one for each frame with an estimate; frames >= m: number of all frames."""
        limit = RECALL_M[-1]
        recall = {bound: float(np.count_nonzero(errors_m <= bound)) / frames for bound in RECALL_M}
        # integral of the recall, a step function: each frame adds the interval from its error to
        # the limit
        area = float(np.maximum(0.0, 1.0 - errors_m / limit).sum()) / frames
        return cls(len(errors_m) / frames, recall, area)

    def to_dict(self) -> dict:
        recall = {f"{100 * bound:g}cm": share for bound, share in self.recall.items()}
        return {
            "coverage": self.coverage,
            "recall": recall,
            "area_under_curve": self.area_under_curve,
        }


@dataclass(frozen=True)
class AbsoluteErrorSettings:
    """Association of poses by their stamps, and alignment of the estimate with the reference."""

    association: AssociationSettings = field(default_factory=AssociationSettings)
    alignment: AlignmentSettings = field(default_factory=AlignmentSettings)


@dataclass(frozen=True, eq=False, repr=False)
class AbsoluteError(PoseErrors):
    """Errors of n pairs, with their poses: reference and aligned (n,), both in the reference's
    world; and the alignment.
    """

    aligned: SE3
    alignment: Alignment

    @property
    def completeness(self) -> Completeness:
        """Scores over all ground-truth frames; if a frame has several estimates, the closest in
        time is used.
        """
        pairs = self.association
        return Completeness.of(
            self.translation_error_m[pairs.closest_per_first()], pairs.first_count
        )

    def tilt_error_rad(self, up: str = "z") -> np.ndarray:
        """(n,) angles between the upward direction, an axis of the world, as the camera has it in
        the reference and in the estimate: what is left of a rotation once yaw is aligned.
        """
        row = "xyz".index(up)
        true, found = (poses.rotation[:, row] for poses in (self.reference, self.aligned))
        across = np.linalg.norm(np.cross(true, found), axis=1)
        return np.arctan2(across, (true * found).sum(axis=1))

    def to_dict(self) -> dict[str, Any]:
        """As of PoseErrors, with coverage, recall and the scale of the alignment."""
        more = {"scale": self.alignment.scale}
        return super().to_dict() | self.completeness.to_dict() | more


def absolute_error(
    reference: Trajectory, estimate: Trajectory, settings: AbsoluteErrorSettings | None = None
) -> AbsoluteError:
    """ATE of an estimate: |t_ref - t_est| and the angle of R_ref^T R_est after alignment.

    Raises InputError if no stamps match, or the trajectories do not determine the requested
    alignment.
    """
    settings = settings or AbsoluteErrorSettings()
    association = pair_up(reference, estimate, settings.association)
    Q = reference.T_world_camera[association.first]
    P = estimate.T_world_camera[association.second]
    alignment = align(Q, P, settings.alignment)
    aligned = alignment.apply(P)
    return AbsoluteError(
        reference=Q,
        aligned=aligned,
        stamps_s=read_only(reference.stamps_s[association.first]),
        association=association,
        alignment=alignment,
        mirror=check_mirror(Q.translation, P.translation),
        translation_error_m=read_only(np.linalg.norm(aligned.translation - Q.translation, axis=1)),
        rotation_error_rad=read_only(so3.angle(np.swapaxes(Q.rotation, -1, -2) @ aligned.rotation)),
    )
