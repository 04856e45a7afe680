"""Association of the poses of two lists by their stamps: greedy one-to-one as in the TUM tools, or
nearest.

Both take O(n log n) for any window. Stamps are in seconds and strictly increasing; for a pair
|first - (second + offset)| < max_difference.
"""

import heapq
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..geometry.se3 import read_only
from ..geometry.trajectory import Trajectory
from ..settings import Settings, setting
from ..shown import Brief

#: If a round of mutual best matches pairs fewer than 1 in this number of stamps, the heap does the
#: rest: a long chain would need one round per pair.
_SLOW_ROUND = 16
#: Two trajectories are of the same time if neither lasts this many times as long as the other.
_SAME_SPAN = 3.0


@dataclass(frozen=True)
class AssociationSettings(Settings):
    """Association of poses for comparison."""

    group = "association settings"

    method: str = setting(
        "greedy",
        "method of association",
        choices={
            "greedy": "one-to-one, closest first, as in the TUM tools",
            "nearest": "nearest ground-truth pose of each",
        },
        option="--association",
    )
    max_difference_s: float = setting(
        0.02,
        "maximum difference of the stamps of a pair",
        unit="s",
        low=1e-9,
        option="--max-difference",
    )
    offset_s: float = setting(
        0.0, "added to the stamps of the estimate", unit="s", option="--offset"
    )


@dataclass(frozen=True, eq=False, repr=False)
class Association(Brief):
    """Pairs (first[k], second[k]) of indices, (m,) each, ordered by first, then second.

    difference_s (m,): second + offset - first. first_count: the length of the first list.
    """

    first: np.ndarray
    second: np.ndarray
    difference_s: np.ndarray
    first_count: int

    def __len__(self) -> int:
        return len(self.first)

    def __post_init__(self) -> None:
        for name in ("first", "second", "difference_s"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    @property
    def coverage(self) -> float:
        """Share of the first list (the ground-truth frames) that is in a pair."""
        return len(np.unique(self.first)) / self.first_count if self.first_count else 0.0

    def closest_per_first(self) -> np.ndarray:
        """Indices k (n,) of pairs: for each first index, its pair with the smallest time
        difference.
        """
        order = np.lexsort((np.abs(self.difference_s), self.first))
        return order[np.flatnonzero(np.diff(self.first[order], prepend=-1))]


class UnpairedError(InputError):
    """Trajectories without a pair of stamps."""

    def advised(self, advice: str) -> "UnpairedError":
        """The same, with stamps that fit as its advice."""
        hint = f"a larger difference, or {advice}"
        if str(self.found).startswith("no overlap"):
            hint = f"{advice}, {_NUMBERS}"
        return UnpairedError(self.expected, found=self.found, hint=hint)


#: What to try if stamps do not overlap.
_NUMBERS = "or the format tum-ids if these are frame numbers"


def associate(
    first_s: np.ndarray, second_s: np.ndarray, settings: AssociationSettings | None = None
) -> Association:
    """Pair two lists of stamps, (n,) and (m,) in seconds, strictly increasing. The result may be
    empty.

    `greedy`: of all pairs within the window the one with the smallest difference is chosen (ties:
    smaller first, then smaller second stamp), both stamps are removed, and this is repeated, as in
    `associate.py` of the TUM RGB-D tools. `nearest`: each second stamp is paired with the nearest
    first one (ties: the smaller); a first stamp can be in several pairs.
    """
    settings = settings or AssociationSettings()
    first_s = _checked(first_s)
    second_s = _checked(second_s) + settings.offset_s
    limit_s = settings.max_difference_s
    if not (len(first_s) and len(second_s)):
        i, j = np.zeros((2, 0), int)
    elif settings.method == "greedy":
        i, j = _greedy(first_s, second_s, limit_s)
    else:
        of_second, distance_s = nearest(second_s, first_s)
        j = np.flatnonzero(distance_s < limit_s)
        i = of_second[j]
    return Association(i, j, second_s[j] - first_s[i], len(first_s))


def pair_up(
    reference: Trajectory, estimate: Trajectory, settings: AssociationSettings | None = None
) -> Association:
    """Associate by time.

    Raises InputError if the trajectories do not overlap in time, or have no pair within the window.
    """
    settings = settings or AssociationSettings()
    reference_s = reference.stamps_s
    estimate_s = estimate.stamps_s
    association = associate(reference_s, estimate_s, settings)
    if 2 * len(association) < len(estimate_s):
        _refuse_another_unit(reference_s, estimate_s)
    if len(association):
        return association
    if len(reference_s) == 0 or len(estimate_s) == 0:
        raise InputError("trajectories of at least one pose", found="an empty one")
    span = _span(reference_s)
    shifted_s = estimate_s + settings.offset_s
    if shifted_s[0] > reference_s[-1] or shifted_s[-1] < reference_s[0]:
        together_s = f"{reference_s[0] - estimate_s[0]:.6f}".rstrip("0").rstrip(".")
        hint = f"an offset of {together_s} s if both start together, {_NUMBERS}"
        expected = f"stamps that overlap the ground truth's {span}"
        raise UnpairedError(expected, found=f"no overlap in time: {_span(shifted_s)}", hint=hint)
    expected = f"stamps within {settings.max_difference_s:g} s of the ground truth's {span}"
    hint = "a larger difference, or an offset"
    raise UnpairedError(expected, found=f"none in {_span(shifted_s)}", hint=hint)


def _refuse_another_unit(reference_s: np.ndarray, estimate_s: np.ndarray) -> None:
    """Raise InputError if one list spans a thousand times as long as the other, or a power of it,
    as stamps in milliseconds, microseconds or nanoseconds do.
    """
    spans_s = [float(np.ptp(stamps_s)) for stamps_s in (reference_s, estimate_s) if len(stamps_s)]
    if len(spans_s) < 2 or min(spans_s) == 0.0:
        return
    for power, unit in enumerate(("milliseconds", "microseconds", "nanoseconds"), 1):
        factor = 1000.0**power
        for whose, ratio in (
            ("its stamps", spans_s[1] / spans_s[0]),
            ("the ground truth's stamps", spans_s[0] / spans_s[1]),
        ):
            if factor / _SAME_SPAN < ratio < factor * _SAME_SPAN:
                found = f"spans of {spans_s[1]:.4g} s and {spans_s[0]:.4g} s"
                hint = f"{whose} divided by {factor:.0f}, if they are {unit}"
                expected = "stamps in seconds of the same time as the ground truth's"
                raise InputError(expected, found=found, hint=hint)


def _span(stamps_s: np.ndarray) -> str:
    return f"{stamps_s[0]:.3f}..{stamps_s[-1]:.3f} s"


def _checked(stamps_s: np.ndarray) -> np.ndarray:
    stamps_s = np.asarray(stamps_s, float)
    if stamps_s.ndim != 1 or not np.isfinite(stamps_s).all() or (np.diff(stamps_s) <= 0).any():
        raise InputError("stamps (n,), finite and strictly increasing")
    return stamps_s


def nearest(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each x, the index of the nearest y (ties: the smaller y) and the distance. y is sorted
    and not empty.
    """
    right = np.searchsorted(y, x)
    left = np.maximum(right - 1, 0)
    right = np.minimum(right, len(y) - 1)
    to_left = np.abs(x - y[left])
    to_right = np.abs(x - y[right])
    return np.where(to_left <= to_right, left, right), np.minimum(to_left, to_right)


def _greedy(
    first_s: np.ndarray, second_s: np.ndarray, limit_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Greedy pairs in rounds of mutual best matches.

    Two free stamps that are each other's best match are a pair of the greedy order, because no pair
    that contains one of them has a smaller difference. A stamp without a free stamp in its window
    never gets a pair.
    """
    i = np.arange(len(first_s))
    j = np.arange(len(second_s))
    found: list[tuple[np.ndarray, np.ndarray]] = []
    while len(i) and len(j):
        best_j, distance_i = nearest(first_s[i], second_s[j])
        best_i, distance_j = nearest(second_s[j], first_s[i])
        chosen = np.flatnonzero((best_i[best_j] == np.arange(len(i))) & (distance_i < limit_s))
        found.append((i[chosen], j[best_j[chosen]]))
        free_i = distance_i < limit_s
        free_j = distance_j < limit_s
        free_i[chosen] = free_j[best_j[chosen]] = False
        i = i[free_i]
        j = j[free_j]
        if len(chosen) * _SLOW_ROUND < len(i):
            rest_i, rest_j = _greedy_by_heap(first_s[i], second_s[j], limit_s)
            found.append((i[rest_i], j[rest_j]))
            break
    all_i, all_j = (np.concatenate(part) for part in zip(*found, strict=True))
    order = np.argsort(all_i)
    return all_i[order], all_j[order]


def _greedy_by_heap(
    first_s: np.ndarray, second_s: np.ndarray, limit_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """The same pairs one by one: the closest free pair is adjacent in the merged list of free
    stamps.
    """
    stamps_s = np.concatenate([first_s, second_s])
    order = np.argsort(stamps_s, kind="stable")
    count = len(first_s)
    owner = order.tolist()
    stamp = stamps_s[order].tolist()
    after = list(range(1, len(owner) + 1))
    before = list(range(-1, len(owner) - 1))
    heap: list[tuple[float, int, int, int, int]] = []

    def propose(left: int, right: int) -> None:
        one = owner[left]
        other = owner[right]
        if one > other:
            one, other = other, one
        difference = stamp[right] - stamp[left]
        if one < count <= other and difference < limit_s:
            heapq.heappush(heap, (difference, one, other, left, right))

    for left in range(len(owner) - 1):
        propose(left, left + 1)
    free = [True] * len(owner)
    pairs = []
    while heap:
        _, one, other, left, right = heapq.heappop(heap)
        if not (free[left] and free[right]):
            continue
        pairs.append((one, other - count))
        free[left] = free[right] = False
        left, right = before[left], after[right]
        if left >= 0:
            after[left] = right
        if right < len(owner):
            before[right] = left
        if left >= 0 and right < len(owner):
            propose(left, right)
    i, j = np.array(pairs, int).reshape(-1, 2).T
    return i, j
