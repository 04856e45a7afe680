"""The time axis on which an estimate fits the ground truth best: another offset or another scale of
its stamps, or the ground truth's stamps row by row. Systems that change stamps, bags, clocks, frame
rates and frame numbers make such mistakes.

The residual of an alignment of the paired poses is computed for all offsets of whole frames at
once: the moments of the least-squares fit (Umeyama, PAMI 1991, equations 34 to 40) are correlations
of the two trajectories, and FFTs compute them for all offsets.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..evaluation.align import MIN_EXTENT_M, principal_extents, umeyama
from ..evaluation.associate import AssociationSettings, associate
from ..geometry import so3
from ..geometry.trajectory import Trajectory, frame_rate_hz

#: Fewer poses can fit by chance. A time axis is only considered if at least this share of the
#: estimate overlaps the ground truth.
_MIN_POSES = 10
_MIN_SHARE = 0.5
#: Maximum number of frames of a search.
_MAX_FRAMES = 1 << 16
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
#: Rounds of least squares, and the last step of a search by halving.
_ROUNDS = 10
_LAST_STEP_S = 1e-5


class TimeAxis(NamedTuple):
    """Other stamps: `scale` times as far apart, with offset_s added to that at origin_s."""

    offset_s: float
    scale: float = 1.0
    origin_s: float = 0.0

    def of(self, stamps_s: np.ndarray) -> np.ndarray:
        """The new stamps (n,) of stamps (n,)."""
        return self.origin_s + self.offset_s + self.scale * (stamps_s - self.origin_s)

    def applied(self, trajectory: Trajectory) -> Trajectory:
        return Trajectory(self.of(trajectory.stamps_s), trajectory.T_world_camera)

    def to_dict(self) -> dict[str, float]:
        if self.scale == 1.0:
            return {"offset_s": self.offset_s}
        return {
            "offset_s": self.offset_s,
            "stamp_scale": self.scale,
            "origin_s": self.origin_s,
        }

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


class Moments(NamedTuple):
    """Variances of x and of y, and their covariance (..., d, d), of paired values (..., n, d)."""

    x: np.ndarray
    y: np.ndarray
    covariance: np.ndarray

    @classmethod
    def of(cls, x: np.ndarray, y: np.ndarray, is_centred: bool) -> "Moments":
        if is_centred:
            x = x - x.mean(axis=0)
            y = y - y.mean(axis=0)
        return cls(np.vdot(x, x) / len(x), np.vdot(y, y) / len(x), y.T @ x / len(x))


@dataclass(frozen=True)
class Curve:
    """What is compared of trajectories: values (n, d), and how they are aligned: by a translation
    if they are centred, by a scale, by a reflection.
    """

    values: Callable[[Trajectory], np.ndarray]
    is_centred: bool = True
    scales: bool = False
    reflects: bool = False

    def at(self, trajectory: Trajectory, stamps_s: np.ndarray) -> np.ndarray:
        """Values (n, d) at stamps (n,), linearly interpolated."""
        values = self.values(trajectory)
        known_s = trajectory.stamps_s
        row = np.searchsorted(known_s, stamps_s, side="right").clip(1, len(known_s) - 1) - 1
        # np.interp would copy all columns of a long trajectory for a few stamps
        since_s = np.clip(stamps_s, known_s[0], None) - known_s[row]
        slope = (values[row + 1] - values[row]) / (known_s[row + 1] - known_s[row])[:, None]
        found = slope * since_s[:, None] + values[row]
        return np.where((stamps_s >= known_s[-1])[:, None], values[-1], found)

    def residual(self, moments: Moments) -> np.ndarray:
        """(...) RMS of y after the best alignment of x: of values (Umeyama, PAMI 1991, equations
        34 to 40) whose moments are given.
        """
        d = np.linalg.svd(moments.covariance, compute_uv=False)
        if not self.reflects:
            d[..., -1] *= np.sign(np.linalg.det(moments.covariance))
        agreement = d.sum(axis=-1)
        if self.scales:
            squared = moments.y - agreement**2 / np.maximum(moments.x, 1e-300)
        else:
            squared = moments.x + moments.y - 2 * agreement
        return np.sqrt(np.maximum(squared, 0))

    def is_determined(self, trajectory: Trajectory) -> bool:
        """Whether the values change."""
        return bool(principal_extents(self.values(trajectory))[0] >= MIN_EXTENT_M)


def _positions(trajectory: Trajectory) -> np.ndarray:
    return trajectory.positions_m


@lru_cache(maxsize=2)  # a search asks for it of the same trajectory again and again
def frame_s(trajectory: Trajectory) -> float:
    """The usual time from pose to pose."""
    return float(np.median(np.diff(trajectory.stamps_s)))


@lru_cache(maxsize=2)
def _quaternions(trajectory: Trajectory) -> np.ndarray:
    """(n, 4) unit quaternions that do not jump to their opposite."""
    quat_xyzw = trajectory.T_world_camera.quat_xyzw
    turned = np.sum(quat_xyzw[1:] * quat_xyzw[:-1], axis=-1) < 0
    signs = np.cumprod(np.where(np.append(False, turned), -1.0, 1.0))
    return quat_xyzw * signs[:, None]


POSITIONS = Curve(_positions)
SCALED_POSITIONS = Curve(_positions, scales=True)
#: Positions that may be mirrored, too.
SHAPES = Curve(_positions, scales=True, reflects=True)
#: Constant rotations on either side of rotations, their inverses, another order of quaternions and
#: another handedness are all multiplications of the quaternions by an orthogonal matrix (4, 4).
ROTATIONS = Curve(_quaternions, is_centred=False, reflects=True)


def best_offset(
    reference: Trajectory, estimate: Trajectory, curve: Curve = POSITIONS
) -> TimeAxis | None:
    """The offset in seconds to add to the estimate's stamps for the best alignment.

    None if the trajectories do not determine it: they are too short, or do not move.
    """
    if not _is_determined(reference, estimate, curve):
        return None
    step_s = frame_s(reference)
    found = _nearly_best(reference, estimate, step_s, curve)
    if found is None:
        return None
    return rounded(reference, estimate, refined(reference, estimate, found[1], 1, curve), curve)


def best_scales(
    reference: Trajectory, estimate: Trajectory, curve: Curve = POSITIONS
) -> list[tuple[int, TimeAxis]]:
    """The scale of the time between the estimate's stamps, and the offset, of the best alignment,
    then the same with usual scales nearby, each after the number of its fitted parameters; [] if
    the trajectories do not determine them.
    """
    if not _is_determined(reference, estimate, curve):
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
        nearly = _nearly_best(reference, part, step_s, curve, scale)
        if nearly is not None:
            found.append(nearly)
    if not found:
        return []
    fitted = refined(reference, estimate, min(found)[1], 2, curve)
    scales = [(2, fitted)]
    whole = per_frame * np.arange(1, _MAX_RATIO)
    for ratios in (_RATIOS, whole):
        usual = float(ratios[np.abs(np.log(ratios / fitted.scale)).argmin()])
        if abs(usual / fitted.scale - 1) < _USUAL_WITHIN:
            axis = refined(reference, estimate, fitted._replace(scale=usual), 1, curve)
            scales.append((1, rounded(reference, estimate, axis, curve)))
    return scales


def rms_m(
    reference: Trajectory, estimate: Trajectory, axis: TimeAxis, curve: Curve = POSITIONS
) -> float:
    """RMS, in metres for positions, after the alignment of the estimate's poses within the
    reference's time span; infinite if they are too few.
    """
    inside = _inside(reference, axis.of(estimate.stamps_s))
    if np.count_nonzero(inside) < max(_MIN_POSES, _MIN_SHARE * len(inside)):
        return np.inf
    x = curve.values(estimate)[inside]
    y = curve.at(reference, axis.of(estimate.stamps_s[inside]))
    return float(curve.residual(Moments.of(x, y, curve.is_centred)))


def refined(
    reference: Trajectory,
    estimate: Trajectory,
    axis: TimeAxis,
    parameters: int,
    curve: Curve = POSITIONS,
) -> TimeAxis:
    """The axis nearby with the smallest RMS, by least squares over the offset, or over offset and
    scale, which stays within a factor of 2; of curves that reflect, by trying offsets alone.
    """
    best_m = rms_m(reference, estimate, axis, curve)
    if best_m == np.inf:
        return axis
    if curve.reflects:
        return _narrowed(reference, estimate, axis, curve)
    limits = axis.scale / 2, 2 * axis.scale
    for _ in range(_ROUNDS):
        step = _least_squares(reference, estimate, axis, parameters, curve.scales)
        scale = float(np.clip(axis.scale + step[1], *limits))
        tried = TimeAxis(axis.offset_s + step[0], scale, axis.origin_s)
        tried_m = rms_m(reference, estimate, tried, curve)
        if tried_m >= best_m:
            break
        axis = tried
        best_m = tried_m
    return axis


def _narrowed(
    reference: Trajectory, estimate: Trajectory, axis: TimeAxis, curve: Curve
) -> TimeAxis:
    """The offset within a step of the search with the smallest RMS, by interval halving."""
    step_s = _search_step_s(reference, estimate)
    while step_s > _LAST_STEP_S:
        step_s /= 2
        around = [axis._replace(offset_s=axis.offset_s + k * step_s) for k in (-1, 0, 1)]
        axis = min(around, key=lambda one: rms_m(reference, estimate, one, curve))
    return axis


def moved_onto_stamps(
    reference_s: np.ndarray, estimate_s: np.ndarray, axis: TimeAxis, settings: AssociationSettings
) -> TimeAxis:
    """The axis, moved by less than a frame to where most stamps of the estimate coincide with one
    of the reference, if too few do; stamps (n,) and (m,), increasing.
    """
    settings = replace(settings, offset_s=0.0)
    if 2 * len(associate(reference_s, axis.of(estimate_s), settings)) >= len(estimate_s):
        return axis
    return onto_stamps(reference_s, estimate_s, axis)


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


def _is_determined(reference: Trajectory, estimate: Trajectory, curve: Curve) -> bool:
    """Whether both are long enough, and the estimate moves."""
    if min(len(reference), len(estimate)) < _MIN_POSES:
        return False
    return curve.is_determined(estimate) and curve.is_determined(reference)


def _nearly_best(
    reference: Trajectory,
    estimate: Trajectory,
    step_s: float,
    curve: Curve,
    scale: float = 1.0,
) -> tuple[float, TimeAxis] | None:
    """The best RMS and axis of this scale, of all offsets of whole steps, or of longer ones if
    there are too many.
    """
    first_s = reference.stamps_s[0], estimate.stamps_s[0]
    step_s = max(step_s, _search_step_s(reference, estimate, scale))
    count = int(np.rint((reference.stamps_s[-1] - first_s[0]) / step_s)) + 1
    places = np.rint(scale * (estimate.stamps_s - first_s[1]) / step_s)
    rows, first = np.unique(places.astype(int), return_index=True)
    x = curve.values(estimate)[first]
    y = curve.at(reference, first_s[0] + step_s * np.arange(count))
    if curve.is_centred:  # near zero, where sums round little
        x = x - x.mean(axis=0)
        y = y - y.mean(axis=0)
    lags, moments = _moments_by_lag(rows, x, y, curve.is_centred)
    if len(lags) == 0:
        return None
    found_m = curve.residual(moments)
    judged = found_m
    if curve.reflects or curve.scales:  # else where nothing moves, it would fit best
        judged = found_m / np.sqrt(np.maximum(_spread(rows, y, lags), 1e-12))
    best = int(judged.argmin())
    offset_s = float(first_s[0] + lags[best] * step_s - first_s[1])
    return float(judged[best]), TimeAxis(offset_s, scale, float(first_s[1]))


def _search_step_s(reference: Trajectory, estimate: Trajectory, scale: float = 1.0) -> float:
    """A frame of the reference, or longer if there are too many."""
    longest_s = max(np.ptp(reference.stamps_s), scale * np.ptp(estimate.stamps_s))
    return max(frame_s(reference), float(longest_s) / _MAX_FRAMES)


def _spread(rows: np.ndarray, y: np.ndarray, lags: np.ndarray) -> np.ndarray:
    """(m,) variance of the part of y (n, d) that lags (m,) pair with rows."""
    total = np.vstack([np.zeros(y.shape[1]), np.cumsum(y, axis=0)])
    squares = np.append(0.0, np.cumsum(_squares(y)))
    start = np.clip(lags, 0, len(y) - 1)
    end = np.clip(lags + rows[-1] + 1, start + 1, len(y))
    n = (end - start)[:, None]
    mean = (total[end] - total[start]) / n
    return (squares[end] - squares[start]) / n[:, 0] - _squares(mean)


def _squares(values: np.ndarray) -> np.ndarray:
    return np.sum(values * values, axis=-1)


def _moments_by_lag(
    rows: np.ndarray, x: np.ndarray, y: np.ndarray, is_centred: bool
) -> tuple[np.ndarray, Moments]:
    """Lags (m,) in frames with enough pairs, and the moments of the pairs x[k] and y[rows[k] + lag]
    for each.
    """
    length = int(rows[-1]) + 1
    frames = len(y)
    axes = range(1, 1 + x.shape[1])
    gridded = np.zeros((length, 2 + x.shape[1]))
    gridded[rows] = np.column_stack([np.ones(len(x)), x, _squares(x)])
    other = np.column_stack([np.ones(frames), y, _squares(y)])
    size = 1 << (length + frames).bit_length()
    a = np.fft.rfft(gridded, size, axis=0).conj()
    b = np.fft.rfft(other, size, axis=0)
    lags = np.arange(1 - length, frames)

    def sums(i: int, j: int) -> np.ndarray:
        return np.fft.irfft(a[:, i] * b[:, j], size)[lags]

    count = np.rint(sums(0, 0))
    enough = count >= max(_MIN_POSES, _MIN_SHARE * len(x))
    n = np.maximum(count, 1)
    covariance = np.stack([np.stack([sums(i, j) for i in axes], -1) for j in axes], -2)
    covariance = covariance / n[:, None, None]
    variances = [sums(-1, 0) / n, sums(0, -1) / n]
    if is_centred:
        mean_x = np.stack([sums(i, 0) for i in axes], -1) / n[:, None]
        mean_y = np.stack([sums(0, j) for j in axes], -1) / n[:, None]
        covariance = covariance - mean_y[:, :, None] * mean_x[:, None, :]
        variances = [variances[0] - _squares(mean_x), variances[1] - _squares(mean_y)]
    return lags[enough], Moments(*[one[enough] for one in (*variances, covariance)])


def _inside(reference: Trajectory, stamps_s: np.ndarray) -> np.ndarray:
    """(n,) whether stamps (n,) are within the reference's time span."""
    slack_s = 1e-6
    first_s = reference.stamps_s[0] - slack_s
    return (stamps_s >= first_s) & (stamps_s <= reference.stamps_s[-1] + slack_s)


def _least_squares(
    reference: Trajectory, estimate: Trajectory, axis: TimeAxis, parameters: int, scales: bool
) -> np.ndarray:
    """Steps (2,) of offset and scale of the time, the latter 0 for one parameter, that with a small
    rotation, a translation and, if it `scales`, a factor of the aligned positions make the
    linearised residual smallest.
    """
    inside = _inside(reference, axis.of(estimate.stamps_s))
    since_s = estimate.stamps_s[inside] - axis.origin_s
    stamps_s = axis.of(estimate.stamps_s[inside])
    half_s = frame_s(reference) / 2
    y = POSITIONS.at(reference, stamps_s)
    ahead = POSITIONS.at(reference, stamps_s + half_s)
    speed = (ahead - POSITIONS.at(reference, stamps_s - half_s)) / (2 * half_s)
    T, scale = umeyama(estimate.positions_m[inside], y, with_scale=scales)
    x = T.apply(scale * estimate.positions_m[inside])
    centred = x - x.mean(axis=0)
    columns = [speed[..., None], (speed * since_s[:, None])[..., None]][:parameters]
    columns += [so3.hat(centred), np.broadcast_to(np.eye(3), (len(x), 3, 3))]
    columns += [-centred[..., None]] * scales
    A = np.concatenate(columns, axis=-1).reshape(3 * len(x), -1)
    steps = np.linalg.lstsq(A, (x - y).reshape(-1), rcond=None)[0][:parameters]
    return np.append(steps, [0.0, 0.0])[:2]


def rounded(
    reference: Trajectory, estimate: Trajectory, axis: TimeAxis, curve: Curve = POSITIONS
) -> TimeAxis:
    """The axis whose offset, or first stamp if it has another scale, has the fewest digits and that
    fits equally well within the noise of n poses.
    """
    limit_m = rms_m(reference, estimate, axis, curve) * (1 + 2 / len(estimate)) + 1e-6
    start_s = axis.origin_s if axis.scale != 1.0 else 0.0
    for digits in range(7):
        short_s = round(start_s + axis.offset_s, digits) - start_s
        short = axis._replace(offset_s=short_s + 0.0)
        if rms_m(reference, estimate, short, curve) <= limit_m:
            return short
    return axis
