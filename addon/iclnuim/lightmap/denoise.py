"""Image processing of a light map: denoising that keeps the edges of shadows, filling of empty
texels, measurement of contrast.

The denoiser uses edge-avoiding wavelets (Dammertz et al. 2010) controlled by the estimated noise
(Schied et al. 2017): two independent halves of the samples give the variance of each texel. The
weight of a neighbour depends on whether their difference can be noise; only neighbours in the same
chart are used. Each half is smoothed with weights from the other (Rousselle et al. 2012), so that a
firefly does not increase its own weight.
"""

from itertools import product

import numpy as np

_LEVELS = 5
#: Differences up to this many standard deviations are treated as noise.
_SIGMAS = 2.0
_KERNEL = {-1: 0.25, 0: 0.5, 1: 0.25}
_NORMAL_POWER = 32
#: A texel is a firefly (a rare bright path in one half) if its halves differ by more than this
#: factor times the median of its neighbours.
_ODD = 6.0
#: Neighbours of a texel at the corner of a chart.
_CORNER = 3
_NEIGHBOURS = [step for step in product((-1, 0, 1), (-1, 0, 1)) if any(step)]


def denoise(
    half_a: np.ndarray,
    half_b: np.ndarray,
    chart: np.ndarray,
    normals: np.ndarray,
    usable: np.ndarray,
) -> np.ndarray:
    """Denoised light (h, w, 3) from two halves (h, w, 3); chart (h, w) with -1 outside, normals (h,
    w, 3), usable (h, w) bool.
    """
    half_a, half_b = _without_fireflies(half_a, half_b, chart, usable)
    variance = _variance(half_a, half_b, chart, usable)
    a = half_a.astype(np.float32), variance
    b = half_b.astype(np.float32), variance.copy()
    wavelet = _Wavelet(chart, normals.astype(np.float32), usable & (chart >= 0))
    for level in range(_LEVELS):
        smoothed = wavelet.smoothed(*a, b[0], 1 << level)
        b = wavelet.smoothed(*b, a[0], 1 << level)
        a = smoothed
    return _within_neighbours((a[0] + b[0]) / 2, chart, wavelet.mask)


def _within_neighbours(light: np.ndarray, chart: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """`light` (h, w, 3) with each usable texel limited to the range of its neighbours, by channel
    (conservative smoothing).

    A texel that is brighter or darker than all around it is a firefly that both halves found, or a
    point with another view than theirs. At the corner of a chart it has three neighbours; with
    fewer it is kept.
    """
    lowest = np.full_like(light, np.inf)
    highest = np.full_like(light, -np.inf)
    count = np.zeros(usable.shape, np.uint8)
    for dy, dx in _NEIGHBOURS:
        same = shifted(usable, dy, dx, False) & _same_chart(chart, dy, dx)
        beside = shifted(light, dy, dx, 0)
        np.minimum(lowest, beside, out=lowest, where=same[..., None])
        np.maximum(highest, beside, out=highest, where=same[..., None])
        count += same
    limited = usable & (count >= _CORNER)
    return np.where(limited[..., None], np.clip(light, lowest, highest), light)


def luminance(light: np.ndarray) -> np.ndarray:
    return light @ np.array([0.2126, 0.7152, 0.0722], np.float32)


def _without_fireflies(
    half_a: np.ndarray, half_b: np.ndarray, chart: np.ndarray, usable: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where the halves differ far more than their neighbours do, both get the darker value. Edges
    of light agree in both halves and stay.

    The light that is cut off is correct energy, found by few paths: it is distributed over the
    neighbourhood, so that none is lost.
    """
    a = luminance(half_a)
    b = luminance(half_b)
    gap = np.abs(a - b).astype(np.float32)
    around = []
    for dy, dx in _NEIGHBOURS:
        around.append(np.where(_same_chart(chart, dy, dx), shifted(gap, dy, dx, 0), gap))
    usual = np.median(around, axis=0)
    odd = (usable & (gap > _ODD * usual + 0.1 * np.minimum(a, b)))[..., None]
    darker = np.where((a < b)[..., None], half_a, half_b)
    clean_a = np.where(odd, darker, half_a)
    clean_b = np.where(odd, darker, half_b)
    spread = _spread((half_a - clean_a + half_b - clean_b) / 2, chart, usable)
    return clean_a + spread, clean_b + spread


def _spread(light: np.ndarray, chart: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """Distribute light (h, w, 3) over the usable texels of its chart, within about 2^_LEVELS
    texels.
    """
    share = usable.astype(np.float32)[..., None]
    light = light.astype(np.float32) * share
    for step in [1 << level for level in range(_LEVELS)]:
        for axis in ((step, 0), (0, step)):
            total = _KERNEL[0] * light
            count = _KERNEL[0] * share
            for sign in (-1, 1):
                dy = axis[0] * sign
                dx = axis[1] * sign
                same = _same_chart(chart, dy, dx)[..., None] * share
                total += _KERNEL[1] * same * shifted(light, dy, dx, 0)
                count += _KERNEL[1] * same * shifted(share, dy, dx, 0)
            light = total / np.maximum(count, 1e-6)
    return light


def _variance(
    half_a: np.ndarray, half_b: np.ndarray, chart: np.ndarray, usable: np.ndarray
) -> np.ndarray:
    """Variance of one half's luminance: (a - b)^2 / 2, averaged over the neighbourhood, because a
    single difference is a poor estimate.
    """
    raw = np.where(usable, luminance(half_a - half_b) ** 2 / 2, 0).astype(np.float32)
    total = raw
    count = usable.astype(np.float32)
    for step in (1, 2):
        for axis in ((1, 0), (0, 1)):
            sums = total.copy()
            counts = count.copy()
            for sign in (-1, 1):
                dy = axis[0] * step * sign
                dx = axis[1] * step * sign
                same = _same_chart(chart, dy, dx)
                sums += np.where(same, shifted(total, dy, dx, 0), 0)
                counts += np.where(same, shifted(count, dy, dx, 0), 0)
            total = sums
            count = counts
    return total / np.maximum(count, 1)


class _Wavelet:
    """The filter on a map with charts, normals (h, w, 3) and a mask (h, w) of the texels in use."""

    def __init__(self, chart: np.ndarray, normals: np.ndarray, mask: np.ndarray) -> None:
        self.mask = mask
        self._here = np.flatnonzero(mask)
        self._part = np.where(mask, chart, -1).ravel()
        self._facing = normals.reshape(-1, 3)

    def smoothed(
        self, light: np.ndarray, variance: np.ndarray, guide: np.ndarray, step: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """One level of the filter: nine neighbours `step` texels apart, with weights from `guide`.

        Returns light and its variance.
        """
        here = self._here
        flat = light.reshape(-1, 3)
        spread = variance.ravel()
        bright = luminance(guide.reshape(-1, 3))
        total = np.zeros((len(here), 3), np.float32)
        noise = np.zeros(len(here), np.float32)
        weights = np.zeros(len(here), np.float32)
        for dy, wy in _KERNEL.items():
            for dx, wx in _KERNEL.items():
                there, same = self._beside(dy * step, dx * step)
                noise_of_both = _SIGMAS**2 * (spread[there] + spread[here]) + 1e-10
                apart = (bright[there] - bright[here]) ** 2 / noise_of_both
                cosine = np.einsum("ij,ij->i", self._facing[there], self._facing[here])
                alike = np.maximum(cosine, 0) ** _NORMAL_POWER
                weight = (same * (wy * wx) * alike * np.exp(-apart)).astype(np.float32)
                total += weight[:, None] * flat[there]
                noise += weight**2 * spread[there]
                weights += weight
        flat = flat.copy()
        spread = spread.copy()
        weighed = weights > 0  # a texel without a normal has no neighbour, and keeps its light
        flat[here[weighed]] = total[weighed] / weights[weighed, None]
        spread[here[weighed]] = noise[weighed] / weights[weighed] ** 2
        return flat.reshape(light.shape), spread.reshape(variance.shape)

    def _beside(self, dy: int, dx: int) -> tuple[np.ndarray, np.ndarray]:
        """Flat indices of the neighbours at (dy, dx), and whether each is in the same chart."""
        h, w = self.mask.shape
        y = self._here // w + dy
        x = self._here % w + dx
        there = np.clip(y, 0, h - 1) * w + np.clip(x, 0, w - 1)
        inside = (y >= 0) & (y < h) & (x >= 0) & (x < w)
        return there, inside & (self._part[there] == self._part[self._here])


def shifted(image: np.ndarray, dy: int, dx: int, outside: float | int) -> np.ndarray:
    """result[y, x] = image[y + dy, x + dx], or `outside` beyond the border."""
    result = np.full_like(image, outside)
    h, w = image.shape[:2]
    ys = slice(max(0, -dy), min(h, h - dy))
    xs = slice(max(0, -dx), min(w, w - dx))
    yt = slice(max(0, dy), min(h, h + dy))
    xt = slice(max(0, dx), min(w, w + dx))
    result[ys, xs] = image[yt, xt]
    return result


def _same_chart(chart: np.ndarray, dy: int, dx: int) -> np.ndarray:
    """(h, w) bool: whether the neighbour at (dy, dx) is in the same chart; chart (h, w), -1
    outside.
    """
    return shifted(chart, dy, dx, -2) == chart


def next_to_known(known: np.ndarray, chart: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Flat indices of unknown texels that have a known neighbour in the same chart, and flat
    indices of the nearest such neighbour.
    """
    place = np.arange(known.size).reshape(known.shape)
    nearest = np.full(known.shape, -1)
    for dy, dx in sorted(_NEIGHBOURS, key=lambda step: abs(step[0]) + abs(step[1])):
        usable = ~known & (nearest < 0) & shifted(known, dy, dx, False) & _same_chart(chart, dy, dx)
        nearest[usable] = place[usable] + dy * known.shape[1] + dx
    rows = np.flatnonzero((nearest >= 0) & (chart >= 0))
    return rows, nearest.ravel()[rows]


def grown(mask: np.ndarray, chart: np.ndarray, steps: int) -> np.ndarray:
    """(h, w) bool: the texels of `mask` (h, w), and those within `steps` neighbours of them in the
    same chart; chart (h, w), -1 outside.
    """
    same = [(step, (chart >= 0) & _same_chart(chart, *step)) for step in _NEIGHBOURS]
    for _ in range(steps):
        reached = [alike & shifted(mask, *step, False) for step, alike in same]
        mask = np.logical_or.reduce([mask, *reached])
    return mask


def fill(
    light: np.ndarray, known: np.ndarray, chart: np.ndarray, steps: int
) -> tuple[np.ndarray, np.ndarray]:
    """Fill unknown texels with the mean of their known neighbours in the same chart, `steps` times.

    light (h, w, 3), known (h, w) bool, chart (h, w) int with -1 outside charts: these texels use
    neighbours of any chart. Returns the new light and the new mask of known texels.
    """
    light = light.copy()
    known = known.copy()
    for _ in range(steps):
        beside = known | shifted(known, 1, 0, False) | shifted(known, -1, 0, False)
        beside |= shifted(beside, 0, 1, False) | shifted(beside, 0, -1, False)
        rows = np.nonzero(~known & beside)
        if not len(rows[0]):
            break
        total = np.zeros((len(rows[0]), light.shape[2]))
        count = np.zeros(len(rows[0]))
        for dy, dx in _NEIGHBOURS:
            y = rows[0] + dy
            x = rows[1] + dx
            inside = (y >= 0) & (y < known.shape[0]) & (x >= 0) & (x < known.shape[1])
            y = np.where(inside, y, 0)
            x = np.where(inside, x, 0)
            usable = inside & known[y, x] & ((chart[rows] < 0) | (chart[y, x] == chart[rows]))
            weight = usable * (1.0 if dy == 0 or dx == 0 else 0.5)
            total += light[y, x] * weight[:, None]
            count += weight
        reached = count > 0
        places = (rows[0][reached], rows[1][reached])
        light[places] = total[reached] / count[reached, None]
        known[places] = True
    return light, known


def contrast(half_a: np.ndarray, half_b: np.ndarray, chart: np.ndarray) -> np.ndarray:
    """(h, w) squared differences of brightness to the neighbouring texels of a chart, from two
    independent halves (h, w, 3) of the light.

    Brightness is the square root of light, similar to the values of an image. The product of both
    halves' differences has no bias from their noise; single values may be negative. chart (h, w),
    -1 outside.
    """
    a = np.sqrt(np.maximum(luminance(half_a), 0))
    b = np.sqrt(np.maximum(luminance(half_b), 0))
    total = np.zeros(chart.shape)
    for dy, dx in ((0, 1), (1, 0), (0, -1), (-1, 0)):
        same = (chart >= 0) & _same_chart(chart, dy, dx)
        total += np.where(same, (shifted(a, dy, dx, 0) - a) * (shifted(b, dy, dx, 0) - b), 0)
    return total / 4
