"""`iclnuim evaluate`: computes the error of an estimated trajectory against the ground truth,
absolute (ate) and relative (rpe), of a reconstructed surface (surface: evaluate_surface.py), of
rendered views (views), of predicted depth (depth: evaluate_depth.py), and of label images
(labels: evaluate_labels.py).
docs/reference/json.md documents what --json prints, iclnuim.report.trajectory_report what --csv
writes.
"""

import os
from argparse import ArgumentParser, Namespace
from pathlib import Path

from iclnuim.console import Console, Progress
from iclnuim.errors import InputError, within
from iclnuim.evaluation.absolute_error import AbsoluteErrorSettings
from iclnuim.evaluation.align import AlignmentSettings
from iclnuim.evaluation.associate import AssociationSettings
from iclnuim.evaluation.image_error import ViewSettings
from iclnuim.evaluation.relative_error import RelativeErrorSettings, parse_delta
from iclnuim.formats.bags import is_bag
from iclnuim.formats.files import atomic_write_text
from iclnuim.formats.image_names import files_in
from iclnuim.report.trajectory_report import ComparedFile, Report, error_text, skipped
from iclnuim.trajectory_files.trajectories import read_trajectory

from ..options import Actions, action, add_settings, settings_from, subcommands, trajectory_file
from . import evaluate_depth, evaluate_labels, evaluate_surface

#: Title and factor of each figure of `views`.
_VIEW_COLUMNS = {
    "psnr_db": ("PSNR [dB]", 1.0),
    "ssim": ("SSIM", 1.0),
    "lpips": ("LPIPS", 1.0),
    "depth_l1_m": ("Depth L1 [mm]", 1e3),
    "depth_missing": ("no depth [%]", 1e2),
}


def configure(parser: ArgumentParser) -> None:
    parser.description = (
        f"{parser.description}. Without ACTION, as in `iclnuim evaluate GT EST`, it is ate; GT may "
        "be a sequence."
    )
    actions = subcommands(parser)
    _configure_ate(actions)
    _configure_rpe(actions)
    evaluate_surface.configure(actions)
    _configure_views(actions)
    evaluate_depth.configure(actions)
    evaluate_labels.configure(actions)


def default_action(argv: list[str]) -> str:
    """`ate` for words that begin with a file or a folder."""
    first = trajectory_file(argv[0]) if argv else ""
    is_path = not first.startswith("-") and ("." in first or os.path.exists(first))
    return "ate" if is_path else ""


def _configure_ate(actions: Actions) -> None:
    text = "absolute trajectory error: six statistics, coverage, recall"
    example = "iclnuim evaluate ate groundtruth.txt estimate.txt --align sim3 --plot error.png"
    ate = action(actions, "ate", text, example, run_ate)
    _files_and_times(ate)
    add_settings(ate, AlignmentSettings)


def _configure_rpe(actions: Actions) -> None:
    text = "relative pose error: drift over frames, seconds or metres"
    example = "iclnuim evaluate rpe groundtruth.txt estimate.txt --delta 1s"
    rpe = action(actions, "rpe", text, example, run_rpe)
    _files_and_times(rpe)
    help = "30 (frames), 1s (seconds) or 0.5m (metres); default: 1"
    rpe.add_argument("--delta", default="1", metavar="D", help=help)
    help = (
        "which pairs: all, one from every pose (default), or consecutive, each starting where the "
        "last one ends"
    )
    rpe.add_argument("--pairs", choices=("all", "consecutive"), default="all", help=help)
    add_settings(rpe, RelativeErrorSettings)


def _configure_views(actions: Actions) -> None:
    text = "rendered views against true frames: PSNR, SSIM, LPIPS, Depth L1"
    example = "iclnuim evaluate views rendered --truth out/living_room/kt2/held_out/clean"
    views = action(actions, "views", text, example, run_views)
    add = views.add_argument
    help = "rendered colour images, and depth images if any, named like the images of SEQUENCE"
    add("folder", type=Path, metavar="DIR", help=help)
    help = "the true frames, a sequence in any format"
    add("--truth", type=Path, required=True, metavar="SEQUENCE", help=help)
    help = (
        "names, numbers or stamps of keyframes, one per line, or their trajectory: reported "
        "separately"
    )
    add("--keyframes", type=Path, metavar="FILE", help=help)
    add_settings(views, ViewSettings)
    add("--csv", metavar="FILE", help="write the errors of every view as a CSV table")


def _files_and_times(parser: ArgumentParser) -> None:
    add = parser.add_argument
    help = (
        "ground truth, in any format that `iclnuim trajectory info` reads, a sequence that "
        "contains it, or the name of a built-in trajectory (living_room/kt2)"
    )
    add("reference", type=_ground_truth, metavar="GT", help=help)
    add("estimate", type=trajectory_file, metavar="EST", help="estimated trajectory")
    help = (
        "system that wrote EST (`iclnuim run`): the scale of one that has none is fitted, by sim3"
    )
    add("--system", metavar="NAME|FILE.toml", help=help)
    help = "format of EST: tum, tum-ids, tum-inverse, kitti ..."
    add("--from", dest="format", metavar="FORMAT", help=help)
    help = "format of GT; default: by name and content, as for EST"
    add("--reference-from", metavar="FORMAT", help=help)
    help = (
        "leave out the first SECONDS of GT, in which a system with an IMU finds gravity and scale"
    )
    add("--skip", type=float, default=0.0, metavar="SECONDS", help=help)
    help = "frame rate of files that number their frames instead of giving stamps; default: 30"
    add("--file-rate", type=float, default=30.0, metavar="HZ", help=help)
    add_settings(parser, AssociationSettings)
    add("--csv", metavar="FILE", help="write the error of every pair as a CSV table")
    help = "draw the trajectories, and the error along them and over time"
    add("--plot", metavar="FILE", help=help)


def _ground_truth(text: str) -> str:
    """The file, which may be a bag, or the folder of a sequence, which contains a ground truth."""
    text = trajectory_file(text)
    if not os.path.isdir(text) or is_bag(text):
        return text
    from iclnuim.sequences.stored_sequence import StoredSequence

    # a folder of POV-Ray camera files is itself a trajectory
    if StoredSequence(text).truth_path is not None or files_in(Path(text), "*.txt"):
        return text
    expected = "a ground truth (groundtruth.txt, *.gt.freiburg, *.gt.sim)"
    raise InputError(expected, path=text, found="none")


def run_ate(args: Namespace, console: Console) -> None:
    association = settings_from(args, AssociationSettings())
    without_scale = _is_without_scale(args, console)
    method = "sim3" if without_scale else AlignmentSettings().method
    alignment = settings_from(args, AlignmentSettings(method))
    if without_scale and alignment.method != "sim3":
        text = f"{args.system} has no scale, which an alignment by {alignment.method} needs"
        console.note(f"warning: {text}")
    _report(AbsoluteErrorSettings(association, alignment), args, console)


def run_rpe(args: Namespace, console: Console) -> None:
    delta, unit = parse_delta(args.delta)
    association = settings_from(args, AssociationSettings())
    base = RelativeErrorSettings(
        delta,
        unit,
        args.pairs == "all",
        correct_scale=_is_without_scale(args, console),
        association=association,
    )
    settings = settings_from(args, base, ("tolerance", "measured_on", "correct_scale"))
    _report(settings, args, console)


def _is_without_scale(args: Namespace, console: Console) -> bool:
    """Whether EST is of a system that has no scale."""
    if not args.system:
        return False
    from iclnuim.benchmark.systems.system import has_scale

    if has_scale(args.system):
        return False
    console.note(f"{args.system} has no scale: not comparable with errors of metric trajectories")
    return True


def _report(
    settings: AbsoluteErrorSettings | RelativeErrorSettings,
    args: Namespace,
    console: Console,
) -> None:
    """Read ground truth and estimate, report how each was read, and report the errors."""
    of_positions = False
    if isinstance(settings, AbsoluteErrorSettings):
        of_positions = settings.alignment.method != "origin"
    sources = _compared(args, settings.association.offset_s, of_positions)
    if args.skip:
        sources = skipped(*sources, args.skip, settings.association.offset_s)
        console.note(f"the first {args.skip:g} s of the ground truth are left out")
    for source in sources:
        console.note(f"{source.path}: {source.loaded.read_as.sentence}")
    report = Report.of(sources[0], sources[1], settings)
    if args.csv:
        atomic_write_text(args.csv, report.csv())
    if args.plot:
        from iclnuim.report.charts import error_figure, save

        save(error_figure(report), args.plot)
    values = report.to_dict()
    if len(values["explanations"]) > 1:
        console.note(_how_to_apply(values))
    console.result(values, error_text(values))


def _how_to_apply(values: dict) -> str:
    """The command that applies several explanations at once."""
    files = [values["estimate"]["path"], values["reference"]["path"]]
    if all(one["file"] == "reference" for one in values["explanations"]):
        files.reverse()
    command = f"iclnuim trajectory convert {files[0]} OUT.txt --explained {files[1]}"
    return f"note: {command} applies all that is explained"


def _compared(
    args: Namespace, offset_s: float, of_positions: bool
) -> tuple[ComparedFile, ComparedFile]:
    """Ground truth and estimate, with the stamps of the same frames if one has none and no offset
    is given.
    """
    from iclnuim.sequences.pose_lines import tied_to_poses
    from iclnuim.sequences.stored_sequence import StoredSequence, noted_mount

    options = {"rate_hz": args.file_rate, "positions_suffice": of_positions}
    estimate = read_trajectory(args.estimate, args.format, **options)
    sequence = StoredSequence(args.reference)
    folder = sequence.folder
    found = sequence.truth_path if folder.is_dir() and not is_bag(folder) else None
    file = found or folder
    truth = sequence.load_truth(**options) if found and not args.reference_from else None
    if truth is None:
        truth = noted_mount(file, read_trajectory(file, args.reference_from, **options))
    if not offset_s:
        with within(args.estimate):
            if found:
                truth, estimate = sequence.tied(truth, estimate)
            else:
                truth, estimate = tied_to_poses(truth, estimate)
    return ComparedFile(str(file), truth), ComparedFile(args.estimate, estimate)


def run_views(args: Namespace, console: Console) -> None:
    from iclnuim.sequences.rendered_views import view_errors

    def progress(total: int, label: str) -> Progress:
        return console.progress(total, label, "views")

    settings = settings_from(args, ViewSettings())
    found = view_errors(args.folder, args.truth, args.keyframes, settings, progress)
    if args.csv:
        atomic_write_text(args.csv, found.csv())
    if found.missing:
        names = ", ".join(found.missing[:3])
        if len(found.missing) > 3:
            names += " ..."
        total = len(found.missing) + len(found.views)
        console.note(
            f"note: {len(found.missing)} of {total} views do not exist and are left out: {names}"
        )
    values = {
        "folder": str(args.folder),
        "truth": str(args.truth),
        **settings.to_dict(),
        **found.to_dict(),
    }
    console.result(values, _views_text(values))


def _views_text(values: dict) -> str:
    shown = {name: column for name, column in _VIEW_COLUMNS.items() if name in values["all"]}
    titles = "".join(f"{title:>15}" for title, _ in shown.values())
    lines = [f"{'':<10}{'views':>6}{titles}"]
    for group in ("all", "keyframes", "others"):
        if group not in values:
            continue
        line = f"{group:<10}{values[group]['views']:>6}"
        for name, (_, factor) in shown.items():
            line += f"{_view_figure(values[group], name, factor):>15}"
        lines.append(line)
    lines += [f"warning: {text}" for text in values["warnings"]]
    return "\n".join(lines)


def _view_figure(figures: dict, name: str, factor: float) -> str:
    """A figure as text; None is that of equal images."""
    if name not in figures:
        return "-"
    value = figures[name]
    return "inf" if value is None else f"{value * factor:.4f}"
