"""Pictures made of arrays, numpy only: a frame's three views side by side, depth in colour, a plot of errors."""

from __future__ import annotations

import numpy as np

#: Blue, cyan, green, yellow, red: near to far, small to large.
_STOPS = np.array([[0.15, 0.2, 0.75], [0.1, 0.7, 0.9], [0.25, 0.8, 0.3], [1.0, 0.85, 0.15], [0.9, 0.15, 0.1]])
_PAPER, _INK, _GRID = 255, (30, 30, 30), (215, 215, 215)

#: Glyphs of 3 x 5 dots, a digit a row, its bits the dots from left to right.
_GLYPHS = {
    "0": "75557", "1": "26227", "2": "71747", "3": "71717", "4": "55711", "5": "74717", "6": "74757", "7": "71222",
    "8": "75757", "9": "75717", ".": "00002", "-": "00700", " ": "00000", "A": "25755", "T": "72222", "E": "74647",
    "M": "57755", "C": "74447", "S": "34216", "R": "65655", "P": "65644", "(": "12221", ")": "42224", "/": "11244",
    "F": "74644", "O": "75557", "I": "72227", "N": "65555", "D": "65556", "G": "34553", "H": "55755", "L": "44447",
    "U": "55557", "X": "55255", "Y": "55222", "B": "65656", "V": "55552", "W": "55775", ",": "00024", ":": "02020",
}  # fmt: skip


def ramp(share: np.ndarray) -> np.ndarray:
    """(...) in 0..1 -> (..., 3) in 0..1."""
    place = np.clip(np.nan_to_num(np.asarray(share, float)), 0, 1) * (len(_STOPS) - 1)
    low = np.minimum(place.astype(int), len(_STOPS) - 2)
    return _STOPS[low] + (place - low)[..., None] * (_STOPS[low + 1] - _STOPS[low])


def error_colours(error_m: np.ndarray) -> np.ndarray:
    """(n,) -> (n, 3), blue for none, red for the largest."""
    return ramp(error_m / max(float(np.max(error_m)), 1e-12))


def depth_colours(depth_z_m: np.ndarray, near_m: float, far_m: float) -> np.ndarray:
    """(h, w) metres -> (h, w, 3) uint8; black where there is no measurement."""
    colours = ramp((depth_z_m - near_m) / max(far_m - near_m, 1e-6)) * 255
    return np.where((depth_z_m > 0)[..., None], colours, 0).astype(np.uint8)


def frame_picture(rgb: np.ndarray, depth_z_m: np.ndarray, noisy_rgb: np.ndarray, noisy_z_m: np.ndarray) -> np.ndarray:
    """Clean colour and depth above, the sensor's below: (2h, 2w, 3) uint8; one range of depth for both."""
    seen = depth_z_m[depth_z_m > 0]
    # a garden seen through the window would take all colours for itself
    near_m, far_m = map(float, np.quantile(seen, (0.01, 0.95))) if seen.size else (0.0, 1.0)
    top = np.hstack([rgb, depth_colours(depth_z_m, near_m, far_m)])
    bottom = np.hstack([noisy_rgb, depth_colours(noisy_z_m, near_m, far_m)])
    return np.vstack([top, bottom])


def error_plot(
    stamps_s: np.ndarray, error_m: np.ndarray, rmse_m: float, width: int = 720, height: int = 480
) -> np.ndarray:
    """Error over time in centimetres, coloured as in the view, the RMSE as a dark line: (height, width, 3) uint8."""
    image = np.full((height, width, 3), _PAPER, np.uint8)
    left, right, top, bottom = 80, width - 20, 50, height - 50
    most_cm = _round_up(float(error_m.max()) * 100)
    seconds = float(stamps_s[-1] - stamps_s[0]) or 1.0
    for k in range(5):
        row = round(bottom - k / 4 * (bottom - top))
        image[row, left:right] = _GRID
        write(image, f"{most_cm * k / 4:.3g}", 12, row - 5)
        column = round(left + k / 4 * (right - left))
        image[top:bottom, min(column, right - 1)] = _GRID
        write(image, f"{seconds * k / 4:.3g}", min(column - 8, width - 50), bottom + 10)
    x = left + (stamps_s - stamps_s[0]) / seconds * (right - left - 1)
    y = bottom - error_m * 100 / most_cm * (bottom - top)
    columns = np.arange(left, right)
    rows = np.interp(columns, x, y)
    colours = (error_colours(np.interp(columns, x, error_m)) * 255).astype(np.uint8)
    for place, height_px, before, colour in zip(columns, rows, np.r_[rows[0], rows[:-1]], colours, strict=True):
        a, b = sorted((int(round(before)), int(round(height_px))))
        image[a - 1 : b + 2, place] = colour
    image[max(round(bottom - rmse_m * 100 / most_cm * (bottom - top)), 0), left:right] = _INK
    write(image, f"ATE (CM) OVER TIME (S), RMSE {rmse_m * 100:.2f} CM", left, 16, 3)
    return image


def write(image: np.ndarray, text: str, x: int, y: int, size: int = 2) -> None:
    """Letters of 3 x 5 dots onto the image, in place; capitals only."""
    for letter in text.upper():
        dots = np.array([[int(row) >> (2 - k) & 1 for k in range(3)] for row in _GLYPHS.get(letter, "00000")], bool)
        block = np.kron(dots, np.ones((size, size), bool))
        target = image[y : y + block.shape[0], x : x + block.shape[1]]
        target[block[: target.shape[0], : target.shape[1]]] = _INK
        x += 4 * size


def _round_up(value: float) -> float:
    """To 1, 2 or 5 times a power of ten, times 4 divisible."""
    if value <= 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(m * power for m in (1, 2, 4, 5, 8, 10) if m * power >= value * 0.999))
