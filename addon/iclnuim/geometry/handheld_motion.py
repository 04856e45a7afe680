"""The parts of hand-held motion: a C2 spline, an eased pace along it, and band-limited shake. Arrays in, arrays out."""

from __future__ import annotations

import numpy as np

from ..errors import InputError


def natural_spline(knots: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The natural cubic spline through `values` (n, d) at rising `knots` (n,), n >= 2, read `at` (m,): (m, d).

    It is C2, without curvature at its ends; beyond them the end pieces run on.
    """
    h = np.diff(knots)
    slopes = np.diff(values, axis=0) / h[:, None]
    curvatures = _spline_curvatures(h, slopes)
    piece = np.clip(np.searchsorted(knots, at, side="right") - 1, 0, len(h) - 1)
    b = ((at - knots[piece]) / h[piece])[:, None]
    a = 1.0 - b
    bend = (a * a * a - a) * curvatures[piece] + (b * b * b - b) * curvatures[piece + 1]
    return a * values[piece] + b * values[piece + 1] + bend * (h[piece] * h[piece])[:, None] / 6.0


def _spline_curvatures(h: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Second derivatives (n, d) at the knots; plain elimination does the same operations on every machine."""
    n = len(h) + 1
    curvatures = np.zeros((n, slopes.shape[1]))
    diagonal = np.zeros(n)
    for k in range(1, n - 1):
        diagonal[k] = 2.0 * (h[k - 1] + h[k])
        curvatures[k] = 6.0 * (slopes[k] - slopes[k - 1])
        if k > 1:
            factor = h[k - 1] / diagonal[k - 1]
            diagonal[k] -= factor * h[k - 1]
            curvatures[k] -= factor * curvatures[k - 1]
    for k in range(n - 2, 0, -1):
        following = h[k] * curvatures[k + 1] if k < n - 2 else 0.0
        curvatures[k] = (curvatures[k] - following) / diagonal[k]
    return curvatures


def eased_progress(legs: np.ndarray, dwells_s: np.ndarray, ease_s: float, times_s: np.ndarray) -> np.ndarray:
    """How far along the path a person is at `times_s` (m,): from 0 to sum(legs), at one rate, at rest in each dwell.

    `legs` (n-1,) are the lengths between n stops in any unit, `dwells_s` (n,) the rests at the stops. Starts and stops
    take `ease_s` and follow a quintic step, so that the progress is C3 in time. Raises InputError where the rests leave
    no time.
    """
    duration_s = times_s[-1] - times_s[0]
    moving_s = duration_s - ease_s - dwells_s.sum()
    if moving_s <= 0:
        raise InputError("dwells shorter than the whole", found=f"{dwells_s.sum():.1f} of {duration_s:.1f} s")
    rate = legs.sum() / moving_s
    progress = np.zeros(len(times_s))
    clock_s = times_s[0] + ease_s / 2
    for leg, dwell_s in zip([0.0, *legs], dwells_s, strict=True):
        clock_s += leg / rate
        if leg:
            progress -= rate * _eased_ramp(times_s - clock_s, ease_s)
        clock_s += dwell_s
        progress += rate * _eased_ramp(times_s - clock_s, ease_s)
    # the last stop is not left again
    return progress - rate * _eased_ramp(times_s - clock_s, ease_s)


def _eased_ramp(t: np.ndarray, ease_s: float) -> np.ndarray:
    """max(t, 0) with its bend rounded over |t| < ease/2: the integral of the quintic step 6x^5 - 15x^4 + 10x^3."""
    x = np.clip(t / ease_s + 0.5, 0.0, 1.0)
    rounded = ease_s * x * x * x * x * ((x - 3.0) * x + 2.5)
    return np.where(t > ease_s / 2, t, rounded)


def band_noise(
    count: int, rate_hz: float, low_hz: float, high_hz: float, slope: float, channels: int, rng: np.random.Generator
) -> np.ndarray:
    """(count, channels) of periodic random motion, power falling as f^-slope in low..high Hz, each channel of RMS 1.

    A sum of cosines at the series' own frequencies k / duration with random phases, so that the RMS is exact. Raises
    InputError where the band holds no such frequency.
    """
    frequencies_hz = np.arange(count // 2 + 1) * rate_hz / count
    inside = (frequencies_hz >= low_hz) & (frequencies_hz <= high_hz) & (frequencies_hz < rate_hz / 2)
    if not inside.any():
        raise InputError(f"a band that {count} frames can hold", found=f"{low_hz:g}..{high_hz:g} Hz")
    amplitudes = (frequencies_hz[inside] / low_hz) ** (-slope / 2)
    amplitudes *= np.sqrt(2.0 / (amplitudes * amplitudes).sum())
    spectrum = np.zeros((channels, len(inside)), complex)
    phases = 2.0 * np.pi * rng.random((channels, len(amplitudes)))
    spectrum[:, inside] = amplitudes * (np.cos(phases) + 1j * np.sin(phases)) * (count / 2)
    return np.fft.irfft(spectrum, count).T
