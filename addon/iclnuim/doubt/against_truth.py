"""The explanation of a bad estimate: other readings of its poses or stamps with which it fits the
ground truth much better, one or two at once.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..evaluation.align import umeyama
from ..evaluation.associate import AssociationSettings, associate
from ..geometry.trajectory import Trajectory
from .change import Change, applied
from .compared_poses import FITS_EXTENT, Comparison
from .competition import Candidate, candidate, screened, winner
from .fit import Fit
from .hypotheses import hypotheses
from .hypotheses.scale import is_drift, scaled
from .hypotheses.time import clocks, other_clocks
from .hypothesis import Files, Hypothesis, Reorder
from .no_rotations import turns
from .time_axis import OtherTime
from .time_views import Clock, Compared, View

#: A logarithm of a scale below this multiple of what is left, as a share of the extent, may be
#: noise.
_NOISE_OF_SCALE = 2.5
#: Another scale of time makes an error above this share of the ground truth's extent: below it, the
#: search would only take time.
_WORTH_SEARCH = 0.02
#: Where no mistake alone explains the error, two at once are only looked for if it is above these
#: shares of extent and motions, or that of the turns above this.
_BAD_EXTENT = 0.05
_BAD_MOTION = 0.35
_BAD_RAD = 0.05
#: Of longer estimates so many poses are compared.
_MOST_POSES = 20_000
#: Two at once are first tried on so many pairs of poses; so many of them are then compared on all.
_SCREENED_PAIRS = 80
_KEPT = 8


@dataclass(frozen=True, eq=False)
class Explanation:
    """What explains most of an estimate's error: the changes that make reference and estimate, as
    read, those given here. delta: frames between the poses of the pairs whose errors were compared.
    """

    changes: tuple[Change, ...]
    reference: Trajectory
    estimate: Trajectory
    delta: int

    @property
    def kinds(self) -> list[str]:
        return [change.kind for change in self.changes]

    @property
    def time(self) -> OtherTime | None:
        return next((change.time for change in self.changes if change.time), None)


def explain(
    reference: Trajectory,
    estimate: Trajectory,
    settings: AssociationSettings | None = None,
    *,
    how: Comparison | None = None,
    reorders: dict[str, Reorder | None] | None = None,
) -> Explanation | None:
    """What explains most of the error of an estimate; None if nothing does, or if it fits as read.

    reorders: of the quaternions of the "estimate" and the "reference"; None or nothing for a file
    of matrices.
    """
    how = how or Comparison()
    if not (turns(reference) and turns(estimate)):
        how = replace(how, positions_only=True)
    compared = Compared(reference, thinned(estimate), settings or AssociationSettings(), how)
    files = Files(reorders or {}, not how.positions_only, how.with_scale)
    best = _best(compared, hypotheses(files))
    return _explanation(compared, best, estimate) if best else None


def thinned(trajectory: Trajectory) -> Trajectory:
    """The poses that are compared."""
    return trajectory[:: -(-len(trajectory) // _MOST_POSES) or 1]


def _best(compared: Compared, known: list[Hypothesis]) -> Candidate | None:
    plain = compared.as_given()
    candidates = []
    offset_only = False
    if plain is not None:
        poses = plain.whole
        candidates += _alone(plain, known)
        offset_only = poses.errors.position_m < _WORTH_SEARCH * poses.sizes_m()[0]
    timed = _timed(compared, clocks(compared, offset_only))
    for _, view in timed:
        candidates += filter(Candidate.explains, _alone(view, []))
    is_explained = winner(candidates) is not None
    if not is_explained and plain is not None and not _is_bad(plain):
        return None
    with_rates = plain is None and not is_explained
    others = _timed(compared, other_clocks(compared, with_rates))
    for _, view in others:
        candidates += filter(Candidate.explains, _alone(view, []))
    timed += others
    candidates += _combined(plain, timed, compared, known)
    return winner(candidates)


def _timed(compared: Compared, clocks: Iterable[Clock]) -> list[tuple[Clock, View]]:
    """Clocks, and what they make of the poses, if they pair enough of them."""
    views = [(clock, compared.at(clock)) for clock in clocks]
    return [(clock, view) for clock, view in views if view is not None]


def _is_bad(plain: View) -> bool:
    """Whether the errors may be those of two mistakes."""
    extent_m, motion_m = plain.whole.sizes_m()
    limits = np.array([_BAD_EXTENT * extent_m, _BAD_MOTION * motion_m, _BAD_RAD])
    return bool((plain.whole.errors > limits).any())


def _alone(view: View, known: Sequence[Hypothesis]) -> list[Candidate]:
    """The time of a view alone, or each hypothesis alone, and with a scale."""
    if view.time is not None:
        found = [_candidate(view, ())]
    else:
        scales = [one for one in known if one.group == "scale"]
        chains: list[tuple[Hypothesis, ...]] = [(one,) for one in known]
        chains += [(one, scale) for one in known for scale in scales if one is not scale]
        found = [_candidate(view, chain) for chain in chains]
    return [one for one in found if one is not None]


def _combined(
    plain: View | None,
    timed: Iterable[tuple[Clock, View]],
    compared: Compared,
    known: Sequence[Hypothesis],
) -> Iterable[Candidate]:
    """The best of all pairs of hypotheses, one of which may be a time."""
    found: list[tuple[float, Sequence[Hypothesis], View, Clock | None]] = []
    if plain is not None:
        poses = plain.whole.thinned(_SCREENED_PAIRS)
        for first in known:
            pairs = [(first, other) for other in known if _is_pair(first, other)]
            found += [(*one, plain, None) for one in screened(poses, pairs)]
    for other, timed_view in timed:
        poses = timed_view.whole.thinned(_SCREENED_PAIRS)
        found += [(*one, timed_view, other) for one in screened(poses, [(one,) for one in known])]
    found.sort(key=lambda one: one[0])
    for _, chain, view, clock in found[:_KEPT]:
        if clock is not None:
            yield from _at_refined_time(compared, clock, view, chain)
        elif (both := _candidate(view, chain)) is not None:
            yield both
        for part in chain if len(chain) > 1 else ():
            if (one := _candidate(view, (part,))) is not None:
                yield one


def _is_pair(one: Hypothesis, other: Hypothesis) -> bool:
    """Whether both can be named, in this order: changes of different files, and a scale, can be
    made in any order.
    """
    if one.kind == other.kind or (one.of, one.group) == (other.of, other.group):
        return False
    return one.group != "scale" and (one.of, other.of) != ("estimate", "reference")


def _at_refined_time(
    compared: Compared, clock: Clock, view: View, chain: Sequence[Hypothesis]
) -> Iterable[Candidate]:
    """The candidate with its time refined after its other changes."""
    changes = view.whole.fitted(chain)
    if changes is None:
        return

    def seen(estimate: Trajectory) -> Trajectory:
        _, T = applied(changes, estimate.T_world_camera, estimate.T_world_camera)
        return Trajectory(estimate.stamps_s, T)

    again = compared.at(clock, seen)
    for one in (view, again):
        if one is not None and (found := _candidate(one, chain)) is not None:
            yield found


def _candidate(view: View, chain: Sequence[Hypothesis]) -> Candidate | None:
    before = (view.time,) if view.time else ()
    return candidate(view.found, chain, view.given, before)


def _explanation(compared: Compared, best: Candidate, estimate: Trajectory) -> Explanation | None:
    """The explanation of the whole estimate, of which some poses were compared."""
    changes = tuple(_of_all_poses(change, compared, estimate) for change in best.changes)
    if best.kinds == ["scale"]:
        scale = _scale_of_all(compared)
        if is_drift(scale) or _may_be_noise(scale, best.fit, compared):
            return None
        changes = (scaled(scale),)
    reference = compared.reference
    truth, T = applied(changes, reference.T_world_camera, estimate.T_world_camera)
    stamps_s = estimate.stamps_s
    for change in changes:
        if change.time is not None:
            stamps_s = change.time.stamps_s - compared.settings.offset_s
    reference = Trajectory(reference.stamps_s, truth)
    return Explanation(changes, reference, Trajectory(stamps_s, T), compared.how.delta)


def _of_all_poses(change: Change, compared: Compared, estimate: Trajectory) -> Change:
    """The change with the stamps of the whole estimate."""
    if change.time is None or len(estimate) == len(compared.estimate):
        return change
    axis = change.time.axis
    return replace(change, time=OtherTime(axis, axis.of(estimate.stamps_s)))


def _scale_of_all(compared: Compared) -> float:
    """The scale that an alignment by Sim(3) finds."""
    reference, estimate = compared.reference, compared.estimate
    pairs = associate(reference.stamps_s, estimate.stamps_s, compared.settings)
    x = estimate.positions_m[pairs.second]
    return umeyama(x, reference.positions_m[pairs.first], with_scale=True)[1]


def _may_be_noise(scale: float, fit: Fit, compared: Compared) -> bool:
    """Whether errors as large as those that are left can have caused the scale."""
    extent_m = fit.limits.largest[0] / FITS_EXTENT
    return bool(abs(np.log(scale)) < _NOISE_OF_SCALE * fit.found[0, 0] / extent_m)
