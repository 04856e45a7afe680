"""Ways of lighting compared, as a chart and as a table: time per frame against error, and against flicker."""

from collections.abc import Sequence

import numpy as np
from iclnuim.job import RenderJob
from iclnuim.report.charts import COLOURS
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from .light_comparison import Result

_HEADER = (
    "way",
    "samples",
    "s/frame",
    "PSNR dB",
    "worst view",
    "to the reference",
    "median error",
    "to the reference",
    "bias",
    "flicker",
)


def figure(results: Sequence[Result]) -> Figure:
    """Left: PSNR (higher is better); right: flicker in 8-bit steps (lower is better)."""
    drawn = Figure(figsize=(12, 4.8), layout="constrained")
    FigureCanvasAgg(drawn)
    left, right = drawn.subplots(1, 2)
    for k, family in enumerate(dict.fromkeys(r.way.family for r in results)):
        line = [r for r in results if r.way.family == family]
        style = {"color": COLOURS[k % len(COLOURS)], "label": family, "marker": "o" if len(line) > 1 else "D"}
        _draw(left, line, [r.error.mean_psnr_db for r in line], style)
        _draw(right, line, [255 * r.flicker for r in line], style)
    left.set_ylabel("PSNR (dB), mean of the views")
    right.set_ylabel("median change of a surface point\nfrom frame to frame (of 255)")
    right.set_yscale("log")
    right.yaxis.set_major_formatter("{x:g}")
    right.yaxis.set_minor_formatter("{x:g}")
    for axes in (left, right):
        axes.set_xscale("log")
        axes.set_xlabel("seconds a frame, 640 x 480 (numbers: samples a pixel)")
        axes.grid(alpha=0.3)
    left.legend(frameon=False)
    return drawn


def _draw(axes: Axes, line: list[Result], values: list[float], style: dict) -> None:
    axes.plot([r.seconds for r in line], values, **style)
    for result, value in zip(line, values, strict=True):
        axes.annotate(result.way.label, (result.seconds, value), xytext=(4, 4), textcoords="offset points", fontsize=8)


def table(results: Sequence[Result]) -> str:
    """One row a way, in Markdown."""
    return "\n".join([_line(_HEADER), _line(["---"] * len(_HEADER)), *map(row, results)])


def row(r: Result) -> str:
    """A way's row of the table."""
    error = r.error
    psnr = (error.mean_psnr_db, error.worst_psnr_db, float(np.mean(error.psnr_to_reference_db)))
    figures = [
        f"{r.seconds:.3f}",
        *(f"{p:.1f}" for p in psnr),
        f"{error.median:.4f}",
        f"{error.median_to_reference:.4f}",
        f"{error.bias:+.4f}",
        f"{255 * r.flicker:.2f}",
    ]
    return _line([r.way.family, r.way.label, *figures])


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def seconds_at(results: Sequence[Result], family: str, psnr_db: float) -> float:
    """Seconds a frame at which a way with many points reaches an error, interpolated; infinite where it never does."""
    line = sorted((r.error.mean_psnr_db, np.log(r.seconds)) for r in results if r.way.family == family)
    psnr, seconds = np.array(line).T
    if psnr_db > psnr[-1]:
        return float("inf")
    return float(np.exp(np.interp(psnr_db, psnr, seconds)))


def summary(results: Sequence[Result], job: RenderJob) -> str:
    """How much less time the job's own baked light takes than path tracing of the same error."""
    own = next((r for r in results if r.way.job == job.changed(light="baked")), None)
    if own is None:
        return ""
    lines = []
    for family in ("path traced, denoised", "path traced"):
        if any(r.way.family == family for r in results):
            seconds = seconds_at(results, family, own.error.mean_psnr_db)
            ratio = f"{seconds / own.seconds:.0f} times less" if np.isfinite(seconds) else "never reached by the other"
            lines.append(f"baked light against {family} at {own.error.mean_psnr_db:.1f} dB: {ratio}")
    return "\n".join(lines)
