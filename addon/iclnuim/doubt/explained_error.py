"""The explanation of a bad estimate (doubt/explanation.py) in the figures of the measure that
was asked for, and as a warning that says what to try.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from ..errors import InputError
from ..evaluation.absolute_error import AbsoluteError, AbsoluteErrorSettings, absolute_error
from ..evaluation.associate import associate, pair_up
from ..evaluation.compared_poses import Comparison
from ..evaluation.relative_error import RelativeError, RelativeErrorSettings, relative_error
from ..geometry import axes
from ..geometry.scene_axes import UNITS_M, unit_name
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory
from ..trajectory_files.trajectories import FORMATS, LoadedTrajectory
from .constant_transform import rotation_name
from .explanation import Explanation, explain, is_drift
from .fit import WORTH_SHARE
from .readings import Reorder

Settings: TypeAlias = AbsoluteErrorSettings | RelativeErrorSettings
#: Length in metres of the units that are named, and within which share of a scale.
_NAMED_M = {unit_name(UNITS_M[unit]): UNITS_M[unit] for unit in ("mm", "cm", "in", "ft")}
_NAMED_M["kilometres"] = 1e3
_NAMED_WITHIN = 0.01
_SUBJECTS = {"estimate": "the estimate", "reference": "the ground truth"}
_UNDONE: dict[Callable[[SE3], SE3] | None, Callable[[SE3], SE3]] = {
    None: lambda poses: poses,
    SE3.inverse: SE3.inverse,
    axes.mirrored_y: axes.mirrored_y,
    axes.world_cv_from_ned: axes.ned_from_world_cv,
}


def measured(
    reference: Trajectory, estimate: Trajectory, settings: Settings
) -> AbsoluteError | RelativeError:
    measure: Any = absolute_error if isinstance(settings, AbsoluteErrorSettings) else relative_error
    return measure(reference, estimate, settings)


@dataclass(frozen=True, eq=False)
class ExplainedError:
    """An explanation, and the errors as given and as explained, of the same poses: of the measure
    that was asked for, and of the one that shows the difference (`shown`, with its name).
    """

    explanation: Explanation
    given: AbsoluteError | RelativeError
    found: AbsoluteError | RelativeError
    shown: tuple[str, float, float]

    @classmethod
    def of(
        cls, reference: LoadedTrajectory, estimate: LoadedTrajectory, settings: Settings
    ) -> "ExplainedError | None":
        """What explains the error of two files; None if nothing does, or if it is as it should
        be.
        """
        reorders = {"reference": _reorder(reference), "estimate": _reorder(estimate)}
        both = reference.trajectory, estimate.trajectory
        positions_only = not (reference.read_as.has_rotations and estimate.read_as.has_rotations)
        return cls.of_trajectories(
            *both, settings, reorders=reorders, positions_only=positions_only
        )

    @classmethod
    def of_trajectories(
        cls,
        reference: Trajectory,
        estimate: Trajectory,
        settings: Settings,
        *,
        reorders: dict[str, Reorder | None] | None = None,
        positions_only: bool = False,
    ) -> "ExplainedError | None":
        """The same for trajectories; reorders: of the quaternions of their files, if they have
        some.
        """
        how = _comparison(settings, positions_only)
        explanation = explain(reference, estimate, settings.association, how=how, reorders=reorders)
        if explanation is None:
            return None
        try:
            return cls._measured(reference, estimate, explanation, settings)
        except InputError:
            return None

    @classmethod
    def _measured(
        cls,
        reference: Trajectory,
        estimate: Trajectory,
        explanation: Explanation,
        settings: Settings,
    ) -> "ExplainedError":
        paired = pair_up(explanation.reference, explanation.estimate, settings.association)
        rows = np.unique(paired.second)
        as_given = reference, estimate[rows]
        if len(associate(reference.stamps_s, as_given[1].stamps_s, settings.association)) < 3:
            as_given = reference, estimate
        explained = explanation.reference, explanation.estimate[rows]
        given = measured(*as_given, settings)
        found = measured(*explained, settings)
        shown = _name(settings), given.translation_m.rmse, found.translation_m.rmse
        if shown[2] > WORTH_SHARE * shown[1]:
            other = _other(settings, explanation.delta)
            given_m = measured(*as_given, other).translation_m.rmse
            found_m = measured(*explained, other).translation_m.rmse
            shown = _name(other), given_m, found_m
        return cls(explanation, given, found, shown)

    def to_dict(self) -> dict[str, Any]:
        """The explanations, and the error of the compared poses with all of them and as read."""
        error = {
            "rmse_m": self.found.translation_m.rmse,
            "rotation_rmse_deg": self.found.rotation_deg.rmse,
            "as_read_rmse_m": self.given.translation_m.rmse,
            "as_read_rotation_rmse_deg": self.given.rotation_deg.rmse,
        }
        return {"explanations": [self.explanation.to_dict()], "explained_error": error}

    def sentence(self, reference_format: str = "", estimate_format: str = "") -> str:
        """A warning with both figures and what to try."""
        format = estimate_format if self.explanation.change.of == "estimate" else reference_format
        what, why = _words(self.explanation, format)
        name, given_m, found_m = self.shown
        figures = f"{name} {_length(found_m)} instead of {_length(given_m)}"
        scale = ""
        if self.explanation.kind != "scale" and not is_drift(self.explanation.change.scale):
            scale = f" and multiplied by {self.explanation.change.scale:.4g}"
        return f"{what}{scale}: {figures}; {why}"


def _comparison(settings: Settings, positions_only: bool) -> Comparison:
    if isinstance(settings, AbsoluteErrorSettings):
        with_scale = settings.alignment.method == "sim3"
        return Comparison(with_scale=with_scale, positions_only=positions_only)
    how = Comparison(with_scale=settings.correct_scale, positions_only=positions_only)
    return replace(how, delta=int(settings.delta)) if settings.unit == "frames" else how


def _reorder(loaded: LoadedTrajectory) -> Reorder | None:
    """The other order of the quaternions of a file, applied to its poses as they were read."""
    reader = FORMATS[loaded.read_as.format].reader
    undo = _UNDONE.get(reader.convert)
    order = reader.columns.orientation
    if len(order) != 4 or undo is None:
        return None
    redo = reader.convert or undo
    is_last = order[3] == max(order)
    shift = -1 if is_last else 1

    def other_order(poses: SE3) -> SE3:
        raw = undo(poses)
        quat_xyzw = np.roll(raw.quat_xyzw, shift, axis=-1)
        return redo(SE3.from_quat_xyzw(quat_xyzw, raw.translation))

    return Reorder("wxyz" if is_last else "xyzw", other_order)


def _name(settings: Settings) -> str:
    if isinstance(settings, AbsoluteErrorSettings):
        return "ATE"
    unit = {"frames": "frame", "seconds": "s", "metres": "m"}[settings.unit]
    if unit == "frame" and settings.delta > 1:
        unit = "frames"
    return f"RPE over {settings.delta:g} {unit}"


def _other(settings: Settings, delta: int) -> Settings:
    """The measure that was not asked for."""
    if isinstance(settings, AbsoluteErrorSettings):
        return RelativeErrorSettings(float(delta), association=settings.association)
    return AbsoluteErrorSettings(association=settings.association)


def _length(metres: float) -> str:
    if metres < 1.0:
        return f"{1000 * metres:.3g} mm"
    return f"{metres:.3g} m"


def _words(explanation: Explanation, format: str) -> tuple[str, str]:
    """What fits much better, and why it may be so, with what to try."""
    subject = _SUBJECTS[explanation.change.of]
    better = f"{subject} fits much better"
    kind = explanation.kind
    if explanation.change.time:
        return _time(explanation)
    if kind == "scale":
        return _scale(explanation)
    if kind == "mirror":
        return "the estimate is mirrored", _mirror(format)
    if kind in ("rotation", "arm", "body"):
        return _body(explanation)
    if kind == "axes":
        return _axes(explanation)
    if kind == "inverse":
        why = f"its poses may be world to camera; try {_reading(format, 'tum-inverse')}"
        return f"{better} inverted", why
    if kind == "inverse rotations":
        why = "its rotations may be world to camera, unlike its positions"
        return f"{better} with inverse rotations", f"{why}; try inverting the rotations alone"
    names = {"wxyz": ("qw qx qy qz", "first"), "xyzw": ("qx qy qz qw", "last")}
    order, place = names[kind]
    advice = _reading(format, f"tum-{kind}") if kind == "wxyz" else "reordering its columns"
    why = f"they may have the scalar {place}; try {advice}"
    return f"{better} with quaternions {order}", why


def _reading(format: str, other: str) -> str:
    return f"reading it as {other}" if format == "tum" else "converting it"


def _time(explanation: Explanation) -> tuple[str, str]:
    assert explanation.change.time is not None
    axis = explanation.change.time.axis
    if explanation.kind == "offset":
        return "another time offset fits much better", f"on the same poses; try {axis.advice}"
    if explanation.kind == "rows":
        better = "the estimate fits much better with the stamps of the ground truth, row by row"
        return better, "its stamps may be of another clock; try giving it those stamps"
    step_s = float(np.median(np.diff(explanation.estimate.stamps_s)))
    rates = f"{1 / step_s:.4g} poses a second instead of {axis.scale / step_s:.4g}"
    better = f"the estimate fits much better with its stamps {axis.scale:.4g} times as far apart"
    why = "they may be of another frame rate or unit, or count other frames"
    return f"{better} ({rates})", f"{why}; try {axis.advice}"


def _scale(explanation: Explanation) -> tuple[str, str]:
    scale = explanation.change.scale
    found = []
    for subject, factor in (("it", scale), ("the ground truth", 1 / scale)):
        for name, length_m in _NAMED_M.items():
            if abs(factor / length_m - 1) < _NAMED_WITHIN:
                found.append(f"{subject} may be in {name}")
    advice = "try converting it to metres, or correcting its scale"
    if not found:
        found.append("it may have no unit of length")
        advice = "try correcting its scale"
    better = f"the estimate fits much better multiplied by {scale:.4g}"
    return better, f"{' or '.join(found)}; {advice}"


def _mirror(format: str) -> str:
    advice = "gt.freiburg if its poses are left-handed with frame ids"
    advice += ", else making it again with fy = +480"
    if format.startswith(("gt.", "pov")):
        advice = "tum or tum-ids, since it was read as left-handed"
    return f"its poses may be left-handed; try reading it as {advice}"


def _body(explanation: Explanation) -> tuple[str, str]:
    parts = []
    if explanation.change.rotation is not None:
        parts.append(f"a constant rotation of {rotation_name(explanation.change.rotation)}")
    if explanation.change.arm_m is not None:
        arm = ", ".join(f"{value:.4g}" for value in explanation.change.arm_m)
        parts.append(f"a constant lever arm of ({arm}) m")
    why = "its poses may be of another body or other axes than the ground truth's"
    advice = "try expressing both in the same camera frame"
    better = f"the estimate fits much better with {' and '.join(parts)} on the right of its poses"
    return better, f"{why}; {advice}"


def _axes(explanation: Explanation) -> tuple[str, str]:
    assert explanation.change.rotation is not None
    turn = rotation_name(explanation.change.rotation)
    why = "its positions and its rotations, or the ground truth's, may be in worlds of other axes"
    better = f"the estimate fits much better with its positions alone turned by {turn}"
    return better, f"{why}; try converting positions and rotations together"
