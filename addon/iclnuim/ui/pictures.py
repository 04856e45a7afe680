"""Images made from arrays with numpy only: colour and depth side by side, depth in false colours, a
plot of the error.
"""

from typing import Any

import numpy as np
import numpy.typing as npt

from ..shown import depth_colours, depth_range, ramp

_PAPER = 255
#: Width of a title in dots of its letters.
_TITLE_WIDTH = 160
_INK = (30, 30, 30)
_GRID = (215, 215, 215)

#: Glyphs of 5 x 7 dots. Each row is one digit of base 32, from the top; its bits are the dots from
#: left to right.
_GLYPHS = {
    chr(32): "0000000",
    "0": "ehjlphe", "1": "4c4444e", "2": "eh1248v", "3": "v2421he", "4": "26aiv22",
    "5": "vgu11he", "6": "68guhhe", "7": "v124888", "8": "ehhehhe", "9": "ehhf12c",
    ".": "00000cc", ",": "0000c48", "-": "000v000", "(": "2488842", ")": "8422248",
    ":": "0cc0cc0", "/": "01248g0", "A": "ehhhvhh", "E": "vgguggv", "R": "uhhukih",
    "T": "v444444", "a": "00e1fhf", "b": "ggmphhu", "c": "00egghe", "d": "11djhhf",
    "e": "00ehvge", "f": "698s888", "g": "0fhhf1e", "h": "ggmphhh", "i": "40c444e",
    "l": "c44444e", "m": "00qllhh", "n": "00mphhh", "o": "00ehhhe", "p": "00uhugg",
    "r": "00mpggg", "s": "00ege1u", "t": "88s8896", "u": "00hhhjd", "v": "00hhha4",
    "w": "00hhlla", "x": "00ha4ah", "y": "00hhf1e",
}  # fmt: skip


def error_colours(error_m: np.ndarray) -> np.ndarray:
    """(n,) errors -> (n, 3) colours: blue for no error, red for the largest error."""
    return ramp(error_m / max(float(np.max(error_m)), 1e-12))


def frame_picture(
    rgb: np.ndarray, depth_z_m: np.ndarray, noisy_rgb: np.ndarray, noisy_z_m: np.ndarray
) -> np.ndarray:
    """Colour and depth without noise above, with the sensor's noise below, each row under its
    title: (about 2.15 h, 2w, 3) uint8.

    Both depth images use one range.
    """
    near_m, far_m = depth_range(depth_z_m)
    width = rgb.shape[1]
    size = max(width // _TITLE_WIDTH, 1)
    titles = np.full((2, 11 * size, 2 * width, 3), _PAPER, np.uint8)
    for title, name in zip(titles, ("clean", "noisy"), strict=True):
        write(title, name, 2 * size, 2 * size, size)
        depth = f"blue {near_m:.2f} m, red {far_m:.2f} m"
        write(title, depth, width + 2 * size, 2 * size, size)
    noisy = np.hstack([noisy_rgb, depth_colours(noisy_z_m, near_m, far_m)])
    return np.vstack([titles[0], colour_and_depth(rgb, depth_z_m), titles[1], noisy])


def colour_and_depth(rgb: np.ndarray, depth_z_m: np.ndarray) -> np.ndarray:
    """The colour image and the depth in false colours side by side: (h, 2w, 3) uint8."""
    return np.hstack([rgb, depth_colours(depth_z_m, *depth_range(depth_z_m))])


def error_plot(stamps_s: np.ndarray, error_m: np.ndarray, rmse_m: float) -> np.ndarray:
    """Plot of the error over time in millimetres: (600, 960, 3) uint8.

    Colours are those of the 3D view; a dark line is the RMSE.
    """
    width, height = 960, 600
    image = np.full((height, width, 3), _PAPER, np.uint8)
    left = 90
    right = width - 30
    top = 70
    bottom = height - 70
    seconds = float(stamps_s[-1] - stamps_s[0]) or 1.0
    ticks_mm = _ticks(1000 * float(error_m.max()))
    ticks_s = _ticks(seconds, beyond=False)

    def row(error_mm: npt.ArrayLike) -> Any:
        return np.rint(bottom - np.asarray(error_mm) / ticks_mm[-1] * (bottom - top)).astype(int)

    for tick in ticks_mm:
        image[row(tick), left:right] = _GRID
        write(image, f"{tick:.6g}", left - 14, row(tick) - 7, align="right")
    for tick in ticks_s:
        column = round(left + tick / seconds * (right - left - 1))
        image[top:bottom, column] = _GRID
        write(image, f"{tick:.6g}", column, bottom + 12, align="centre")
    columns = np.arange(left, right)
    times_s = (columns - left) / (right - left - 1) * seconds
    values_m = np.interp(times_s, stamps_s - stamps_s[0], error_m)
    colours = (error_colours(values_m) * 255).astype(np.uint8)
    rows = row(values_m * 1000)
    before = rows[0]
    for column, here, colour in zip(columns, rows, colours, strict=True):
        # a line from each value to the next
        image[min(here, before) - 1 : max(here, before) + 2, column] = colour
        before = here
    image[row(rmse_m * 1000) : row(rmse_m * 1000) + 2, left:right] = _INK
    write(image, f"Error of the position over time, ATE rmse {rmse_m * 1000:.3f} mm", left, 20)
    write(image, "mm", left - 14, top - 26, align="right")
    write(image, "time (s)", right, bottom + 40, align="right")
    return image


def _ticks(maximum: float, beyond: bool = True) -> np.ndarray:
    """About five round numbers from 0.

    The last is the first one at or above `maximum` if `beyond`, else the last one at or below it.
    """
    if maximum <= 0:
        maximum = 1.0
    power = 10.0 ** np.floor(np.log10(maximum / 5))
    step = next(m * power for m in (1, 2, 5, 10) if m * power >= maximum / 6 * 0.999)
    count = np.floor(maximum / step + 1e-9)
    if beyond:
        count = np.ceil(maximum / step - 1e-9)
    return np.arange(int(count) + 1) * step


def write(image: np.ndarray, text: str, x: int, y: int, size: int = 2, align: str = "left") -> None:
    """Draw text in letters of 5 x 7 dots into the image, in place.

    (x, y) is the left end, the centre or the right end of the text's upper edge.
    """
    glyphs = [_GLYPHS[letter] for letter in text]
    rows = np.array([[int(digit, 32) for digit in glyph] for glyph in glyphs])
    # (letters, rows, columns), the sixth column of a letter is empty
    dots = (rows[..., None] << 1 >> np.arange(5, -1, -1) & 1).astype(bool)
    block = np.kron(np.concatenate(list(dots), 1), np.ones((size, size), bool))
    x -= {"left": 0, "centre": block.shape[1] // 2, "right": block.shape[1]}[align]
    target = image[max(y, 0) : y + block.shape[0], max(x, 0) : x + block.shape[1]]
    target[block[max(-y, 0) :, max(-x, 0) :][: target.shape[0], : target.shape[1]]] = _INK
