"""Orders of equal values as in the C++ library of GCC, with which the authors' program of FOVIS is
built.

Scores of corners and numbers of consistent matches are integers, and many are equal. Which of the
equal ones come first follows from the exchanges of quicksort: with the median of three as pivot
and, for short ranges, insertion (D. Musser, 1997, "Introspective sorting and selection
algorithms").
"""

import numpy as np
from numba import njit

#: Ranges up to this length are left to insertion: in a selection, and in a complete order.
SHORT_SELECTION, SHORT = 3, 16


@njit(cache=True)
def largest_first(values, count):
    """(n,): indices of the values (n,), of which the first `count` are the largest; the rest is in
    no order.
    """
    order, first, last = np.arange(len(values)), 0, len(values)
    if count >= last:
        return order
    while last - first > SHORT_SELECTION:
        cut = _partition(order, values, first, last)
        if cut <= count:
            first = cut
        else:
            last = cut
    _insert(order, values, first, last)
    return order


@njit(cache=True)
def descending(values):
    """(n,): indices of the values (n,) in descending order."""
    n = len(values)
    order, ends = np.arange(n), [n]
    first = 0
    while ends:
        last = ends[-1]
        if last - first > SHORT:
            ends.append(_partition(order, values, first, last))
        else:
            first = ends.pop()
    _insert(order, values, 0, n)
    return order


@njit(cache=True)
def _partition(order, values, first, last):
    """Exchange indices in order[first:last] so that no value behind the returned position is
    greater than one before it.
    """
    a, b, c = first + 1, first + (last - first) // 2, last - 1
    if values[order[b]] >= values[order[a]]:
        a, b = b, a
    x, y, z = values[order[a]], values[order[b]], values[order[c]]  # x >= y
    middle = b if y > z else c if x > z else a
    order[first], order[middle] = order[middle], order[first]
    pivot, low, high = values[order[first]], first + 1, last
    while True:
        while values[order[low]] > pivot:
            low += 1
        high -= 1
        while pivot > values[order[high]]:
            high -= 1
        if low >= high:
            return low
        order[low], order[high] = order[high], order[low]
        low += 1


@njit(cache=True)
def _insert(order, values, first, last):
    """Sort order[first:last] by insertion; equal values stay in their order."""
    for i in range(first + 1, last):
        j, one = i, order[i]
        while j > first and values[one] > values[order[j - 1]]:
            order[j] = order[j - 1]
            j -= 1
        order[j] = one
