"""Trajectory errors for programs: a dictionary for JSON (error_text.py makes the table of it), rows for CSV.

JSON of `iclnuim evaluate ate --json` (lengths in metres, angles in degrees, shares 0..1):

    metric                "ate"
    reference, estimate   {path, poses, taken}: taken is a sentence on how the file was read
    settings              {association {method, max_difference_s, offset_s}, alignment {method, first, up}}
    pairs                 how many poses were compared; largest_difference_s between their stamps beside it
    translation_error_m   {rmse, mean, median, std, min, max}
    rotation_error_deg    the same six
    coverage, recall {1cm, 5cm, 10cm}, area_under_curve     over all ground-truth frames
    alignment             {scale, translation_m [3], quat_xyzw [4], poses_used, extents_m [3], residual_rms_m}
    mirror                {mirrored, rotation_rms_m, reflection_rms_m}
    warnings              list of sentences, empty when all is well

Of `iclnuim evaluate rpe --json`: metric "rpe", the same without recall, area_under_curve and alignment;
settings hold {association, stretch {delta, unit, all_pairs, tolerance, measured_on}, correct_scale}; stretches counts
them, scale is the factor applied.

CSV of ate, a row a pair: reference_index, estimate_index, reference_stamp_s, time_difference_s, translation_error_m,
rotation_error_deg, x_m, y_m, z_m (the aligned estimate). Of rpe, a row a stretch: start_index, end_index (in the
ground truth), start_stamp_s, end_stamp_s, translation_error_m, rotation_error_deg.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from ..evaluation.absolute_error import AbsoluteError, AbsoluteErrorSettings
from ..evaluation.align import Alignment, MirrorCheck
from ..evaluation.relative_error import RelativeError, RelativeErrorSettings
from ..formats.loaded import LoadedTrajectory

ERRORS = "translation_error_m,rotation_error_deg"


@dataclass(frozen=True, eq=False)
class Source:
    """A trajectory and the name of its file."""

    path: str
    loaded: LoadedTrajectory

    def to_dict(self) -> dict:
        return {"path": self.path, "poses": len(self.loaded.trajectory), "taken": self.loaded.taken.sentence}


@dataclass(frozen=True, eq=False)
class AbsoluteReport:
    """An ATE and what it was computed from."""

    reference: Source
    estimate: Source
    settings: AbsoluteErrorSettings
    result: AbsoluteError

    @property
    def warnings(self) -> list[str]:
        return [*_mirror_warning(self.result.mirror, self.estimate), *_turn_warning(self.result.alignment)]

    def to_dict(self) -> dict:
        alignment = self.result.alignment
        return {
            "metric": "ate",
            **_common(self),
            "pairs": len(self.result.stamps_s),
            "largest_difference_s": _largest_difference_s(self.result),
            **_errors(self.result),
            **self.result.completeness.to_dict(),
            "alignment": {
                "scale": alignment.scale,
                "translation_m": alignment.T_reference_estimate.translation.tolist(),
                "quat_xyzw": alignment.T_reference_estimate.quat_xyzw.tolist(),
                "poses_used": alignment.poses_used,
                "extents_m": alignment.extents_m.tolist(),
                "residual_rms_m": alignment.residual_rms_m,
            },
            **_diagnostics(self),
        }

    def csv(self) -> str:
        result, pairs = self.result, self.result.association
        header = "reference_index,estimate_index,reference_stamp_s,time_difference_s," + ERRORS + ",x_m,y_m,z_m"
        numbers = [
            result.stamps_s,
            pairs.difference_s,
            result.translation_error_m,
            np.degrees(result.rotation_error_rad),
            *result.aligned.translation.T,
        ]
        return _csv(header, [pairs.first, pairs.second], numbers)


@dataclass(frozen=True, eq=False)
class RelativeReport:
    """An RPE and what it was computed from."""

    reference: Source
    estimate: Source
    settings: RelativeErrorSettings
    result: RelativeError

    @property
    def warnings(self) -> list[str]:
        return _mirror_warning(self.result.mirror, self.estimate)

    def to_dict(self) -> dict:
        return {
            "metric": "rpe",
            **_common(self),
            "pairs": len(self.result.stamps_s),
            "largest_difference_s": _largest_difference_s(self.result),
            "coverage": self.result.association.coverage,
            "stretches": len(self.result.start),
            "scale": self.result.scale,
            **_errors(self.result),
            **_diagnostics(self),
        }

    def csv(self) -> str:
        result = self.result
        header = "start_index,end_index,start_stamp_s,end_stamp_s," + ERRORS
        index = [result.association.first[result.start], result.association.first[result.end]]
        errors = [result.translation_error_m, np.degrees(result.rotation_error_rad)]
        return _csv(header, index, [result.stamps_s[result.start], result.stamps_s[result.end], *errors])


Report = AbsoluteReport | RelativeReport


def _common(report: Report) -> dict:
    return {
        "reference": report.reference.to_dict(),
        "estimate": report.estimate.to_dict(),
        "settings": asdict(report.settings),
    }


def _errors(result: AbsoluteError | RelativeError) -> dict:
    return {
        "translation_error_m": result.translation_m.to_dict(),
        "rotation_error_deg": result.rotation_deg.to_dict(),
    }


def _diagnostics(report: Report) -> dict:
    mirror = report.result.mirror
    figures = {"rotation_rms_m": mirror.rotation_rms_m, "reflection_rms_m": mirror.reflection_rms_m}
    return {"mirror": {"mirrored": mirror.mirrored, **figures}, "warnings": report.warnings}


def _mirror_warning(mirror: MirrorCheck, estimate: Source) -> list[str]:
    if not mirror.mirrored:
        return []
    advice = "--from gt.freiburg if its poses are left-handed with frame ids, else making it again with fy = +480"
    if estimate.loaded.taken.handedness == "left":
        advice = "--from tum or --from tum-ids, since it was taken as left-handed"
    left, right = (f"{1000 * rms:.3g} mm" for rms in (mirror.reflection_rms_m, mirror.rotation_rms_m))
    return [f"the estimate is mirrored: a reflection leaves {left}, the best rotation {right}; try {advice}"]


def _turn_warning(alignment: Alignment) -> list[str]:
    if not alignment.turn_is_noise:
        return []
    extent, error = (f"{1000 * length:.3g} mm" for length in (alignment.extents_m[1], alignment.residual_rms_m))
    return [
        f"the alignment is uncertain: the path's second extent is {extent}, less than the error of {error}, "
        "so the turn about the path's line follows the error; compare with --align origin or --align yaw"
    ]


def _largest_difference_s(result: AbsoluteError | RelativeError) -> float:
    return float(np.abs(result.association.difference_s).max())


def _csv(header: str, integers: list[np.ndarray], numbers: list[np.ndarray]) -> str:
    line = ",".join(["%d"] * len(integers) + ["%.9f"] * len(numbers)) + "\n"
    rows = zip(*(column.tolist() for column in (*integers, *numbers)), strict=True)
    return header + "\n" + "".join([line % row for row in rows])
