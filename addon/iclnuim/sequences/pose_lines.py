"""Which line of a pose file belongs to which image, if the file has neither stamps nor frame
numbers (Replica, KITTI, TartanAir, Redwood): one rule.

With as many lines as images the i-th image has the i-th line. With more lines, the line is the
number of the image minus that of the first line, if the numbers tell it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..evaluation.associate import nearest
from ..geometry.se3 import SE3
from ..geometry.trajectory import (
    FIRST_STAMP_S,
    STAMP_DIGITS,
    Trajectory,
    stamps_of_frames,
)
from ..trajectory_files.source import LoadedTrajectory
from ..trajectory_files.stamps import STAMP_SLACK
from .frames import usual_step_s

#: residuals(frames (n,), readings of their poses (n,)): of each reading the relative difference
#: between depth and poses; NaN if it cannot be told.
Residuals = Callable[[np.ndarray, list[SE3]], list[float]]
#: Of two readings of the lines, one is chosen if its residual is below this share of the other's.
_CLEARLY = 0.7
#: Whole stamps are the seconds of images if this share of them lies within the images' time.
_MOST = 0.5
_HINT = "a file with stamps (TUM) or frame numbers in its first column"


@dataclass(frozen=True, eq=False)
class ImagesOfLines:
    """The images that lines are tied to, in the order of time: stamps (n,) in seconds, frame
    numbers if their names have them, and how depth agrees with poses.
    """

    stamps_s: np.ndarray
    numbers: Sequence[int] | None
    residuals: Residuals


def tied_to_images(loaded: LoadedTrajectory, images: ImagesOfLines) -> LoadedTrajectory:
    """The poses of the images, with the images' stamps. Poses without an image are left out.

    Raises InputError if the line of an image cannot be told.
    """
    count = loaded.row_count
    n = len(images.stamps_s)
    if n == count:
        return _tied(loaded, images.stamps_s, np.arange(n), "one line for each image")
    if n > count or images.numbers is None:
        raise _not_told(count, f"{n} images")
    firsts = first_numbers(images.numbers, count)
    numbers = np.array(images.numbers)
    if not firsts:
        raise _not_told(count, f"{n} images, {numbers[0]} to {numbers[-1]}")
    first = firsts[0]
    figures = ""
    if len(firsts) > 1:
        first, figures = _by_depth(loaded, images, firsts)
    sentence = f"{count} lines for {n} images: the first line is that of number {first}{figures}"
    tied = _tied(loaded, images.stamps_s, numbers - first, sentence)
    return replace(tied, by_depth=sentence if figures else "")


def tied_by_whole_stamps(loaded: LoadedTrajectory, images: ImagesOfLines) -> LoadedTrajectory:
    """The poses of the images whose numbers stand in place of stamps: whole ones, most of them
    outside the time of the images. As they are where they are stamps or other numbers.
    """
    stamps_s = loaded.trajectory.stamps_s
    first_s, last_s = images.stamps_s[0], images.stamps_s[-1]
    within = (stamps_s >= first_s) & (stamps_s <= last_s)
    if usual_step_s(images.stamps_s) >= 1 or within.mean() >= _MOST:
        return loaded
    n = len(images.stamps_s)
    if n == loaded.row_count:
        how = "they are no times of the images: one line for each image"
        return _tied(loaded, images.stamps_s, np.arange(n), how)
    numbers = np.array(images.numbers or [])
    there = np.isin(numbers, stamps_s)
    if not there.any() or not (there.all() or np.isin(stamps_s, numbers).all()):
        return loaded
    lines = loaded.rows[np.searchsorted(stamps_s, numbers[there])]
    how = "they are the numbers of the images"
    return _tied(loaded, images.stamps_s[there], lines, how)


def numbers_only_count(loaded: LoadedTrajectory, images: ImagesOfLines) -> bool:
    """Whether the frame numbers of a file are not those of the images but count its rows from 0."""
    numbers = images.numbers
    if not numbers or len(numbers) > loaded.row_count or numbers[-1] < loaded.row_count:
        return False
    of_rows_s = stamps_of_frames(loaded.rows)
    return bool(np.abs(loaded.trajectory.stamps_s - of_rows_s).max() < 1e-6)


def tied_to_poses(
    reference: LoadedTrajectory, estimate: LoadedTrajectory
) -> tuple[LoadedTrajectory, LoadedTrajectory]:
    """Reference and estimate with the stamps of the same frames, if one of them has neither stamps
    nor frame numbers: of as many rows, the i-th rows are of the same frame. An estimate whose frame
    numbers count the poses of the reference from 1 has numbers from 0.

    Raises InputError for other numbers of rows, unless the estimate has the stamps of the frames.
    """
    if estimate.is_counted:
        lines = reference.rows
        if estimate.row_count != reference.row_count:
            lines = np.arange(len(reference.trajectory))
        if estimate.row_count not in (reference.row_count, len(lines)):
            raise _not_told(estimate.row_count, f"rows of the ground truth, {reference.row_count}")
        how = "row i belongs to pose i of the ground truth"
        return reference, _tied(estimate, reference.trajectory.stamps_s, lines, how)
    if less := _less_one(reference, estimate):
        return reference, less
    if not reference.is_counted or _are_near(reference.trajectory, estimate.trajectory):
        return reference, estimate
    if estimate.row_count != reference.row_count:
        raise _not_told(reference.row_count, f"poses in the estimate, {estimate.row_count}")
    how = "row i belongs to pose i of the estimate"
    return _tied(reference, estimate.trajectory.stamps_s, estimate.rows, how), estimate


def _less_one(reference: LoadedTrajectory, estimate: LoadedTrajectory) -> LoadedTrajectory | None:
    """An estimate whose frame numbers count the poses of the reference from 1, with numbers from 0;
    None if they do not: they begin at 0 or do not end at the number of poses, or the reference does
    not have the stamps of frames from 0.
    """
    stamps_s = reference.trajectory.stamps_s
    if not estimate.is_numbered or len(stamps_s) < 2:
        return None
    step_s = (stamps_s[-1] - stamps_s[0]) / (reference.rows[-1] - reference.rows[0])
    of_rows_s = FIRST_STAMP_S + step_s * reference.rows
    own = estimate.trajectory
    numbers = (own.stamps_s - FIRST_STAMP_S) / step_s
    slack_s = STAMP_SLACK * step_s
    from_zero = np.abs(stamps_s - of_rows_s).max() <= slack_s
    to_last = abs(numbers[-1] - reference.row_count) <= STAMP_SLACK
    if not (from_zero and to_last) or numbers[0] < 1 - STAMP_SLACK:
        return None
    shifted = Trajectory(np.round(own.stamps_s - step_s, STAMP_DIGITS), own.T_world_camera)
    how = f"its numbers count the {reference.row_count} poses of the ground truth from 1"
    read_as = replace(estimate.read_as, sentence=f"{estimate.read_as.sentence}; {how}")
    return replace(estimate, trajectory=shifted, read_as=read_as)


def _are_near(reference: Trajectory, estimate: Trajectory) -> bool:
    """Whether most stamps of an estimate are those of frames of the reference."""
    slack_s = STAMP_SLACK * usual_step_s(reference.stamps_s) + 1e-6
    off_s = nearest(estimate.stamps_s, reference.stamps_s)[1]
    return bool(np.median(off_s) <= slack_s)


def first_numbers(numbers: Sequence[int], lines: int) -> list[int]:
    """The numbers that the image of the first line may have, for fewer images than lines: 0 if
    image 0 is there, 1 if the last number is that of the lines, else all with which each of the
    ascending numbers has a line: 0, 1, the first number, and that with which the last image has the
    last line.
    """
    first, last = numbers[0], numbers[-1]
    usual = [0, 1, first, last - lines + 1]
    if first == 0:
        usual = [0]
    elif last == lines:
        usual = [1]
    return sorted({k for k in usual if max(0, last - lines + 1) <= k <= first})


def _by_depth(
    loaded: LoadedTrajectory, images: ImagesOfLines, firsts: list[int]
) -> tuple[int, str]:
    """Which of the numbers of the first line agrees best with depth, and the figures."""
    numbers = np.array(images.numbers)
    lines = [numbers - first for first in firsts]
    posed = np.all([np.isin(each, loaded.rows) for each in lines], axis=0)
    frames = np.flatnonzero(posed)
    readings = [_poses_of(loaded, each[frames]) for each in lines]
    found = np.full(len(firsts), np.nan)
    if len(frames) > 1:
        found = np.array(images.residuals(frames, readings))
    figures = ", ".join(f"{100 * r:.2f} % with {k}" for k, r in zip(firsts, found, strict=True))
    order = np.argsort(found)
    best = order[0]
    if found[best] < _CLEARLY * found[order[1]]:
        return firsts[best], f", as depth differs least from poses: {figures}"
    raise InputError(
        f"images whose numbers tell the line of the first one ({' or '.join(map(str, firsts))})",
        found=f"{loaded.row_count} lines for {len(numbers)} images, {numbers[0]} to {numbers[-1]}; "
        f"depth differs from poses by {figures}",
        hint=_HINT,
    )


def _poses_of(loaded: LoadedTrajectory, lines: np.ndarray) -> SE3:
    return loaded.trajectory.T_world_camera[np.searchsorted(loaded.rows, lines)]


def _tied(
    loaded: LoadedTrajectory, stamps_s: np.ndarray, lines: np.ndarray, how: str
) -> LoadedTrajectory:
    """The poses of some lines (n,) with the stamps (n,); lines without a pose are left out."""
    there = np.isin(lines, loaded.rows)
    if not there.any():
        raise InputError("a pose for one of the images", found="none")
    trajectory = Trajectory(stamps_s[there], _poses_of(loaded, lines[there]))
    read_as = loaded.read_as
    same = len(trajectory) == len(loaded.trajectory)
    if not same or np.abs(trajectory.stamps_s - loaded.trajectory.stamps_s).max() > 1e-6:
        read_as = replace(read_as, sentence=f"{read_as.sentence}; {how}")
    tied = replace(loaded, trajectory=trajectory, read_as=read_as, rows=lines[there])
    return replace(tied, is_counted=True)


def _not_told(lines: int, others: str) -> InputError:
    expected = f"as many lines without stamps as {others}"
    return InputError(expected, found=f"{lines} lines", hint=_HINT)
