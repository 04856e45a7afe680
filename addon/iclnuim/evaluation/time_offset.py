"""The constant time offset at which an estimate fits the ground truth best. Systems that change
stamps, bags and clocks shift all stamps.

The residual of a rigid alignment of the paired positions is computed for all offsets of whole
frames at once: the sums of the least-squares fit (Umeyama, PAMI 1991, equations 34 to 40) are
correlations of the two trajectories, and FFTs compute them for all offsets.
"""

import numpy as np

from ..geometry.trajectory import Trajectory
from .align import MIN_EXTENT_M, principal_extents, umeyama

#: Fewer poses can fit by chance. An offset is only considered if at least this share of the
#: estimate overlaps the ground truth.
_MIN_POSES = 10
_MIN_SHARE = 0.5
#: Maximum number of frames of a search.
_MAX_FRAMES = 1 << 18


def best_offset(reference: Trajectory, estimate: Trajectory) -> tuple[float, float] | None:
    """The offset in seconds to add to the estimate's stamps for the best rigid alignment, and the
    remaining RMS in metres.

    None if the trajectories do not determine it: they are too short, do not move, or span more than
    _MAX_FRAMES.
    """
    if min(len(reference), len(estimate)) < _MIN_POSES:
        return None
    if principal_extents(estimate.positions_m)[0] < MIN_EXTENT_M:
        return None
    step_s = float(np.median(np.diff(reference.stamps_s)))
    spans = [np.rint((t.stamps_s - t.stamps_s[0]) / step_s) for t in (reference, estimate)]
    if max(span[-1] for span in spans) > _MAX_FRAMES:
        return None
    grid_s = reference.stamps_s[0] + step_s * np.arange(int(spans[0][-1]) + 1)
    rows, first = np.unique(spans[1].astype(int), return_index=True)
    x = estimate.positions_m[first] - estimate.positions_m.mean(axis=0)
    y = _positions(reference, grid_s) - reference.positions_m.mean(axis=0)
    lags, rms_m = _rms_by_lag(rows, x, y)
    if len(lags) == 0:
        return None
    coarse_s = float(grid_s[0] + lags[rms_m.argmin()] * step_s - estimate.stamps_s[0])
    return _rounded(reference, estimate, _refined(reference, estimate, coarse_s, step_s))


def onto_stamps(reference_s: np.ndarray, estimate_s: np.ndarray, offset_s: float) -> float:
    """The offset nearest to `offset_s` with which most stamps of the estimate coincide with one of
    the reference; both (n,), increasing.
    """
    shifted_s = estimate_s + offset_s
    inside = (shifted_s >= reference_s[0]) & (shifted_s <= reference_s[-1])
    if not inside.any():
        return offset_s
    shifted_s = shifted_s[inside]
    after = np.clip(np.searchsorted(reference_s, shifted_s), 1, len(reference_s) - 1)
    missing_s = np.stack([reference_s[after - 1], reference_s[after]]) - shifted_s
    nearest_s = np.where(np.abs(missing_s[0]) < np.abs(missing_s[1]), missing_s[0], missing_s[1])
    return round(offset_s + float(np.median(nearest_s)), 6)


def _rms_by_lag(rows: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lags (m,) in frames with enough pairs, and the RMS (m,) after a rigid alignment of x[k] and
    y[rows[k] + lag].
    """
    length = int(rows[-1]) + 1
    frames = len(y)
    gridded = np.zeros((length, 5))
    gridded[rows] = np.column_stack([np.ones(len(x)), x, (x * x).sum(axis=1)])
    other = np.column_stack([np.ones(frames), y, (y * y).sum(axis=1)])
    size = 1 << (length + frames).bit_length()
    a = np.fft.rfft(gridded, size, axis=0).conj()
    b = np.fft.rfft(other, size, axis=0)
    lags = np.arange(1 - length, frames)

    def sums(i: int, j: int) -> np.ndarray:
        return np.fft.irfft(a[:, i] * b[:, j], size)[lags]

    count = np.rint(sums(0, 0))
    enough = count >= max(_MIN_POSES, _MIN_SHARE * len(x))
    n = np.maximum(count, 1)
    mean_x = np.stack([sums(i, 0) for i in (1, 2, 3)], -1)
    mean_y = np.stack([sums(0, j) for j in (1, 2, 3)], -1)
    mean_x = mean_x / n[:, None]
    mean_y = mean_y / n[:, None]
    products = np.stack([np.stack([sums(i, j) for i in (1, 2, 3)], -1) for j in (1, 2, 3)], -2)
    covariance = products / n[:, None, None] - mean_y[:, :, None] * mean_x[:, None, :]
    variance = sums(4, 0) / n - (mean_x**2).sum(axis=1) + sums(0, 4) / n - (mean_y**2).sum(axis=1)
    d = np.linalg.svd(covariance[enough], compute_uv=False)
    d[:, 2] *= np.sign(np.linalg.det(covariance[enough]))
    return lags[enough], np.sqrt(np.maximum(variance[enough] - 2 * d.sum(axis=1), 0))


def _positions(trajectory: Trajectory, stamps_s: np.ndarray) -> np.ndarray:
    """(n, 3) positions at stamps (n,), linearly interpolated."""
    return np.stack(
        [np.interp(stamps_s, trajectory.stamps_s, axis) for axis in trajectory.positions_m.T], -1
    )


def _rms(reference: Trajectory, estimate: Trajectory, offset_s: float) -> float:
    """RMS after a rigid alignment of the estimate's poses within the reference's time span;
    infinite if they are too few.
    """
    stamps_s = estimate.stamps_s + offset_s
    slack_s = 1e-6
    inside = (stamps_s >= reference.stamps_s[0] - slack_s) & (
        stamps_s <= reference.stamps_s[-1] + slack_s
    )
    if np.count_nonzero(inside) < _MIN_POSES:
        return np.inf
    x, y = estimate.positions_m[inside], _positions(reference, stamps_s[inside])
    T, _ = umeyama(x, y)
    return float(np.sqrt(((y - T.apply(x)) ** 2).sum(axis=1).mean()))


def _refined(reference: Trajectory, estimate: Trajectory, offset_s: float, step_s: float) -> float:
    """The offset within a frame of `offset_s` with the smallest RMS, by golden-section search."""
    low = offset_s - step_s
    high = offset_s + step_s
    ratio = (5**0.5 - 1) / 2
    for _ in range(30):
        one = high - ratio * (high - low)
        other = low + ratio * (high - low)
        if _rms(reference, estimate, one) < _rms(reference, estimate, other):
            high = other
        else:
            low = one
    return (low + high) / 2


def _rounded(reference: Trajectory, estimate: Trajectory, offset_s: float) -> tuple[float, float]:
    """The offset with the fewest digits that fits equally well within the noise of n poses, and its
    RMS.
    """
    best_m = _rms(reference, estimate, offset_s)
    limit_m = best_m * (1 + 2 / len(estimate)) + 1e-6
    for digits in range(7):
        short_s = round(offset_s, digits) + 0.0
        rms_m = _rms(reference, estimate, short_s)
        if rms_m <= limit_m:
            return short_s, rms_m
    return offset_s, best_m
