"""Trajectory errors as a table for the terminal, from the figures that --json prints. Imports nothing heavy."""

from __future__ import annotations

import os

STATISTICS = ("rmse", "mean", "median", "std", "min", "max")


def error_text(values: dict) -> str:
    """The lines for an `ate` or `rpe` dictionary (error_report.py describes it)."""
    middle = _relative(values) if values["metric"] == "rpe" else _absolute(values)
    warnings = [f"warning: {text}" for text in values["warnings"]]
    return "\n".join([title(values), *_table(values), *middle, *warnings])


def title(values: dict) -> str:
    """One line: which error of which file against which, and how."""
    names = " against ".join(
        os.path.basename(os.path.normpath(values[key]["path"])) for key in ("estimate", "reference")
    )
    how = _stretches(values) if values["metric"] == "rpe" else _alignment(values)
    return f"{values['metric'].upper()} of {names}, {how}"


def _alignment(values: dict) -> str:
    method = values["settings"]["alignment"]["method"]
    if method == "none":
        return "not aligned"
    return f"aligned by {method}" + (f", scale {values['alignment']['scale']:.6g}" if method == "sim3" else "")


def _stretches(values: dict) -> str:
    stretch = values["settings"]["stretch"]
    unit = {"frames": "frames" if stretch["delta"] > 1 else "frame", "seconds": "s", "metres": "m"}[stretch["unit"]]
    kind = "all pairs" if stretch["all_pairs"] else "end to end"
    scale = f", scale {values['scale']:.6g}" if values["settings"]["correct_scale"] else ""
    return f"over {stretch['delta']:g} {unit}, {kind}{scale}"


def _table(values: dict) -> list[str]:
    rows = [f"{'':16}" + "".join(f"{name:>11}" for name in STATISTICS)]
    for label, key in (("translation (m)", "translation_error_m"), ("rotation (deg)", "rotation_error_deg")):
        rows.append(f"{label:16}" + "".join(f"{values[key][name]:11.6f}" for name in STATISTICS))
    return rows


def _absolute(values: dict) -> list[str]:
    recall = ", ".join(
        f"{100 * share:.1f} % within {bound.replace('cm', ' cm')}" for bound, share in values["recall"].items()
    )
    return [
        _pairs(values),
        f"of all ground-truth frames: {100 * values['coverage']:.1f} % have an estimate, {recall}",
        f"area under the error curve to 10 cm: {values['area_under_curve']:.4f}",
    ]


def _relative(values: dict) -> list[str]:
    return [f"{values['stretches']} stretches; {_pairs(values)}"]


def _pairs(values: dict) -> str:
    poses = f"{values['reference']['poses']} ground-truth and {values['estimate']['poses']} estimated poses"
    return f"{values['pairs']} pairs of {poses}, stamps at most {1000 * values['largest_difference_s']:.3f} ms apart"
