"""The explanation of a bad estimate (against_truth.py) in the figures of the measure that was asked
for, and as a warning that says what to try.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from ..errors import InputError
from ..evaluation.absolute_error import AbsoluteError, AbsoluteErrorSettings, absolute_error
from ..evaluation.associate import UnpairedError, associate, pair_up
from ..evaluation.relative_error import RelativeError, RelativeErrorSettings, relative_error
from ..geometry import axes
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory
from ..trajectory_files.trajectories import FORMATS, LoadedTrajectory
from .against_truth import Explanation, explain, thinned
from .compared_poses import Comparison
from .fit import WORTH_SHARE
from .hypotheses import WORDS
from .hypothesis import Reorder
from .no_rotations import positions_alone

Settings: TypeAlias = AbsoluteErrorSettings | RelativeErrorSettings
_SUBJECTS = {"estimate": "the estimate", "reference": "the ground truth"}
_UNDONE: dict[Callable[[SE3], SE3] | None, Callable[[SE3], SE3]] = {
    None: lambda poses: poses,
    SE3.inverse: SE3.inverse,
    axes.mirrored_y: axes.mirrored_y,
    axes.world_cv_from_ned: axes.ned_from_world_cv,
}


def measured(
    reference: Trajectory, estimate: Trajectory, settings: Settings, positions_only: bool = False
) -> AbsoluteError | RelativeError:
    """The error that the settings ask for. Raises InputError if it cannot be computed, with the
    stamps that fit as its advice if those do not pair.
    """
    try:
        return _measure(reference, estimate, settings, positions_only)
    except UnpairedError as error:
        explained = ExplainedError.of_trajectories(
            reference, estimate, settings, positions_only=positions_only
        )
        advice = explained.advice_of_time() if explained else ""
        if not advice:
            raise
        raise error.advised(advice) from None


@dataclass(frozen=True, eq=False)
class ExplainedError:
    """An explanation, and the errors as given and as explained, of the same poses: of the measure
    that was asked for, and of the one that shows the difference (`shown`, with its name). given is
    None if the files as given have no pairs.
    """

    explanation: Explanation
    given: AbsoluteError | RelativeError | None
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
            return cls._measured(reference, estimate, explanation, settings, positions_only)
        except InputError:
            return None

    @classmethod
    def _measured(
        cls,
        reference: Trajectory,
        estimate: Trajectory,
        explanation: Explanation,
        settings: Settings,
        positions_only: bool,
    ) -> "ExplainedError":
        estimate, mended = thinned(estimate), thinned(explanation.estimate)
        paired = pair_up(explanation.reference, mended, settings.association)
        rows = np.unique(paired.second)
        as_given = reference, estimate[rows]
        if len(associate(reference.stamps_s, as_given[1].stamps_s, settings.association)) < 3:
            as_given = reference, estimate
        explained = explanation.reference, mended[rows]
        found = _measure(*explained, settings, positions_only)
        try:
            given = _measure(*as_given, settings, positions_only)
        except InputError:
            return cls(
                explanation, None, found, (_name(settings), np.inf, found.translation_m.rmse)
            )
        shown = _name(settings), given.translation_m.rmse, found.translation_m.rmse
        if shown[2] > WORTH_SHARE * shown[1]:
            other = _other(settings, explanation.delta)
            given_m = _measure(*as_given, other, positions_only).translation_m.rmse
            found_m = _measure(*explained, other, positions_only).translation_m.rmse
            shown = _name(other), given_m, found_m
        return cls(explanation, given, found, shown)

    def to_dict(self) -> dict[str, Any]:
        """The explanations, and the error of the compared poses with all of them and as read."""
        given = self.given
        error = {
            "rmse_m": self.found.translation_m.rmse,
            "rotation_rmse_deg": self.found.rotation_deg.rmse,
            "as_read_rmse_m": given.translation_m.rmse if given else None,
            "as_read_rotation_rmse_deg": given.rotation_deg.rmse if given else None,
        }
        changes = [change.to_dict() for change in self.explanation.changes]
        return {"explanations": changes, "explained_error": error}

    def sentence(self, reference_format: str = "", estimate_format: str = "") -> str:
        """A warning with both figures and what to try."""
        formats = {"reference": reference_format, "estimate": estimate_format}
        better: dict[str, list[str]] = {}
        tries = []
        for change in self.explanation.changes:
            words = WORDS[change.kind](change, formats[change.of])
            better.setdefault(change.of, []).append(words.better)
            tries.append(f"{words.cause}; try {words.advice}")
        fits = [
            f"{_SUBJECTS[of]} fits much better {' and '.join(how)}" for of, how in better.items()
        ]
        name, given_m, found_m = self.shown
        figures = f"{name} {_length(found_m)} instead of {_length(given_m)}"
        return f"{', and '.join(fits)}: {figures}; {'; '.join(tries)}"

    def advice_of_time(self) -> str:
        """The stamps to try, and how well they fit; "" for those as given."""
        changes = self.explanation.changes
        if self.explanation.time is None:
            return ""
        name, _, found_m = self.shown
        rest = [WORDS[one.kind](one, "").better for one in changes if one.time is None]
        fit = " and ".join([f"where they fit best ({name} {_length(found_m)})", *rest])
        return f"{self.explanation.time.axis.advice} {fit}"


def _measure(
    reference: Trajectory, estimate: Trajectory, settings: Settings, positions_only: bool
) -> AbsoluteError | RelativeError:
    if isinstance(settings, AbsoluteErrorSettings):
        return absolute_error(reference, estimate, settings)
    if positions_only:
        reference, estimate = positions_alone(reference, estimate, settings.association)
    return relative_error(reference, estimate, settings)


def _comparison(settings: Settings, positions_only: bool) -> Comparison:
    if isinstance(settings, AbsoluteErrorSettings):
        with_scale = settings.alignment.method == "sim3"
        return Comparison(with_scale=with_scale, positions_only=positions_only)
    how = Comparison(with_scale=settings.correct_scale, positions_only=positions_only)
    # of pairs of less than the usual distance, noise alone would tell
    return replace(
        how, delta=max(how.delta, int(settings.delta if settings.unit == "frames" else 0))
    )


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
