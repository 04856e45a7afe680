"""The time axis on which an estimate fits the ground truth best: another offset or another scale of
its stamps, or the ground truth's stamps row by row. Systems that change stamps, bags, clocks, frame
rates and frame numbers make such mistakes.

The residual of a rigid alignment of the paired positions is computed for all offsets of whole
frames at once: the sums of the least-squares fit (Umeyama, PAMI 1991, equations 34 to 40) are
correlations of the two trajectories, and FFTs compute them for all offsets.
"""

from typing import NamedTuple

import numpy as np

from ..geometry import so3
from ..geometry.trajectory import Trajectory, frame_rate_hz
from .align import MIN_EXTENT_M, principal_extents, umeyama
from .compared_poses import rms

#: Fewer poses can fit by chance. A time axis is only considered if at least this share of the
#: estimate overlaps the ground truth.
_MIN_POSES = 10
_MIN_SHARE = 0.5
#: Maximum number of frames of a search.
_MAX_FRAMES = 1 << 18
#: Scales are searched from one pose of the estimate per frame of the ground truth to this many
#: times slower and faster, in these steps, on at most this many frames.
_MAX_RATIO = 12.0
_RATIO_STEP = 1.02
_SEARCHED_FRAMES = 256
#: Ratios of frame rates. A fitted scale is tried as one of these, or as every k-th frame, within
#: this share: an estimate that drifts does not determine it better.
_RATES = np.array([10.0, 12.0, 15.0, 20.0, 24.0, 25.0, 30.0, 50.0, 60.0])
_RATIOS = np.unique(np.divide.outer(_RATES, _RATES))
_USUAL_WITHIN = 0.05
#: Rounds of least squares.
_ROUNDS = 10


class TimeAxis(NamedTuple):
    """Other stamps: `scale` times as far apart, with offset_s added to that at origin_s."""

    offset_s: float
    scale: float = 1.0
    origin_s: float = 0.0

    def of(self, stamps_s: np.ndarray) -> np.ndarray:
        """The new stamps (n,) of stamps (n,)."""
        return self.origin_s + self.offset_s + self.scale * (stamps_s - self.origin_s)

    @property
    def advice(self) -> str:
        """What to try."""
        if self.scale == 1.0:
            return f"an offset of {_digits(self.offset_s)} s"
        first_s = _digits(self.origin_s + self.offset_s)
        return f"{first_s} + {self.scale:.7g} (stamp - {_digits(self.origin_s)}) as its stamps"


class OtherTime(NamedTuple):
    """Other stamps (n,), and their axis in that or in those of the ground truth's rows."""

    axis: TimeAxis
    stamps_s: np.ndarray


def best_axis(reference: Trajectory, estimate: Trajectory) -> TimeAxis | None:
    """The best offset, or the best scale and offset if their RMS is at most half."""
    offset = best_offset(reference, estimate)
    scales = best_scales(reference, estimate)
    if not scales:
        return offset
    if offset is None:
        return scales[-1][1]
    both_m = [rms_m(reference, estimate, axis) for axis in (offset, scales[0][1])]
    return scales[-1][1] if both_m[1] <= 0.5 * both_m[0] else offset


def best_offset(reference: Trajectory, estimate: Trajectory) -> TimeAxis | None:
    """The offset in seconds to add to the estimate's stamps for the best rigid alignment.

    None if the trajectories do not determine it: they are too short, do not move, or span more than
    _MAX_FRAMES.
    """
    if not _is_determined(reference, estimate):
        return None
    step_s = float(np.median(np.diff(reference.stamps_s)))
    found = _nearly_best(reference, estimate, step_s)
    if found is None:
        return None
    return _rounded(reference, estimate, refined(reference, estimate, found[1], 1))


def best_scales(reference: Trajectory, estimate: Trajectory) -> list[tuple[int, TimeAxis]]:
    """The scale of the time between the estimate's stamps, and the offset, of the best rigid
    alignment, then the same with usual scales nearby, each after the number of its fitted
    parameters; [] if the trajectories do not determine them.
    """
    if not _is_determined(reference, estimate):
        return []
    rates_hz = [frame_rate_hz(one.stamps_s) for one in (reference, estimate)]
    per_frame = rates_hz[1] / rates_hz[0]
    span_s = float(np.ptp(reference.stamps_s))
    step_s = max(1 / rates_hz[0], span_s / _SEARCHED_FRAMES)
    part = estimate[:: 1 + len(estimate) // _SEARCHED_FRAMES]
    count = round(np.log(_MAX_RATIO) / np.log(_RATIO_STEP))
    found = []
    for power in range(-count, count + 1):
        scale = per_frame * _RATIO_STEP**power
        if scale * float(np.ptp(part.stamps_s)) * _MIN_SHARE > span_s:
            break
        nearly = _nearly_best(reference, part, step_s, scale)
        if nearly is not None:
            found.append(nearly)
    if not found:
        return []
    fitted = refined(reference, estimate, min(found)[1], 2)
    scales = [(2, fitted)]
    whole = per_frame * np.arange(1, _MAX_RATIO)
    for ratios in (_RATIOS, whole):
        usual = float(ratios[np.abs(np.log(ratios / fitted.scale)).argmin()])
        if abs(usual / fitted.scale - 1) < _USUAL_WITHIN:
            axis = refined(reference, estimate, fitted._replace(scale=usual), 1)
            scales.append((1, _rounded(reference, estimate, axis)))
    return scales


def rms_m(reference: Trajectory, estimate: Trajectory, axis: TimeAxis) -> float:
    """RMS in metres after a rigid alignment of the estimate's poses within the reference's time
    span; infinite if they are too few.
    """
    inside = _inside(reference, axis.of(estimate.stamps_s))
    if np.count_nonzero(inside) < max(_MIN_POSES, _MIN_SHARE * len(inside)):
        return np.inf
    x = estimate.positions_m[inside]
    y = _positions(reference, axis.of(estimate.stamps_s[inside]))
    return rms(y - umeyama(x, y)[0].apply(x))


def refined(
    reference: Trajectory, estimate: Trajectory, axis: TimeAxis, parameters: int
) -> TimeAxis:
    """The axis nearby with the smallest RMS, by least squares over the offset, or over offset and
    scale, which stays within a factor of 2.
    """
    limits = axis.scale / 2, 2 * axis.scale
    best_m = rms_m(reference, estimate, axis)
    if best_m == np.inf:
        return axis
    for _ in range(_ROUNDS):
        step = _least_squares(reference, estimate, axis, parameters)
        scale = float(np.clip(axis.scale + step[1], *limits))
        tried = TimeAxis(axis.offset_s + step[0], scale, axis.origin_s)
        tried_m = rms_m(reference, estimate, tried)
        if tried_m >= best_m:
            break
        axis = tried
        best_m = tried_m
    return axis


def onto_stamps(reference_s: np.ndarray, estimate_s: np.ndarray, axis: TimeAxis) -> TimeAxis:
    """The nearest axis of this scale with which most stamps of the estimate coincide with one of
    the reference; both (n,), increasing.
    """
    shifted_s = axis.of(estimate_s)
    inside = (shifted_s >= reference_s[0]) & (shifted_s <= reference_s[-1])
    if not inside.any():
        return axis
    shifted_s = shifted_s[inside]
    after = np.clip(np.searchsorted(reference_s, shifted_s), 1, len(reference_s) - 1)
    missing_s = np.stack([reference_s[after - 1], reference_s[after]]) - shifted_s
    nearest_s = np.where(np.abs(missing_s[0]) < np.abs(missing_s[1]), missing_s[0], missing_s[1])
    offset_s = axis.offset_s + float(np.median(nearest_s))
    return axis._replace(offset_s=round(offset_s, 6))


def _digits(seconds: float) -> str:
    return f"{seconds:.6f}".rstrip("0").rstrip(".")


def _is_determined(reference: Trajectory, estimate: Trajectory) -> bool:
    """Whether both are long enough, and the estimate moves."""
    if min(len(reference), len(estimate)) < _MIN_POSES:
        return False
    return bool(principal_extents(estimate.positions_m)[0] >= MIN_EXTENT_M)


def _nearly_best(
    reference: Trajectory, estimate: Trajectory, step_s: float, scale: float = 1.0
) -> tuple[float, TimeAxis] | None:
    """The best RMS and axis of this scale, of all offsets of whole steps."""
    first_s = reference.stamps_s[0], estimate.stamps_s[0]
    count = int(np.rint((reference.stamps_s[-1] - first_s[0]) / step_s)) + 1
    places = np.rint(scale * (estimate.stamps_s - first_s[1]) / step_s)
    if max(count, places[-1]) > _MAX_FRAMES:
        return None
    rows, first = np.unique(places.astype(int), return_index=True)
    x = estimate.positions_m[first] - estimate.positions_m.mean(axis=0)
    y = _positions(reference, first_s[0] + step_s * np.arange(count))
    lags, found_m = _rms_by_lag(rows, x, y - reference.positions_m.mean(axis=0))
    if len(lags) == 0:
        return None
    best = int(found_m.argmin())
    offset_s = float(first_s[0] + lags[best] * step_s - first_s[1])
    return float(found_m[best]), TimeAxis(offset_s, scale, float(first_s[1]))


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


def _inside(reference: Trajectory, stamps_s: np.ndarray) -> np.ndarray:
    """(n,) whether stamps (n,) are within the reference's time span."""
    slack_s = 1e-6
    first_s = reference.stamps_s[0] - slack_s
    return (stamps_s >= first_s) & (stamps_s <= reference.stamps_s[-1] + slack_s)


def _least_squares(
    reference: Trajectory, estimate: Trajectory, axis: TimeAxis, parameters: int
) -> np.ndarray:
    """Steps (2,) of offset and scale, the latter 0 for one parameter, that with a small rotation
    and a translation of the aligned positions make the linearised residual smallest.
    """
    inside = _inside(reference, axis.of(estimate.stamps_s))
    since_s = estimate.stamps_s[inside] - axis.origin_s
    stamps_s = axis.of(estimate.stamps_s[inside])
    half_s = float(np.median(np.diff(reference.stamps_s))) / 2
    y = _positions(reference, stamps_s)
    ahead = _positions(reference, stamps_s + half_s)
    speed = (ahead - _positions(reference, stamps_s - half_s)) / (2 * half_s)
    x = umeyama(estimate.positions_m[inside], y)[0].apply(estimate.positions_m[inside])
    columns = [speed[..., None], (speed * since_s[:, None])[..., None]][:parameters]
    columns += [so3.hat(x - x.mean(axis=0)), np.broadcast_to(np.eye(3), (len(x), 3, 3))]
    A = np.concatenate(columns, axis=-1).reshape(3 * len(x), -1)
    steps = np.linalg.lstsq(A, (x - y).reshape(-1), rcond=None)[0][:parameters]
    return np.append(steps, [0.0, 0.0])[:2]


def _rounded(reference: Trajectory, estimate: Trajectory, axis: TimeAxis) -> TimeAxis:
    """The axis whose offset, or first stamp if it has another scale, has the fewest digits and that
    fits equally well within the noise of n poses.
    """
    limit_m = rms_m(reference, estimate, axis) * (1 + 2 / len(estimate)) + 1e-6
    start_s = axis.origin_s if axis.scale != 1.0 else 0.0
    for digits in range(7):
        short_s = round(start_s + axis.offset_s, digits) - start_s
        short = axis._replace(offset_s=short_s + 0.0)
        if rms_m(reference, estimate, short) <= limit_m:
            return short
    return axis
