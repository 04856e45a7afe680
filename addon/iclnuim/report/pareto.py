"""The Pareto front of two quantities that should both be small, such as time and error."""

from collections.abc import Sequence


def front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Indices of the points that no other point beats: none is at most as large in both quantities
    and smaller in one. Sorted by the first.
    """
    kept = [k for k, one in enumerate(points) if not any(_beats(other, one) for other in points)]
    return sorted(kept, key=lambda k: points[k])


def _beats(other: tuple[float, float], one: tuple[float, float]) -> bool:
    return other[0] <= one[0] and other[1] <= one[1] and other != one
