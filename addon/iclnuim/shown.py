"""How results show themselves: one line in a terminal, a table in a notebook, Matplotlib axes."""

from collections.abc import Iterator
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MM = 1e3
#: Distinguishable with colour blindness (Okabe and Ito's set, without yellow).
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000")
#: Ending of a name -> the factor to the unit of tables, and that unit.
_UNITS = (("_m", MM, "mm"), ("_rad", float(np.degrees(1)), "°"))
#: Blue, cyan, green, yellow, red: near to far, small to large.
_STOPS = np.array(
    [[0.15, 0.2, 0.75], [0.1, 0.7, 0.9], [0.25, 0.8, 0.3], [1.0, 0.85, 0.15], [0.9, 0.15, 0.1]]
)


class Brief:
    """Base of dataclasses with arrays: their repr has the shape of each array, not its numbers."""

    def __repr__(self) -> str:
        words = [f"{name}={_brief(value)}" for name, value in vars(self).items()]
        return f"{type(self).__name__}({', '.join(words)})"


def _brief(value: object) -> str:
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape}"
    if isinstance(value, float):
        return f"{value:.6g}"
    return repr(value)


class Shown:
    """Base of results: `summary()` is the text between the brackets of their repr, and `to_dict()`
    the content of their table in a notebook.
    """

    def summary(self) -> str:
        """The result in a few words."""
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """The result as numbers, texts, lists and dictionaries, ready for JSON."""
        raise NotImplementedError

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.summary()})"

    def _repr_html_(self) -> str:
        cells = []
        for name, value in _leaves("", self.to_dict()):
            name, text = _cell(name, value)
            cells.append(f"<tr><td>{escape(name)}</td><td>{escape(text)}</td></tr>")
        return f"<b>{escape(repr(self))}</b><table>{''.join(cells)}</table>"


def _leaves(prefix: str, content: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    for name, value in content.items():
        if isinstance(value, dict):
            yield from _leaves(f"{prefix}{name}.", value)
        elif not isinstance(value, list):
            yield f"{prefix}{name}", value


def _cell(name: str, value: Any) -> tuple[str, str]:
    """A row of a table: its name without the unit, its value in millimetres or degrees."""
    if not isinstance(value, float):
        return name, str(value)
    for ending, factor, unit in _UNITS:
        parts = name.split(".")
        if any(part.endswith(ending) for part in parts):
            named = ".".join(part.removesuffix(ending) for part in parts)
            return named, f"{value * factor:.6g} {unit}"
    return name, f"{value:.6g}"


def axes_or_new(axes: "Axes | None") -> "Axes":
    """The axes, or those of a new figure, which a notebook shows."""
    if axes is not None:
        return axes
    from matplotlib import pyplot

    return pyplot.subplots()[1]


def plot_over_time(
    axes: "Axes | None", stamps_s: np.ndarray, values: np.ndarray, label: str
) -> "Axes":
    """A curve of values (n,) at stamps (n,) in seconds."""
    axes = axes_or_new(axes)
    axes.plot(stamps_s, values, ".-" if len(values) < 100 else "-", linewidth=0.9)
    axes.set(xlabel="stamp (s)", ylabel=label)
    axes.grid(alpha=0.3)
    return axes


def plot_shares(axes: "Axes | None", distances_m: np.ndarray, label: str) -> "Axes":
    """The share of distances (n,) in metres that are below a distance, up to the 99th
    percentile.
    """
    axes = axes_or_new(axes)
    shares = 100 * np.arange(1, len(distances_m) + 1) / len(distances_m)
    axes.plot(MM * np.sort(distances_m), shares, label=label)
    axes.set(xlabel="distance (mm)", ylabel="share within it (%)", ylim=(0, 102))
    axes.set_xlim(0, max(MM * float(np.percentile(distances_m, 99)), 1e-6))
    axes.grid(alpha=0.3)
    axes.legend()
    return axes


def plot_from_above(axes: "Axes | None", positions_m: np.ndarray, label: str) -> "Axes":
    """Positions (n, 3) in metres along the two axes of their largest extents."""
    axes = axes_or_new(axes)
    a, b = np.sort(np.argsort(np.ptp(positions_m, axis=0), kind="stable")[1:])
    axes.plot(positions_m[:, a], positions_m[:, b], linewidth=1.2, label=label)
    axes.set(xlabel=f"{'xyz'[a]} (m)", ylabel=f"{'xyz'[b]} (m)")
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(alpha=0.3)
    axes.legend()
    return axes


def ramp(share: np.ndarray) -> np.ndarray:
    """Colour map: (...) in 0..1 -> (..., 3) in 0..1."""
    place = np.clip(np.nan_to_num(np.asarray(share, float)), 0, 1) * (len(_STOPS) - 1)
    low = np.minimum(place.astype(int), len(_STOPS) - 2)
    return _STOPS[low] + (place - low)[..., None] * (_STOPS[low + 1] - _STOPS[low])


def depth_colours(depth_z_m: np.ndarray, near_m: float, far_m: float) -> np.ndarray:
    """(h, w) depth in metres -> (h, w, 3) uint8; black where there is no measurement."""
    colours = ramp((depth_z_m - near_m) / max(far_m - near_m, 1e-6)) * 255
    return np.where((depth_z_m > 0)[..., None], colours, 0).astype(np.uint8)


def depth_range(depth_z_m: np.ndarray) -> tuple[float, float]:
    """Depths in metres shown as blue and red: the 1 % and 95 % quantiles; 0 and 1 without any.

    A garden behind the window must not use up the colour range.
    """
    seen = depth_z_m[depth_z_m > 0]
    if not seen.size:
        return 0.0, 1.0
    near_m, far_m = np.quantile(seen, (0.01, 0.95)).tolist()
    return near_m, far_m


def plot_images(images: list[tuple[str, np.ndarray, np.ndarray]]) -> np.ndarray:
    """Axes (2, n) of a new figure: colour (h, w, 3) uint8 below its title, and depth (h, w) in
    metres, all in one scale; white is missing.
    """
    from matplotlib import pyplot
    from matplotlib.colors import ListedColormap

    near_m, far_m = depth_range(np.concatenate([depth_z_m.ravel() for _, _, depth_z_m in images]))
    grid, size = (2, len(images)), (3.2 * len(images), 5.0)
    if len(images) == 1:  # side by side
        grid, size = (1, 2), (9.0, 3.4)
    figure, axes = pyplot.subplots(*grid, figsize=size, layout="constrained")
    axes = axes.reshape(2, -1)
    colours = ListedColormap(ramp(np.linspace(0, 1, 256)))
    for (above, below), (title, rgb, depth_z_m) in zip(axes.T, images, strict=True):
        above.imshow(rgb)
        above.set_title(title, fontsize="medium")
        seen_m = np.where(depth_z_m > 0, depth_z_m, np.nan)
        shown = below.imshow(seen_m, cmap=colours, vmin=near_m, vmax=far_m)
    for one in axes.flat:
        one.set(xticks=(), yticks=())
    figure.colorbar(shown, ax=axes, label="depth (m)", shrink=0.8)
    return axes
