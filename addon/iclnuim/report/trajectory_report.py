"""Trajectory errors of two files as a report: a dictionary for JSON, a table for the terminal, rows
for CSV.

CSV of ate, one row per pair: reference_index, estimate_index, reference_stamp_s, time_difference_s,
translation_error_m, rotation_error_deg, x_m, y_m, z_m (the aligned estimate). CSV of rpe, one row
per RPE pair: start_index, end_index (in the ground truth), start_stamp_s, end_stamp_s,
translation_error_m, rotation_error_deg.
"""

import os
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from ..doubt.explained_error import ExplainedError, Settings, measured
from ..doubt.lost_track import signs_of_lost_track
from ..doubt.no_rotations import lacks_rotations
from ..errors import InputError
from ..evaluation.absolute_error import AbsoluteError, AbsoluteErrorSettings, ErrorStatistics
from ..evaluation.align import Alignment
from ..evaluation.relative_error import RelativeError
from ..evaluation.scale_drift import ScaleDrift, scale_drift
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory
from ..shown import MM
from ..trajectory_files.trajectories import LoadedTrajectory

STATISTICS = ("rmse", "mean", "median", "std", "min", "max")
ERRORS = "translation_error_m,rotation_error_deg"


@dataclass(frozen=True, eq=False)
class ComparedFile:
    """A trajectory and the name of its file; whether it is compared without its rotations, since
    all of them are the same.
    """

    path: str
    loaded: LoadedTrajectory
    same_rotations: bool = False

    def to_dict(self) -> dict:
        return {
            "path": self.path,
            "poses": len(self.loaded.trajectory),
            "read_as": self.loaded.read_as.sentence,
        }

    def from_origin_of(self, other: "ComparedFile") -> "ComparedFile":
        """The same with positions relative to those of `other`, if map coordinates of one of them
        were moved to its first position.
        """
        shift_m = np.subtract(self.loaded.read_as.shift_m, other.loaded.read_as.shift_m)
        if not shift_m.any():
            return self
        trajectory = self.loaded.trajectory
        T = trajectory.T_world_camera
        moved = Trajectory(trajectory.stamps_s, SE3(T.rotation, T.translation + shift_m))
        return replace(self, loaded=replace(self.loaded, trajectory=moved))

    def without_rotations_beside(self, other: Trajectory) -> "ComparedFile":
        """The same as a file of positions if all its rotations are the same and the other's not."""
        has_rotations = self.loaded.read_as.has_rotations
        if not (has_rotations and lacks_rotations(self.loaded.trajectory, other)):
            return self
        alone = replace(self.loaded.read_as, has_rotations=False)
        return replace(self, loaded=replace(self.loaded, read_as=alone), same_rotations=True)


def skipped(
    reference: ComparedFile, estimate: ComparedFile, seconds: float, offset_s: float = 0.0
) -> tuple[ComparedFile, ComparedFile]:
    """Both files from so many seconds after the first pose of the reference on; offset_s is added to
    the stamps of the estimate. Raises InputError if either has no poses left.
    """
    start_s = reference.loaded.trajectory.stamps_s[0] + seconds
    if not 0 <= seconds < np.inf:
        raise InputError("a time of 0 s or more", setting="skip", found=seconds)
    return _from(reference, start_s), _from(estimate, start_s - offset_s)


def _from(file: ComparedFile, start_s: float) -> ComparedFile:
    """The poses of a file from a stamp on."""
    loaded = file.loaded
    kept = np.flatnonzero(loaded.trajectory.stamps_s >= start_s - 1e-9)
    if not len(kept):
        found = f"the last at {loaded.trajectory.stamps_s[-1]:.6g} s"
        raise InputError(f"poses from {start_s:.6g} s on", path=file.path, found=found)
    rows = loaded.rows[kept] if len(loaded.rows) == len(loaded.trajectory) else loaded.rows
    return replace(file, loaded=replace(loaded, trajectory=loaded.trajectory[kept], rows=rows))


def _uncertain(alignment: Alignment) -> str:
    """The warning of an alignment whose rotation about the trajectory's line is noise."""
    extent = f"the trajectory's second extent is {1000 * alignment.extents_m[1]:.3g} mm"
    error = f"less than the error of {1000 * alignment.residual_rms_m:.3g} mm"
    return (
        f"the alignment is uncertain: {extent}, {error}, "
        "so the rotation about its line is determined by the error; "
        "compare with the alignments origin and yaw"
    )


def _as_frame_numbers(estimate: LoadedTrajectory) -> str:
    """What else to try if an estimate's stamps are whole numbers."""
    stamps_s = estimate.trajectory.stamps_s
    is_whole = bool((stamps_s == np.rint(stamps_s)).all())
    if estimate.read_as.format != "tum" or not is_whole:
        return ""
    return ", or reading it as tum-ids if its whole numbers are frame numbers"


@dataclass(frozen=True, eq=False)
class Report:
    """An ATE or an RPE, with its trajectories and settings."""

    reference: ComparedFile
    estimate: ComparedFile
    settings: Settings
    result: AbsoluteError | RelativeError
    explained: ExplainedError | None

    @classmethod
    def of(cls, reference: ComparedFile, estimate: ComparedFile, settings: Settings) -> "Report":
        """Compute the ATE or RPE that the settings define.

        Raises InputError, with the estimate's path, if the two cannot be compared.
        """
        estimate = estimate.from_origin_of(reference)
        both = reference.loaded.trajectory, estimate.loaded.trajectory
        reference, estimate = (
            reference.without_rotations_beside(both[1]),
            estimate.without_rotations_beside(both[0]),
        )
        files = reference.loaded, estimate.loaded
        positions_only = not all(file.read_as.has_rotations for file in files)
        try:
            result = measured(*both, settings, positions_only)
            if positions_only:
                unknown = np.full_like(result.rotation_error_rad, np.nan)
                result = replace(result, rotation_error_rad=unknown)
        except InputError as error:
            if error.path is not None or not estimate.path:
                raise
            refused = error.at(estimate.path)
            if refused.hint and "tum-ids" not in refused.hint:
                refused.hint += _as_frame_numbers(files[1])
            raise refused from None
        explained = ExplainedError.of(*files, settings)
        return cls(reference, estimate, settings, result, explained)

    @property
    def warnings(self) -> list[str]:
        found = [
            f"{file.path or name}: all rotations are the same, so positions alone are compared"
            for file, name in ((self.reference, "ground truth"), (self.estimate, "estimate"))
            if file.same_rotations
        ]
        if self.explained:
            formats = self.reference.loaded.read_as.format, self.estimate.loaded.read_as.format
            sentence = self.explained.sentence(*formats)
            if "rate" in self.explained.explanation.kinds:
                sentence += _as_frame_numbers(self.estimate.loaded)
            found.append(sentence)
        elif unpaired := self._unpaired():
            found.append(unpaired)
        elif isinstance(self.result, AbsoluteError) and self.result.alignment.rotation_is_noise:
            pairs = self.result.association
            poses = self.estimate.loaded.trajectory.T_world_camera[pairs.second]
            found += signs_of_lost_track(self.result.reference, poses) or [
                _uncertain(self.result.alignment)
            ]
        return found

    def _unpaired(self) -> str:
        """A warning if fewer than half of the poses that could have one have a ground-truth pose;
        empty otherwise.
        """
        both = [file.loaded.trajectory.stamps_s for file in (self.reference, self.estimate)]
        both[1] = both[1] + self.settings.association.offset_s
        span_s = max(stamps_s[0] for stamps_s in both), min(stamps_s[-1] for stamps_s in both)
        inside = [np.count_nonzero(np.clip(stamps_s, *span_s) == stamps_s) for stamps_s in both]
        pairs = len(self.result.association)
        if 2 * pairs >= min(inside):
            return ""
        window = f"{self.settings.association.max_difference_s:g} s"
        text = f"only {pairs} of the estimate's {len(both[1])} poses have a ground-truth pose"
        numbers = _as_frame_numbers(self.estimate.loaded)
        return f"{text} within {window}; try a larger difference or offset{numbers}"

    def to_dict(self) -> dict:
        result = self.result
        settings = asdict(self.settings)
        before: dict = {}
        after: dict = {}
        if isinstance(result, AbsoluteError):
            after = {
                **result.completeness.to_dict(),
                "alignment": _alignment_figures(result.alignment) | _drift_figures(result),
            }
        else:
            rest = {key: settings.pop(key) for key in ("association", "correct_scale")}
            settings = {"rpe_pairs": settings, **rest}
            coverage = result.association.coverage
            before = {"coverage": coverage, "rpe_pairs": len(result.start), "scale": result.scale}
        mirror = result.mirror
        explained: dict = {"explanations": [], "explained_error": None}
        if self.explained:
            explained = self.explained.to_dict()
        return {
            "metric": "ate" if after else "rpe",
            "reference": self.reference.to_dict(),
            "estimate": self.estimate.to_dict(),
            "settings": settings,
            "pairs": len(result.stamps_s),
            "largest_difference_s": float(np.abs(result.association.difference_s).max()),
            **before,
            "translation_error_m": result.translation_m.to_dict(),
            "rotation_error_deg": self._rotation_deg(),
            **self._tilt_deg(),
            **after,
            "mirror": {
                "mirrored": mirror.mirrored,
                "rotation_rms_m": mirror.rotation_rms_m,
                "reflection_rms_m": mirror.reflection_rms_m,
            },
            **explained,
            "warnings": self.warnings,
        }

    def _rotation_deg(self) -> dict | None:
        """The statistics of the rotation errors, None without rotations."""
        if np.isnan(self.result.rotation_error_rad).any():
            return None
        return self.result.rotation_deg.to_dict()

    def _tilt_deg(self) -> dict[str, Any]:
        """The statistics of the angles between the upward directions, of an alignment by yaw that
        leaves them; {} without rotations.
        """
        result = self.result
        is_yaw = isinstance(self.settings, AbsoluteErrorSettings) and (
            self.settings.alignment.method == "yaw"
        )
        if not is_yaw or self._rotation_deg() is None:
            return {}
        assert isinstance(result, AbsoluteError) and isinstance(
            self.settings, AbsoluteErrorSettings
        )
        angles = result.tilt_error_rad(self.settings.alignment.up)
        return {"tilt_error_deg": ErrorStatistics.of(angles, 180 / np.pi).to_dict()}

    def csv(self) -> str:
        result = self.result
        pairs = self.result.association
        errors = [result.translation_error_m, np.degrees(result.rotation_error_rad)]
        if isinstance(result, AbsoluteError):
            header = "reference_index,estimate_index,reference_stamp_s,time_difference_s,"
            header += ERRORS + ",x_m,y_m,z_m"
            index = [pairs.first, pairs.second]
            numbers = [result.stamps_s, pairs.difference_s, *errors, *result.aligned.translation.T]
        else:
            header = "start_index,end_index,start_stamp_s,end_stamp_s," + ERRORS
            index = [pairs.first[result.start], pairs.first[result.end]]
            numbers = [result.stamps_s[result.start], result.stamps_s[result.end], *errors]
        line = ",".join(["%d"] * len(index) + ["%.9f"] * len(numbers)) + "\n"
        rows = zip(*(column.tolist() for column in (*index, *numbers)), strict=True)
        return header + "\n" + "".join([line % row for row in rows])


def _alignment_figures(alignment: Alignment) -> dict:
    return {
        "scale": alignment.scale,
        "translation_m": alignment.T_reference_estimate.translation.tolist(),
        "quat_xyzw": alignment.T_reference_estimate.quat_xyzw.tolist(),
        "poses_used": alignment.poses_used,
        "extents_m": alignment.extents_m.tolist(),
        "residual_rms_m": alignment.residual_rms_m,
    }


def _drift_figures(result: AbsoluteError) -> dict:
    """The scales along the path, where the alignment has one."""
    scale = result.alignment.scale
    if result.alignment.method != "sim3" or not scale:
        return {}
    drift = scale_drift(result.reference.translation, result.aligned.translation / scale)
    return {} if drift is None else {"scales": list(drift.scales), "scale_change": drift.change}


def error_text(values: dict) -> str:
    """The text for the terminal, from an `ate` or `rpe` dictionary of to_dict()."""
    lines = [title(values), f"{'':16}" + "".join(f"{name:>11}" for name in STATISTICS)]
    rows = (
        ("translation (mm)", "translation_error_m", MM),
        ("rotation (deg)", "rotation_error_deg", 1.0),
        ("tilt (deg)", "tilt_error_deg", 1.0),
    )
    for label, key, factor in rows:
        if key not in values:
            continue
        if values[key] is None:
            lines.append(f"{label:16} none: positions alone")
            continue
        cells = [significant(factor * values[key][name]) for name in STATISTICS]
        lines.append(f"{label:16}" + "".join(f"{cell:>11}" for cell in cells))
    truth = f"{values['reference']['poses']} ground-truth"
    poses = f"{truth} and {values['estimate']['poses']} estimated poses"
    apart = f"stamps at most {1000 * values['largest_difference_s']:.3f} ms apart"
    pairs = f"{values['pairs']} pairs of {poses}, {apart}"
    if values["metric"] == "rpe":
        lines.append(f"{values['rpe_pairs']} RPE pairs; {pairs}")
    else:
        shares = [f"{100 * values['coverage']:.1f} % have an estimate"]
        for bound, share in values["recall"].items():
            shares.append(f"{100 * share:.1f} % within {bound.replace('cm', ' cm')}")
        lines += [pairs, f"of all ground-truth frames: {', '.join(shares)}"]
        lines.append(f"area under the error curve to 10 cm: {values['area_under_curve']:.4f}")
    if scales := values.get("alignment", {}).get("scales"):
        lines.append(f"scale: changes by {ScaleDrift(tuple(scales))}")
    lines += [f"warning: {text}" for text in values["warnings"]]
    return "\n".join(lines)


def significant(value: float) -> str:
    """The value with four significant digits, or in whole units from 1000 to ten million on."""
    return f"{value:.0f}" if 1e3 <= abs(value) < 1e7 else f"{value:#.4g}".removesuffix(".")


def title(values: dict) -> str:
    """One line: the metric, the two files, and the settings."""
    reference = os.path.basename(os.path.normpath(values["reference"]["path"]))
    estimate = os.path.basename(os.path.normpath(values["estimate"]["path"]))
    describe = _rpe_settings if values["metric"] == "rpe" else _ate_settings
    return f"{values['metric'].upper()} of {estimate} against {reference}, {describe(values)}"


def _rpe_settings(values: dict) -> str:
    pairs = values["settings"]["rpe_pairs"]
    unit = {"frames": "frames", "seconds": "s", "metres": "m"}[pairs["unit"]]
    if unit == "frames" and pairs["delta"] <= 1:
        unit = "frame"
    which = "all pairs" if pairs["all_pairs"] else "end to end"
    text = f"over {pairs['delta']:g} {unit}, {which}"
    if values["settings"]["correct_scale"]:
        text += f", scale {values['scale']:.6g}"
    return text


def _ate_settings(values: dict) -> str:
    method = values["settings"]["alignment"]["method"]
    if method == "none":
        return "not aligned"
    if method == "sim3":
        return f"aligned by sim3, scale {values['alignment']['scale']:.6g}"
    return f"aligned by {method}"
