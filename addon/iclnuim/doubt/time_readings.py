"""Other time axes of an estimate, and how they fit: an offset, a scale (`rate`), or the stamps of
the ground truth row by row (`rows`).
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..evaluation.associate import AssociationSettings, associate, moved_onto_stamps
from ..evaluation.compared_poses import ComparedPoses, Comparison, Errors, middle_of_way
from ..evaluation.time_axis import OtherTime, TimeAxis, best_offset, best_scales, refined
from ..geometry.trajectory import Trajectory
from .fit import FITS_EXTENT, FITS_MOTION, Fit

TIME_KINDS = ("offset", "rate", "rows")
#: Another scale of time makes an error above this share of the ground truth's extent: below it, the
#: search would only take time.
_WORTH_SEARCH = 0.02
#: Pairs of poses in each half.
_MIN_PAIRS = 5
_LEAST = (2 * _MIN_PAIRS, _MIN_PAIRS, _MIN_PAIRS)


class TimeReading(NamedTuple):
    """Other stamps, the number of their fitted parameters, and their fit."""

    kind: str
    parameters: int
    time: OtherTime
    fit: Fit


def associated_poses(
    reference: Trajectory,
    estimate: Trajectory,
    settings: AssociationSettings,
    how: Comparison,
    least: int = 2 * _MIN_PAIRS,
) -> ComparedPoses | None:
    """Associated poses as they are compared; None if they make fewer than `least` pairs."""
    pairs = associate(reference.stamps_s, estimate.stamps_s, settings)
    delta = min(how.delta, max(1, len(pairs) // 4))
    if len(pairs) - delta < least:
        return None
    first = reference.T_world_camera[pairs.first]
    second = estimate.T_world_camera[pairs.second]
    return ComparedPoses.of(first, second, how, delta)


def time_readings(
    reference: Trajectory,
    estimate: Trajectory,
    settings: AssociationSettings,
    how: Comparison,
) -> Iterator[TimeReading]:
    """All of them that pair enough poses, compared on the poses that they pair: each half of the
    way with the axis that fits the other one.
    """
    plain = replace(settings, offset_s=0.0)

    def retimed(part: Trajectory, axis: TimeAxis) -> Trajectory:
        axis = moved_onto_stamps(reference.stamps_s, part.stamps_s, axis, settings)
        return Trajectory(axis.of(part.stamps_s), part.T_world_camera)

    poses = associated_poses(reference, estimate, settings, how)
    fits = poses is not None and poses.errors.position_m < _WORTH_SEARCH * poses.sizes_m()[0]
    for kind, parameters, stamped, axis in _axes(reference, estimate, settings, fits):
        axis = moved_onto_stamps(reference.stamps_s, stamped.stamps_s, axis, settings)
        whole = Trajectory(axis.of(stamped.stamps_s), stamped.T_world_camera)
        rows = np.unique(associate(reference.stamps_s, whole.stamps_s, plain).second)
        middle = middle_of_way(estimate.positions_m[rows])
        halves = rows[:middle], rows[middle:]
        parts = [whole[rows]]
        for half, other in (halves, halves[::-1]):
            crossed = refined(reference, stamped[other], axis, parameters)
            parts.append(retimed(stamped[half], crossed))
        found = []
        given = []
        for part, same, least in zip(parts, (rows, *halves), _LEAST, strict=True):
            found.append(associated_poses(reference, part, plain, how, least))
            given.append(associated_poses(reference, estimate[same], settings, how, least))
        compared = list(filter(None, found))
        if len(compared) == len(parts):
            time = OtherTime(axis, whole.stamps_s)
            yield TimeReading(kind, parameters, time, _fit(given, compared))


def _axes(
    reference: Trajectory, estimate: Trajectory, settings: AssociationSettings, offset_only: bool
) -> Iterator[tuple[str, int, Trajectory, TimeAxis]]:
    """Kinds and numbers of parameters, the estimate with the stamps that the axis is of, and the
    axis.
    """
    offset = best_offset(reference, estimate)
    if offset is not None:
        yield "offset", 1, estimate, offset
    if offset_only:
        return
    for parameters, scaled in best_scales(reference, estimate):
        yield "rate", parameters, estimate, scaled
    if len(reference) == len(estimate) and not _on_a_line(reference, estimate, settings):
        stamped = Trajectory(reference.stamps_s, estimate.T_world_camera)
        yield "rows", 0, stamped, TimeAxis(0.0)


def _on_a_line(reference: Trajectory, estimate: Trajectory, settings: AssociationSettings) -> bool:
    """Whether an offset and a scale make the stamps of the rows equal."""
    since_s = estimate.stamps_s - estimate.stamps_s[0]
    A = np.column_stack([since_s, np.ones(len(estimate))])
    line = np.linalg.lstsq(A, reference.stamps_s, rcond=None)[0]
    return bool((np.abs(A @ line - reference.stamps_s) < settings.max_difference_s).all())


def _fit(given: list[ComparedPoses | None], found: list[ComparedPoses]) -> Fit:
    """Poses in all and in each half; if those as given cannot be compared, with the errors of an
    estimate that fails.
    """
    extent_m, motion_m = found[0].sizes_m()
    failed = Errors(FITS_EXTENT * extent_m, FITS_MOTION * motion_m, np.inf)
    errors = [failed] * len(given)
    for part, poses in enumerate(given):
        if poses is not None:
            errors[part] = poses.errors
    return Fit(
        given=errors[0],
        found=found[0].errors,
        given_halves=(errors[1], errors[2]),
        found_halves=(found[1].errors, found[2].errors),
        extent_m=extent_m,
        motion_m=motion_m,
    )
