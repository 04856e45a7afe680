"""Depth images against the poses of their frames: do they agree, and if not, which mistakes in the
poses, the camera or the depth explain both?

Residuals are relative to depth and lengths are compared as a ratio of poses to depth, so that a
smaller unit is no better by itself.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from .change import Change
from .competition import Candidate, candidate, in_common, rivals, screened, winner
from .depth_hypotheses import STILL, WHOLE, hypotheses, shifted
from .depth_pairs import DepthPairs, LoadDepth
from .posed_depth import DepthHypothesis, PosedDepth

#: Above this relative residual poses and depth do not match, whatever explains it.
MISMATCH = 0.02
#: Images tell if they agree clearly better than those of a camera that does not move would.
_CLEARLY = 1.25
#: A whole number of frames may leave so many times the residual of one beside it.
_AS_WELL = 1.1
#: Fewer pairs cannot be divided into halves.
_MIN_PAIRS = 4
#: Pairs on which chains of hypotheses are screened, with every so many-th point, and those kept;
#: these are judged on all pairs with every so many-th point.
_SCREENED_PAIRS = 8
_SCREENED_STEP = 8
_KEPT = 8
_JUDGED_STEP = 3


@dataclass(frozen=True, eq=False)
class Agreement:
    """How well poses and depth agree. residual: mean relative difference in depth between pairs of
    images with the poses as read, NaN without pairs; explained: the same with `changes`, which
    explain the images. told: whether the images move enough to tell. matches: False if poses and
    depth differ by more than sensors do. depth_m: median depth as read.
    """

    residual: float = float("nan")
    told: bool = False
    matches: bool = True
    changes: tuple[Change, ...] = ()
    explained: float = float("nan")
    depth_m: float = float("nan")

    @property
    def doubtful(self) -> bool:
        """Whether there is a reason for a warning."""
        return not self.matches or bool(self.changes)

    @property
    def kinds(self) -> list[str]:
        return [change.kind for change in self.changes]


def agreement(load: LoadDepth, T_world_camera: SE3, camera: PinholeCamera) -> Agreement:
    """Compare the depth images of n frames with their poses (n,).

    load(i): planar depth in metres, (h, w) as the camera's, 0 = missing; None if unknown. At most
    25 frames are read.
    """
    pairs = DepthPairs.of(load, T_world_camera, camera)
    given = PosedDepth.of(pairs, T_world_camera) if pairs else None
    if given is None or len(given) < _MIN_PAIRS:
        return Agreement()
    still = given.after([STILL]).residual
    told = still >= _CLEARLY * max(given.residual, float(given.limits.rounding[0]))
    found = Agreement(given.residual, told, depth_m=given.pairs.depth_m)
    if given.is_right:
        return found
    known = hypotheses(camera, given.pairs.depth_m)
    candidates = _candidates(given, known)
    best = winner(list(candidates))
    others = rivals(best, candidates) if best else [one for one in candidates if one.explains()]
    if best and others and (part := in_common([best, *others], candidates)):
        best, others = part, []
    if best is None or still < _CLEARLY * best.fit.found[0, 0]:
        return replace(found, matches=given.residual <= MISMATCH and not others)
    changes = best.changes
    if others:
        if {kind for one in (best, *others) for kind in one.kinds} != {"unit", "arm"}:
            return replace(found, matches=False)
        changes = (_either(best, others[0]),)
    elif "unit" in best.kinds:
        changes = _measured_again(given, best, candidates[best], load, camera)
    if not others:
        changes = _with_whole_frames(given, changes)
    return replace(found, told=True, changes=changes, explained=given.after(best.changes).residual)


def _with_whole_frames(given: PosedDepth, changes: tuple[Change, ...]) -> tuple[Change, ...]:
    """The changes with a shift of a number of frames, if that fits as well."""
    tried = []
    for one in changes:
        frames = one.parameters["frames"] if one.kind == "shifted" else 0.5
        whole = round(frames)
        tried.append(shifted(whole) if abs(frames - whole) < WHOLE else one)
    as_well = given.after(tried).residual <= _AS_WELL * given.after(changes).residual
    return tuple(tried) if as_well else changes


def _candidates(
    given: PosedDepth, known: Sequence[DepthHypothesis]
) -> dict[Candidate, Sequence[DepthHypothesis]]:
    """The best of all explanations with one mistake, and if they leave more than right poses do,
    of those with two, and the hypotheses of each. Where one explains nothing, two are looked for
    beyond the noise of a pixel, below which images of a real sensor leave more than ideal ones.
    """
    few = given.thinned(_SCREENED_PAIRS, _SCREENED_STEP)
    found = _judged(given, few, [(one,) for one in known])
    best = winner(list(found))
    if best is None and given.residual <= given.pairs.noise:
        return found
    if best is not None and best.fit.found[0, 0] <= given.limits.worth[0]:
        return found
    pairs = [(a, b) for a, b in combinations(known, 2) if a.group != b.group]
    both = _judged(given, few, pairs)
    parts = {one: None for chain in both.values() for one in chain}
    return found | _judged(given, few, [(one,) for one in parts]) | both


def _judged(
    given: PosedDepth, few: PosedDepth, chains: Sequence[Sequence[DepthHypothesis]]
) -> dict[Candidate, Sequence[DepthHypothesis]]:
    """Candidates of the chains that fit little evidence best."""
    best = sorted(screened(few, chains), key=lambda one: one[0])[:_KEPT]
    parts = given.thinned(len(given), _JUDGED_STEP).parts
    found = [(candidate(parts, few.started(chain)), chain) for _, chain in best]
    return {one: chain for one, chain in found if one is not None}


def _either(*both: Candidate) -> Change:
    """A unit or a lever arm: a camera that turns about a point is explained by both."""
    parameters = {name: each for one in both for name, each in one.changes[0].parameters.items()}
    return Change("either", parameters=parameters)


def _measured_again(
    given: PosedDepth,
    best: Candidate,
    chain: Sequence[DepthHypothesis],
    load: LoadDepth,
    camera: PinholeCamera,
) -> tuple[Change, ...]:
    """The same changes, fitted to pairs that are chosen by the motion in the right unit."""
    right = given.after(best.changes).poses
    if not np.isfinite(right.translation).all():
        return best.changes
    pairs = DepthPairs.of(load, right, camera)
    if pairs is None:
        return best.changes
    return PosedDepth.of(pairs, given.poses).fitted(given.started(chain))
