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

#: Relative residual that right poses may have: a constant, and a share of the noise of a pixel.
_EXACT = 1e-4
_NOISE_SHARE = 0.2
#: An explanation leaves a residual of at most this multiple of the noise of a pixel, or this share
#: of that as read, or something else is wrong, too.
_NOISE_LEFT = 4
_LEFT_SHARE = 0.25
#: Rounds of least squares, how many steps each of them makes at most, and the share of a step below
#: which nothing changes.
_ROUNDS = 8
_FARTHEST = 10.0
_LAST_STEP = 0.01


@dataclass(frozen=True, eq=False)
class DepthHypothesis:
    """starts (m, d): parameters from which a fit starts; steps (d,): changes of them that are small.
    change: of the poses (`of` "poses") or the pairs of images ("images"), with parameters (d,).
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

    @classmethod
    def of(cls, pairs: DepthPairs, poses: SE3) -> "PosedDepth":
        """The pairs that the poses let compare."""
        every = cls(pairs, poses, _limits(0.0, 0.0))
        known = every[np.isfinite(every.residuals)]
        return replace(known, limits=_limits(pairs.noise if len(known) else 0.0, known.residual))

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
        known = np.isfinite(self.residuals)
        return float(self.residuals[known].mean()) if known.any() else float("inf")

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
        starts = [np.concatenate(one) for one in product(*(one.starts for one in chain))]
        best = starts[0]
        if len(starts) > 1:
            best = min(starts, key=lambda x: self.after(_changes(chain, x)).residual)
        return self._refined(chain, best)

    def _refined(self, chain: Sequence[DepthHypothesis], x: np.ndarray) -> np.ndarray:
        """Parameters (d,) near x with a smaller residual, by least squares of the differences,
        weighted so that outliers count little.
        """
        steps = np.concatenate([one.steps for one in chain])
        now = self.after(_changes(chain, x))
        size = 1.0
        for _ in range(_ROUNDS if len(x) else 0):
            r = np.where(np.isfinite(now.differences), now.differences, np.nan)
            beside = [self.after(_changes(chain, x + move)) for move in np.diag(steps)]
            J = np.stack([one.differences - r for one in beside], axis=-1)
            used = np.isfinite(r) & np.isfinite(J).all(axis=-1)
            if np.count_nonzero(used) <= len(x):
                break
            r, J = r[used], J[used]
            spread = 1.5 * float(np.median(np.abs(r))) + 1e-9
            weights = 1 / np.sqrt(1 + (r / spread) ** 2)
            move = np.linalg.lstsq(weights[:, None] * J, -weights * r, rcond=1e-6)[0]
            move = size * steps * np.clip(move, -_FARTHEST, _FARTHEST)
            tried = self.after(_changes(chain, x + move))
            if tried.residual >= now.residual:
                size /= 2
                continue
            now, x = tried, x + move
            if (np.abs(move) < _LAST_STEP * steps).all():
                break
        return x


def _changes(chain: Sequence[DepthHypothesis], x: np.ndarray) -> tuple[Change, ...]:
    """The changes with the parameters of all, one after the other."""
    found = []
    for one in chain:
        found.append(one.change(x[: len(one.steps)]))
        x = x[len(one.steps) :]
    return tuple(found)


def _limits(noise: float, residual: float) -> Limits:
    right = _EXACT + _NOISE_SHARE * noise
    largest = max(_EXACT + _NOISE_LEFT * noise, _LEFT_SHARE * residual)
    return Limits(*np.array([[right], [right], [largest], [np.inf]]))
