"""`iclnuim evaluate depth` and `points`: predicted depth, and predicted point maps, against the depth
of a sequence.
"""

from argparse import ArgumentParser, Namespace
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from iclnuim.console import Console, Progress
from iclnuim.depth.groups import KINDS
from iclnuim.depth.points import FRAMES
from iclnuim.errors import named
from iclnuim.evaluation.depth_error import DepthErrorSettings
from iclnuim.evaluation.point_error import POINT_ALIGNMENTS
from iclnuim.formats.files import atomic_write_text, csv_text

from ..options import Actions, action, add_settings, option_name, settings_from

#: Title, factor and digits of each column of the tables.
_COLUMNS = {
    "abs_rel": ("AbsRel", 1.0, 4),
    "sq_rel_m": ("SqRel [m]", 1.0, 4),
    "rmse_m": ("RMSE [mm]", 1e3, 1),
    "rmse_log": ("RMSE log", 1.0, 4),
    "silog": ("SILog", 1.0, 3),
    "log10": ("log10", 1.0, 4),
    "delta1": ("delta1", 1.0, 4),
    "delta2": ("delta2", 1.0, 4),
    "delta3": ("delta3", 1.0, 4),
    "mae_m": ("MAE [mm]", 1e3, 2),
    "boundary_f1": ("bound. F1", 1.0, 4),
}
_WIDTH = 11
#: Title and factor of the figures of points.
_OF_POINTS = {
    "mean_m": ("mean [mm]", 1e3),
    "median_m": ("median [mm]", 1e3),
    "rmse_m": ("RMSE [mm]", 1e3),
    "abs_rel": ("AbsRel", 1.0),
    "delta1": ("delta1", 1.0),
}
#: Number of names in a note.
_NAMED = 3


def configure(actions: Actions) -> None:
    text = "predicted depth against true depth: AbsRel, RMSE, SILog, delta, boundary F1"
    example = (
        "iclnuim evaluate depth predicted --truth out/living_room/kt2/clean --align scale "
        "--by distance"
    )
    depth = action(actions, "depth", text, example, run)
    add = depth.add_argument
    help = (
        "predicted depth of a method, a file for each frame (.png, .npy, .npz, .exr, .tif), named "
        "or numbered like the images of SEQUENCE, or one .npy or .npz for all; several methods are "
        "compared"
    )
    add("folders", type=Path, nargs="+", metavar="DIR", help=help)
    add("--truth", type=Path, required=True, metavar="SEQUENCE", help="the true frames")
    add_settings(depth, DepthErrorSettings)
    help = "depth units per metre of 16-bit images; default: in camera.json of DIR or SEQUENCE"
    add("--units", type=float, metavar="N", help=help)
    _add_pixels(depth)
    add("--csv", metavar="FILE", help="write the figures of every frame as a CSV table")
    add("--plot", metavar="FILE", help="draw AbsRel of the frames of every method")
    help = "draw true depth, prediction and error of some frames"
    add("--picture", type=Path, metavar="FILE", help=help)
    help = "name or number of a frame in the picture (may be given several times)"
    add("--frame", action="append", default=[], metavar="NAME", help=help)

    _configure_points(actions)


def _configure_points(actions: Actions) -> None:
    text = "predicted point maps against true points, after one similarity a sequence"
    example = "iclnuim evaluate points predicted --truth out/living_room/kt2/clean --frame world"
    points = action(actions, "points", text, example, run_points)
    add = points.add_argument
    help = "point maps of a method (.npy, .npz, .exr), a file for each frame, or one for all"
    add("folder", type=Path, metavar="DIR", help=help)
    add("--truth", type=Path, required=True, metavar="SEQUENCE", help="the true frames, with poses")
    help = "alignment: " + _listed_choices(POINT_ALIGNMENTS) + "; default: similarity"
    add("--align", choices=list(POINT_ALIGNMENTS), default="similarity", help=help)
    help = "frame of the points: " + _listed_choices(FRAMES) + "; default: world"
    add("--frame", choices=list(FRAMES), default="world", help=help)
    _add_chosen(points)
    add("--csv", metavar="FILE", help="write the figures of every frame as a CSV table")


def _listed_choices(choices: Mapping[str, str]) -> str:
    return ", ".join(f"{name} ({text})" for name, text in choices.items())


def _add_pixels(parser: ArgumentParser) -> None:
    add = parser.add_argument
    help = "also figures by " + "; ".join(f"{kind}: {text}" for kind, text in KINDS.items())
    add("--by", action="append", choices=list(KINDS), default=[], help=help)
    _add_chosen(parser)


def _add_chosen(parser: ArgumentParser) -> None:
    add = parser.add_argument
    help = "count only pixels of this class or object of the sequence (may be given several times)"
    add("--only", action="append", default=[], metavar="NAME", help=help)
    help = "do not count pixels of this class or object, such as window_pane"
    add("--without", action="append", default=[], metavar="NAME", help=help)


def run(args: Namespace, console: Console) -> None:
    from iclnuim.depth.errors import TrueDepth, method_errors

    if args.picture:
        from iclnuim.formats.files import check_picture

        check_picture(args.picture)
    settings = settings_from(args, DepthErrorSettings())
    settings.check()
    truth = TrueDepth(args.truth, args.by, args.only, args.without)

    def progress(total: int, label: str) -> Progress:
        return console.progress(total, label)

    # all folders are opened before the first is compared
    predictions = [truth.predictions(folder, args.units) for folder in args.folders]
    found = []
    for given in predictions:
        found.append(method_errors(given, truth, settings, progress))
    names = [one.method for one in found]
    if len(set(names)) < len(names):  # folders of one name in different places
        names = [str(folder) for folder in args.folders]
    methods = []
    for name, one in zip(names, found, strict=True):
        methods.append(one.to_dict() | {"method": name})
    if args.csv:
        atomic_write_text(args.csv, _csv(names, found))
    if args.plot:
        from iclnuim.depth.pictures import curves_figure
        from iclnuim.report.charts import save

        save(curves_figure(dict(zip(names, found, strict=True))), args.plot)
    if args.picture:
        from iclnuim.depth.pictures import draw_errors

        draw_errors(args.picture, predictions, truth, found, args.frame)
    for values in methods:
        for sentence in depth_notes(values):
            console.note(f"{values['method']}: {named(sentence, option_name)}")
    values = {"truth": str(args.truth), "methods": methods}
    console.result(values, depth_text(methods))


def run_points(args: Namespace, console: Console) -> None:
    from iclnuim.depth.points import point_errors

    chosen = (args.only, args.without)
    align = args.align
    found = point_errors(args.folder, args.truth, align, args.frame, *chosen, console.progress)
    if args.csv:
        atomic_write_text(args.csv, found.csv())
    values = {"truth": str(args.truth), **found.to_dict()}
    if found.missing:
        console.note(f"{len(found.missing)} frames have no prediction: {_listed(found.missing)}")
    if values["missing"] > 0:
        console.note(f"{values['missing']:.2%} of the true points have no predicted one")
    lines = [f"{found.method}, points in the frame {found.frame}, aligned by {align}"]
    for name, (title, factor) in _OF_POINTS.items():
        lines.append(f"  {title:<14}{factor * values[name]:>12.4f}")
    lines.append(f"  {'scale':<14}{values['scale']:>12.6g}")
    console.result(values, "\n".join(lines))


def _csv(names: list[str], found: list[Any]) -> str:
    rows: list[list[object]] = []
    for name, one in zip(names, found, strict=True):
        first, *lines = one.errors.rows()
        if not rows:
            rows.append(["method", *first])
        rows += [[name, *line] for line in lines]
    return csv_text(rows)


def depth_notes(values: dict[str, Any]) -> list[str]:
    """A sentence for everything that does not count as the reader may expect."""
    found = list(values["warnings"])
    if missing := values["missing_frames"]:
        total = len(missing) + values["frames"] + len(values["empty"])
        names = _listed(missing)
        found.append(
            f"{len(missing)} of {total} frames have no prediction and are left out: {names}"
        )
    if empty := values["empty"]:
        names = _listed(empty)
        found.append(f"{len(empty)} frames have no pixel to compare and are left out: {names}")
    if values["missing"] > 0:
        found.append(f"{values['missing']:.2%} of the pixels have no prediction, and do not count")
    if values["clamped"]:
        found.append(f"{values['clamped']} pixels are clamped, as the alignment made them negative")
    if values["align"] not in ("none",) and values["scale"] < 0:
        found.append("the alignment turned the prediction upside down (its scale is negative)")
    return found


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:_NAMED]) + (" ..." if len(names) > _NAMED else "")


def depth_text(methods: list[dict[str, Any]]) -> str:
    """A line per method, how they were aligned, and a table of groups for each kind."""
    first = methods[0]
    columns = [name for name in _COLUMNS if any(one[name] is not None for one in methods)]
    width = max(12, *(len(one["method"]) + 2 for one in methods))
    titles = "".join(f"{_COLUMNS[name][0]:>{_WIDTH}}" for name in columns)
    lines = [f"{'':<{width}}{titles}"]
    lines += [f"{one['method']:<{width}}{_figures(one, columns)}" for one in methods]
    lines.append(_how(first))
    if first["align"] != "none":
        for one in methods:
            shift = f", shift {one['shift']:.6g}" if one["align"] == "affine" else ""
            lines.append(f"  {one['method']}: median scale {one['scale']:.6g}{shift}")
    for kind in first["by"]:
        for one in methods:
            lines += _group_lines(kind, one, [name for name in columns if name != "boundary_f1"])
    return "\n".join(lines)


def _how(values: dict[str, Any]) -> str:
    robust = " (robust)" if values["robust"] and values["align"] in ("scale", "affine") else ""
    aligned = "not aligned"
    if values["align"] != "none":
        aligned = f"aligned by {values['align']}{robust} per {values['per']}"
    pool = "mean over frames" if values["pool"] == "frames" else "over all pixels"
    return f"{values['quantity']}, {aligned}; {pool}; {values['frames']} frames"


def _group_lines(kind: str, values: dict[str, Any], columns: list[str]) -> list[str]:
    titles = "".join(f"{_COLUMNS[name][0]:>{_WIDTH}}" for name in columns)
    lines = ["", f"{values['method']} by {kind}, over all pixels"]
    lines.append(f"{'':<16}{'pixels':>12}{titles}")
    for group in values["by"][kind]:
        lines.append(f"{group['name']:<16}{group['pixels']:>12}{_figures(group, columns)}")
    return lines


def _figures(values: dict[str, Any], columns: list[str]) -> str:
    text = ""
    for name in columns:
        _, factor, digits = _COLUMNS[name]
        value = values[name]
        shown = "-" if value is None else f"{factor * value:.{digits}f}"
        if len(shown) >= _WIDTH:
            shown = f"{factor * value:.3g}"
        text += f"{shown:>{_WIDTH}}"
    return text
