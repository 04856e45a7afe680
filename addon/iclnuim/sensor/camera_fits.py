"""Settings of the models of depth cameras that static walls and boards determine, and which model
resembles a camera most.

This is the inverse of d435, azure_kinect and phone: from walls and boards recorded through a model,
its settings are estimated again. What they do not show stays as published.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from ..errors import InputError
from ..settings import declared
from .active_stereo import D435DepthNoise
from .appearance import WHITE_ALBEDO, SurfaceAppearance
from .boards import BoardRecording
from .calibration import DepthCalibration
from .depth import PaperDepthNoise
from .models import Noise, depth_model, with_depth_noise
from .noise_model import DEPTH, NoiseModel, frame_generator
from .phone import PhoneDepthNoise
from .time_of_flight import DARK_ALBEDO, AzureKinectDepthNoise
from .walls import WallRecording, inverse_depth, mean_of_seen

#: Frames of a wall that are made by a model to compare it with a recording.
_COMPARED = 6
#: Pixels apart at which the likeness of errors is compared: within a matching window, between
#: windows, between dots.
_APART_PX = (1, 4, 12)
#: A trend with distance needs distances that differ by this factor.
_SPAN = 2.0
#: A model with a smaller misfit resembles a camera: sigma is within a third, as between devices of
#: one kind.
LIKE = 0.3
#: Pixels that a place needs on both sides, or a group to have a mean.
_PIXELS = 200
#: Groups of pixels of a wall.
_GROUPS = 400
#: The side of a matching window is below it.
_LARGEST_WINDOW = 80
#: Dots in a row that are tried.
_DOTS = range(8, 65)
#: Logarithm of a sigma that stands for a wall without noise: of a thousandth of a millimetre.
_NOTHING = np.log(1e-6)


@dataclass(frozen=True)
class CameraFit:
    """`settings` of the depth noise `model` that the recordings determine; `not_determined`: the
    names of its others. misfit: RMS difference of the logarithm of sigma, of the correlation of
    neighbours and of the missing share between the recording and the fitted model; 0 for equal
    ones.
    """

    model: str
    settings: dict[str, float]
    not_determined: tuple[str, ...]
    misfit: float


def fit_cameras(
    walls: Sequence[WallRecording],
    paper: DepthCalibration | None,
    boards: Sequence[BoardRecording] = (),
) -> list[CameraFit]:
    """Each model fitted to recordings, the one that resembles the walls most first. paper: what
    calibrate_depth says of the same walls, None if it refuses them: for noise that is common to
    blocks of pixels, which that model has not. Raises InputError for recordings of fewer than two
    frames or of equal frames, and for boards as `checked`.
    """
    for wall in walls:
        if len(wall.frames) < 2 or (wall.frames == wall.frames[0]).all():
            expected = "two or more depth images of each wall that differ by their noise"
            raise InputError(expected, found=f"{len(wall.frames)}, equal")
    recorded = [_signs(wall) for wall in walls]
    found = {model: fitted(walls) for model, fitted in _FITTED.items()}
    found[D435DepthNoise] |= _edges_of_d435([board.checked() for board in boards])
    if paper is not None:
        found |= {PaperDepthNoise: _of_paper(paper)}
    fits = []
    for model, settings in found.items():
        known = declared(model)
        settings = {k: v for k, v in settings.items() if known[k].low <= v <= known[k].high}
        others = tuple(name for name in known if name not in settings)
        misfit = _misfit(depth_model(model.name, settings), walls, recorded)
        fits.append(CameraFit(model.name, settings, others, misfit))
    return sorted(fits, key=lambda fit: fit.misfit)


def _of_paper(found: DepthCalibration) -> dict[str, float]:
    of_slopes = {} if found.fixed_sigma_s else {"sigma_s_px": found.sigma_s_px}
    return {"sigma_d": found.sigma_d} | of_slopes


def _fit_d435(walls: Sequence[WallRecording]) -> dict[str, float]:
    """The baseline from the band at the left edge, which the right imager does not see; s and the
    window from the covariance of errors k pixels apart, s^2 (1 - k / window); the ranges from where
    walls are lost.
    """
    baseline_m = _baseline_m(walls)
    settings = {} if baseline_m is None else {"baseline_m": baseline_m}
    model = D435DepthNoise(**settings)
    f_b = model.focal_px * model.baseline_m
    covariances = []
    for wall in walls:
        covariance = f_b**2 * _covariances(wall)
        step_px = f_b * model.depth_step_m / wall.depth_z_m**2
        rounding = (model.step_px**2 + float(np.mean(step_px**2))) / 12
        if covariance[0] > 2 * rounding:  # else rounding hides the noise
            covariance[0] -= rounding
            covariances.append(covariance)
    if covariances:
        variance, window = _triangle(np.mean(covariances, axis=0))
        scale = walls[0].camera.fx / model.focal_px
        settings |= {"subpixel_px": float(np.sqrt(variance)), "window_px": window / scale}
    far, near = [], []
    for wall in walls:
        z = wall.depth_z_m
        seen_twice = np.arange(wall.camera.width) > wall.camera.fx * model.baseline_m / z + 1
        weakness_m = z * np.sqrt(WHITE_ALBEDO / wall.reflected)
        too_far = z > 0.9 * model.far_m
        too_near = f_b / z > 0.8 * model.search_px
        weak = weakness_m > 0.8 * model.pattern_range_m
        grazing = wall.reflected < wall.albedo * np.cos(np.radians(0.9 * model.missing_angle_deg))
        others = seen_twice & ~too_far & ~grazing
        far.append((weakness_m, wall.share_seen, others & ~too_near))
        near.append((f_b / z, wall.share_seen, others & ~weak))
    limits = {"pattern_range_m": _crossing(far), "search_px": _crossing(near)}
    return settings | {name: limit for name, limit in limits.items() if limit is not None}


def _edges_of_d435(boards: Sequence[BoardRecording]) -> dict[str, float]:
    """The growth and the raggedness of edges, in pixels of the device."""
    published = D435DepthNoise()
    found = [
        published.focal_px / board.camera.fx * np.array([board.growth_px, board.ragged_px])
        for board in boards
    ]
    if not found:
        return {}
    fat_px, ragged_px = np.mean(found, axis=0).tolist()
    return {"fat_px": fat_px, "ragged_px": ragged_px}


def _fit_azure_kinect(walls: Sequence[WallRecording]) -> dict[str, float]:
    """The variance along the ray, base^2 + noise^2 r^(2 power) 0.95 / (albedo cos), by least
    squares for each power; the periodic bias from the means; the range from the amplitude at which
    half of the frames lack a pixel.
    """
    published = AzureKinectDepthNoise()
    range_m, share, variance = _along_ray(walls, published.depth_step_m)
    settings: dict[str, float] = {}
    if range_m.max() > _SPAN * range_m.min():
        settings |= _growth(range_m, share, variance)
    wiggles = [found for wall in walls if (found := _wiggle_m(wall, published)) is not None]
    if wiggles:
        settings["wiggle_m"] = float(np.mean(wiggles))
    bright = [0.5 * published.dark_range_m**2 / DARK_ALBEDO * w.reflected for w in walls]
    near = [
        (1 / wall.range_m, wall.share_seen, wall.range_m**2 < most_m2)
        for wall, most_m2 in zip(walls, bright, strict=True)
    ]
    nearest = _crossing(near)
    if nearest is not None:
        settings["near_m"] = 1 / nearest
    return settings | _amplitude_limit(walls, settings.get("near_m", published.near_m))


def _fit_phone(walls: Sequence[WallRecording]) -> dict[str, float]:
    """The number of dots by the pattern of the variance, which is least between dots; sigma of a
    dot from the variance of the means of dots.
    """
    models = [PhoneDepthNoise(dots=dots) for dots in _DOTS]
    model = min(models, key=lambda model: _unevenness(model, walls))
    range_m, sigma_m = _of_dots(model, walls)
    settings: dict[str, float] = {"dots": model.dots}
    if range_m.max() > _SPAN * range_m.min():
        constant, growth = _line(range_m, sigma_m)
        settings |= {"sigma_m": max(constant, 0.0), "sigma_per_m": max(growth, 0.0)}
    return settings


_FITTED: dict[type[NoiseModel], Callable[[Sequence[WallRecording]], dict[str, float]]] = {
    D435DepthNoise: _fit_d435,
    AzureKinectDepthNoise: _fit_azure_kinect,
    PhoneDepthNoise: _fit_phone,
}


def _baseline_m(walls: Sequence[WallRecording]) -> float | None:
    """By the band at the left edge that is missing: n columns at depth Z mean a baseline of more
    than n - 1 and at most n times Z / fx. None if no wall has a band of three columns.
    """
    low, high = [], []
    for wall in walls:
        seen = wall.share_seen > 0.5
        rows = seen.any(1) & seen[:, -1]
        first = seen[rows].argmax(1)
        if rows.mean() < 0.5 or np.median(first) < 3:
            continue
        unit_m = wall.depth_z_m[rows, first] / wall.camera.fx
        low.append(np.median((first - 1) * unit_m))
        high.append(np.median(first * unit_m))
    if not high:
        return None
    # what else is missing at the left edge only widens the band
    most = min(high)
    return float(most + max(least for least in low if least < most)) / 2


def _covariances(wall: WallRecording) -> np.ndarray:
    """Of the errors of inverse depth, k pixels apart in rows and in columns, in 1/m^2."""
    known = np.isfinite(wall.errors)
    errors = np.where(known, wall.errors, 0)
    reach = min(_LARGEST_WINDOW, *(length // 2 for length in errors.shape[1:]))
    products, counts = (
        sum(_correlation(image, reach) for image in images) for images in (errors, known)
    )
    return products / np.maximum(counts, 0.5)


def _correlation(image: np.ndarray, reach: int) -> np.ndarray:
    """Sums of the products of pixels k = 0 .. reach - 1 apart, along rows and along columns."""
    total = np.zeros(reach)
    for axis in (0, 1):
        spectrum = np.fft.rfft(image, 2 * image.shape[axis], axis=axis)
        other = 1 - axis
        total += np.fft.irfft((np.abs(spectrum) ** 2).sum(other))[:reach]
    return total


def _triangle(covariance: np.ndarray) -> tuple[float, int]:
    """Variance v and whole length n of v max(0, 1 - k / n) by least squares."""
    k = np.arange(len(covariance))
    best = (np.inf, 0.0, 1)
    for length in range(1, len(covariance) + 1):
        shape = np.maximum(0, 1 - k / length)
        variance = float(covariance @ shape / (shape @ shape))
        best = min(best, (float(((covariance - variance * shape) ** 2).sum()), variance, length))
    return max(best[1], 0.0), best[2]


def _crossing(walls: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> float | None:
    """Where the share of frames in which a pixel is seen falls below a half as a quantity grows;
    None if the walls do not show both sides of such a place.

    walls: of each wall the quantity, the share, and which pixels count, (h, w).
    """
    values = np.concatenate([value[counts] for value, _, counts in walls])
    shares = np.concatenate([share[counts] for _, share, counts in walls])
    order = np.argsort(values)
    values, seen = values[order], shares[order] > 0.5
    # the place before which most are seen and behind which most are not
    place = int(np.concatenate([[0], np.cumsum(np.where(seen, 1, -1))]).argmax())
    before, behind = seen[:place], seen[place:]
    if min(before.size, behind.size) < _PIXELS or before.mean() < 0.9 or behind.mean() > 0.1:
        return None
    return float(values[place - 1] + values[place]) / 2


def _along_ray(walls: Sequence[WallRecording], step_m: float) -> tuple[np.ndarray, ...]:
    """Range, relative amplitude of the light, and variance along the ray in m^2 without that of
    rounding, of groups of pixels.
    """
    rows = []
    for wall in walls:
        variance = (wall.sigma_m**2 - step_m**2 / 12) * wall.ray_length**2
        rows += _grouped(wall.range_m, wall.reflected / WHITE_ALBEDO, variance)
    if not rows:
        raise InputError("pixels that are measured in every frame", found="none")
    return tuple(np.array(rows).T)


def _growth(range_m: np.ndarray, share: np.ndarray, variance: np.ndarray) -> dict[str, float]:
    """base, noise and power of the variance base^2 + noise^2 r^(2 power) / share."""
    best = (np.inf, np.zeros(2), 0.0)
    for power in np.arange(0.5, 2.5, 0.005):
        design = np.column_stack([np.ones_like(range_m), range_m ** (2 * power) / share])
        terms = np.linalg.lstsq(design / variance[:, None], np.ones_like(variance), rcond=None)[0]
        misfit = float(((design @ terms / variance - 1) ** 2).sum())
        if misfit < best[0]:
            best = (misfit, terms, float(power))
    base, noise = np.sqrt(np.maximum(best[1], 0))
    return {"base_m": float(base), "noise_m": float(noise), "power": best[2]}


def _wiggle_m(wall: WallRecording, model: AzureKinectDepthNoise) -> float | None:
    """Amplitude of the periodic error of the mean along the ray, beside an error of the plane; None
    on a wall that spans less than two periods.
    """
    period_m = 2 * np.pi / model.wiggles_per_m
    mean, count = mean_of_seen(inverse_depth(wall.frames))
    seen = count == len(wall.frames)
    r = wall.range_m[seen]
    if not r.size or np.ptp(r) < 2 * period_m:
        return None
    v, u = (
        place[seen] / wall.camera.width for place in np.mgrid[0 : seen.shape[0], 0 : seen.shape[1]]
    )
    error_m = (1 / mean[seen] - wall.depth_z_m[seen]) * wall.ray_length[seen]
    of_plane = r * wall.depth_z_m[seen]
    phase = model.wiggles_per_m * r
    design = np.column_stack([of_plane, of_plane * u, of_plane * v, np.sin(phase), np.cos(phase)])
    terms = np.linalg.lstsq(design, error_m, rcond=None)[0]
    return float(np.hypot(*terms[3:]))


def _amplitude_limit(walls: Sequence[WallRecording], near_m: float) -> dict[str, float]:
    """The darkest amplitude and its relative noise: the share of frames in which a pixel is seen is
    Phi((1 - darkest / amplitude) / noise). What is missing because it is near says nothing.
    """
    rows = []
    for wall in walls:
        weakness = np.where(wall.range_m > 1.05 * near_m, wall.range_m**2 / wall.reflected, np.nan)
        rows += [
            (x, NormalDist().inv_cdf(p))
            for x, p in _grouped(weakness, wall.share_seen)
            if 0.02 < p < 0.98
        ]
    if len(rows) < 3:
        return {}
    weakness, quantile = np.array(rows).T
    constant, slope = _line(weakness, quantile, relative=False)
    if constant <= 0 or slope >= 0:
        return {}
    darkest = -slope / constant
    return {
        "dark_range_m": float(np.sqrt(DARK_ALBEDO / darkest)),
        "amplitude_noise": float(1 / constant),
    }


def _unevenness(model: PhoneDepthNoise, walls: Sequence[WallRecording]) -> float:
    """How much the sigma of dots, as the variance of their means says it, differs between pixels
    at the same distance.
    """
    uneven = []
    for wall in walls:
        sigma_m = _sigma_of_dots(model, wall)
        known = np.zeros(sigma_m.shape, bool)
        height, width = sigma_m.shape  # the grid of the fewest dots is not extended in the middle
        middle = np.s_[height // 8 : -height // 8 : 4, width // 8 : -width // 8 : 4]
        known[middle] = np.isfinite(sigma_m[middle])
        r, log_sigma = wall.range_m[known], np.log(sigma_m[known])
        trend = np.column_stack([np.ones_like(r), r])
        uneven.append(np.std(log_sigma - trend @ np.linalg.lstsq(trend, log_sigma, rcond=None)[0]))
    return float(np.mean(uneven))


def _sigma_of_dots(model: PhoneDepthNoise, wall: WallRecording) -> np.ndarray:
    """(h, w): the sigma along the ray of dots that would give a pixel its variance."""
    share = model.share_of_variance(wall.camera)
    with np.errstate(divide="ignore"):
        sigma_m = wall.sigma_m / np.sqrt(share) * wall.ray_length
    return np.where(sigma_m > 0, sigma_m, np.nan)


def _of_dots(
    model: PhoneDepthNoise, walls: Sequence[WallRecording]
) -> tuple[np.ndarray, np.ndarray]:
    """Range and sigma of dots, of groups of pixels."""
    rows = []
    for wall in walls:
        rows += _grouped(wall.range_m, _sigma_of_dots(model, wall) ** 2)
    if not rows:
        raise InputError("pixels that are measured in every frame", found="none")
    range_m, variance = np.array(rows).T
    return range_m, np.sqrt(variance)


def _grouped(first: np.ndarray, *others: np.ndarray) -> list[tuple[float, ...]]:
    """Means of images (h, w) over groups of pixels with similar values of the first one, where none
    of them is NaN.
    """
    known = np.logical_and.reduce([np.isfinite(image) for image in (first, *others)])
    if known.sum() < _PIXELS:
        return []
    order = np.argsort(first[known])
    images = [image[known][order] for image in (first, *others)]
    groups = np.array_split(np.arange(order.size), min(_GROUPS, order.size // _PIXELS))
    return [tuple(float(image[group].mean()) for image in images) for group in groups]


def _line(x: np.ndarray, y: np.ndarray, relative: bool = True) -> tuple[float, float]:
    """a and b of y = a + b x by least squares, of relative deviations or of plain ones."""
    weight = 1 / y if relative else np.ones_like(y)
    design = np.column_stack([np.ones_like(x), x]) * weight[:, None]
    constant, slope = np.linalg.lstsq(design, y * weight, rcond=None)[0]
    return float(constant), float(slope)


def _misfit(noise: Noise, walls: Sequence[WallRecording], recorded: Sequence[np.ndarray]) -> float:
    """RMS difference of the signs `recorded` of walls and those of the same walls made by a model."""
    differences = []
    for number, (wall, signs) in enumerate(zip(walls, recorded, strict=True)):
        made = WallRecording(_made(noise, wall, number), wall.camera, wall.albedo)
        differences.append(_signs(made) - signs)
    return float(np.sqrt(np.mean(np.square(differences))))


def _made(noise: Noise, wall: WallRecording, number: int) -> np.ndarray:
    """Frames of the wall's plane by the model."""
    appearance = SurfaceAppearance.given(wall.depth_z_m.shape, albedo=wall.albedo)
    generators = (frame_generator(number, k, DEPTH) for k in range(_COMPARED))
    return np.stack(
        [with_depth_noise(noise, wall.depth_z_m, wall.camera, g, appearance) for g in generators]
    )


def _signs(wall: WallRecording) -> np.ndarray:
    """By which models differ: logarithm of sigma, correlations of neighbours, missing share."""
    errors = wall.errors
    missing = float((wall.share_seen < 1).mean())
    if not np.nanmax(errors, initial=0.0) > 0:
        return np.array([_NOTHING, *(0.0 for _ in _APART_PX), missing])
    variance = np.nanmean(errors**2)
    pairs = (errors[:, :, k:] * errors[:, :, :-k] for k in _APART_PX)
    correlations = [float(np.nanmean(pair) / variance) for pair in pairs]
    sigma = 0.5 * np.log(variance) + 2 * np.log(np.median(wall.depth_z_m))
    return np.array([sigma, *correlations, missing])
