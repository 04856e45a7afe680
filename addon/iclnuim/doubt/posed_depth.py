"""Depth images with poses as evidence: how well they agree, and the parameters of hypotheses with
which they agree best.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product

import numpy as np

from ..geometry.se3 import SE3
from .change import Change
from .depth_pairs import DepthPairs
from .fit import Limits

#: Relative residual that right poses may have: a constant, and a multiple of the noise of a pixel,
#: divided by the pixels along a side of a block, in which it averages out.
_EXACT = 1e-4
_NOISE_OF_BLOCK = 1.6
#: An explanation leaves a residual of at most this multiple of the noise of a pixel, or this share
#: of that as read, or something else is wrong, too.
_NOISE_LEFT = 4
_LEFT_SHARE = 0.25
#: At least this share of the pairs has poses: of a few of them any shift fits.
_MIN_SHARE = 0.5
#: Rounds of least squares, from how many starts the first of them, how many steps each of them
#: makes at most, and the share of a step below which nothing changes.
_ROUNDS = 8
_STARTS = 5
_FARTHEST = 10.0
_LAST_STEP = 0.01


@dataclass(frozen=True, eq=False)
class DepthHypothesis:
    """starts (m, d): parameters from which a fit starts; steps (d,): changes of them that are small.
    change: of the poses or of the pairs of images (`of` "images"), with parameters (d,).
    group: at most one of a group is named.
    """

    group: str
    change: Callable[[np.ndarray], Change]
    starts: np.ndarray = field(default_factory=lambda: np.zeros((1, 0)))
    steps: np.ndarray = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True, eq=False)
class PosedDepth:
    """Pairs of depth images, and the poses (n,) of all frames."""

    pairs: DepthPairs
    poses: SE3
    limits: Limits
    #: What was found for a chain: it is asked for once more where the chain is judged.
    _solved: dict[tuple[DepthHypothesis, ...], np.ndarray] = field(init=False, default_factory=dict)

    @classmethod
    def of(cls, pairs: DepthPairs, poses: SE3) -> "PosedDepth":
        """The pairs that the poses let compare."""
        every = cls(pairs, poses, _limits(pairs, 0.0))
        known = every[np.isfinite(every.residuals)]
        return replace(known, limits=_limits(pairs, known.residual))

    def __len__(self) -> int:
        return len(self.pairs)

    def __getitem__(self, chosen: np.ndarray | slice) -> "PosedDepth":
        return replace(self, pairs=self.pairs[chosen])

    def thinned(self, pairs: int, step: int) -> "PosedDepth":
        """About so many of the pairs, with every `step`-th of their points."""
        few = self[:: max(1, len(self) // pairs)]
        return few.after([Change("", lambda images: images.thinned(step), "images")])

    @property
    def parts(self) -> list["PosedDepth"]:
        """All, and each half."""
        return [self, self[::2], self[1::2]]

    @cached_property
    def differences(self) -> np.ndarray:
        """(p, m) relative differences in depth of the points of the pairs; see DepthStack."""
        return self.pairs.differences(self.pairs.relative(self.poses))

    @cached_property
    def residuals(self) -> np.ndarray:
        """(p,) relative residuals of the pairs; NaN where there is no pose."""
        return self.pairs.medians(self.differences)

    @property
    def residual(self) -> float:
        """The mean over the pairs; infinite without one."""
        return float(mean_residuals(self.residuals))

    @property
    def errors(self) -> Sequence[float]:
        return (self.residual,)

    @property
    def is_right(self) -> bool:
        """Whether right poses may have this residual."""
        return bool(self.residual <= self.limits.worth[0])

    def after(self, changes: Sequence[Change]) -> "PosedDepth":
        pairs = self.pairs
        poses = self.poses
        for change in changes:
            if change.of == "images":
                pairs = pairs.seen(change.apply)
            else:
                poses = change.apply(poses)
        return replace(self, pairs=pairs, poses=poses)

    def fitted(self, chain: Sequence[DepthHypothesis]) -> tuple[Change, ...]:
        """The changes of the hypotheses that leave the smallest residual."""
        return _changes(chain, self.solved(chain))

    def started(self, chain: Sequence[DepthHypothesis]) -> tuple[DepthHypothesis, ...]:
        """The hypotheses with what fits best as the only start."""
        found = []
        x = self.solved(chain)
        for one in chain:
            found.append(replace(one, starts=x[None, : len(one.steps)]))
            x = x[len(one.steps) :]
        return tuple(found)

    def solved(self, chain: Sequence[DepthHypothesis]) -> np.ndarray:
        """The parameters (d,) of all hypotheses that leave the smallest residual."""
        if (known := self._solved.get(tuple(chain))) is None:
            known = self._solved[tuple(chain)] = self._search(chain)
        return known

    def _search(self, chain: Sequence[DepthHypothesis]) -> np.ndarray:
        each = [[(x, one.change(x)) for x in one.starts] for one in chain]
        starts = [tuple(zip(*one, strict=True)) for one in product(*each)]
        values = [np.concatenate(one) for one, _ in starts]
        if len(starts) > 1:
            left = self._residuals(self._differences([changes for _, changes in starts]))
            best = np.argsort(left)[:_STARTS]
            tried = [values[row] for row in best]
            r = self._differences([starts[row][1] for row in best])
            tried += list(self._moved(chain, np.array(tried), r))
            left = self._residuals(self._differences([_changes(chain, x) for x in tried]))
            values = [tried[int(left.argmin())]]
        return self._refined(chain, values[0])

    def _refined(self, chain: Sequence[DepthHypothesis], x: np.ndarray) -> np.ndarray:
        """Parameters (d,) near x with a smaller residual."""
        if not len(x):
            return x
        steps = np.concatenate([one.steps for one in chain])
        now = self._differences([_changes(chain, x)])
        size = 1.0
        move = None
        for _ in range(_ROUNDS):
            if move is None:
                move = self._moved(chain, x[None], now)[0] - x
            if (np.abs(size * move) < _LAST_STEP * steps).all():
                break
            tried = self._differences([_changes(chain, x + size * move)])
            if self._residuals(tried) < self._residuals(now):
                now, x, move = tried, x + size * move, None
            else:
                size /= 2
        return x

    def _moved(
        self, chain: Sequence[DepthHypothesis], x: np.ndarray, differences: np.ndarray
    ) -> np.ndarray:
        """Parameters (m, d) after a step from each of x (m, d) that makes the differences (m, p, n)
        smaller: least squares, weighted so that outliers count little.
        """
        steps = np.concatenate([one.steps for one in chain])
        beside = [_changes(chain, one + move) for one in x for move in np.diag(steps)]
        shape = (len(x), len(steps), *differences.shape[1:])
        every = self._differences(beside).reshape(shape)
        return np.array(
            [
                one + steps * _step(r, others)
                for one, r, others in zip(x, differences, every, strict=True)
            ]
        )

    def _differences(self, every: Sequence[Sequence[Change]]) -> np.ndarray:
        """(m, p, n) relative differences in depth after each of m sequences of changes."""
        poses: dict[tuple[Change, ...], SE3] = {(): self.poses}

        def posed(changes: tuple[Change, ...]) -> SE3:
            if changes not in poses:
                poses[changes] = changes[-1].apply(posed(changes[:-1]))
            return poses[changes]

        rows_of: dict[tuple[Change, ...], list[int]] = {}
        for row, changes in enumerate(every):
            rows_of.setdefault(tuple(c for c in changes if c.of == "images"), []).append(row)
        found: dict[int, np.ndarray] = {}
        for of_images, rows in rows_of.items():
            pairs = self.after(of_images).pairs
            moved = [tuple(c for c in every[row] if c.of != "images") for row in rows]
            motions = [pairs.relative(posed(changes)) for changes in moved]
            found.update(zip(rows, pairs.differences_of_all(motions), strict=True))
        return np.array([found[row] for row in range(len(every))])

    def _residuals(self, differences: np.ndarray) -> np.ndarray:
        """(m,) residuals of differences (m, p, n)."""
        return mean_residuals(self.pairs.medians(differences))


def _step(r: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Steps (d,) of parameters that make differences (p, n) smallest, from those after one step of
    each (d, p, n).
    """
    r = np.where(np.isfinite(r), r, np.nan)
    J = np.moveaxis(others - r, 0, -1)
    used = np.isfinite(r) & np.isfinite(J).all(axis=-1)
    if np.count_nonzero(used) <= len(others):
        return np.zeros(len(others))
    r, J = r[used], J[used]
    spread = 1.5 * float(np.median(np.abs(r))) + 1e-9
    weights = 1 / np.sqrt(1 + (r / spread) ** 2)
    move = np.linalg.lstsq(weights[:, None] * J, -weights * r, rcond=1e-6)[0]
    return np.clip(move, -_FARTHEST, _FARTHEST)


def mean_residuals(residuals: np.ndarray) -> np.ndarray:
    """(...) the means of residuals (..., p) that are known; infinite if those are too few."""
    known = np.isfinite(residuals)
    count = known.sum(axis=-1)
    total = np.where(known, residuals, 0).sum(axis=-1)
    is_enough = count >= max(1, _MIN_SHARE * residuals.shape[-1])
    return np.where(is_enough, total / np.maximum(count, 1), np.inf)


def _changes(chain: Sequence[DepthHypothesis], x: np.ndarray) -> tuple[Change, ...]:
    """The changes with the parameters of all, one after the other."""
    found = []
    for one in chain:
        found.append(one.change(x[: len(one.steps)]))
        x = x[len(one.steps) :]
    return tuple(found)


def _limits(pairs: DepthPairs, residual: float) -> Limits:
    right = _EXACT + _NOISE_OF_BLOCK * pairs.noise / pairs.stack.size_px
    largest = max(_EXACT + _NOISE_LEFT * pairs.noise, _LEFT_SHARE * residual)
    return Limits(*np.array([[right], [right], [largest], [np.inf]]))
