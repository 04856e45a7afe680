"""`iclnuim evaluate`: computes the error of an estimated trajectory against the ground truth,
absolute (ate) and relative (rpe),
of a reconstructed surface (surface), and of rendered views (views).
iclnuim.report.trajectory_report documents what --json prints and --csv writes.
"""

import argparse
import math
import os
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from iclnuim.console import Console
from iclnuim.errors import InputError, named, within
from iclnuim.evaluation.absolute_error import AbsoluteErrorSettings, ErrorStatistics
from iclnuim.evaluation.align import AlignmentSettings
from iclnuim.evaluation.associate import AssociationSettings
from iclnuim.evaluation.image_error import ViewSettings
from iclnuim.evaluation.relative_error import RelativeErrorSettings, parse_delta
from iclnuim.formats.files import atomic_write_text
from iclnuim.formats.trajectories import read_trajectory
from iclnuim.geometry import so3
from iclnuim.report.trajectory_report import ComparedFile, Report, error_text

from ..options import (
    action,
    add_rerun,
    add_settings,
    checked_rerun,
    option_name,
    settings_from,
    subcommands,
)
from .surface import poses_of

if TYPE_CHECKING:
    import numpy as np
    from iclnuim.benchmark.fusion.quality import SeenBy
    from iclnuim.benchmark.fusion.settings import QualitySettings
    from iclnuim.benchmark.fusion.surface_error import Reconstruction, TrueSurface
    from iclnuim.geometry.se3 import SE3

#: Least and largest upper end of a heat map.
_MAX_ERROR_MM = (1e-3, 1e5)


def configure(parser: argparse.ArgumentParser) -> None:
    parser.description = f"{parser.description}. Without ACTION, as in `iclnuim evaluate GT EST`, it is ate; GT may be a sequence."
    actions = subcommands(parser)
    example = "iclnuim evaluate ate groundtruth.txt estimate.txt --align sim3 --plot error.png"
    ate = action(
        actions,
        "ate",
        "absolute trajectory error: six statistics, coverage, recall",
        example,
        run_ate,
    )
    _files_and_times(ate)
    add_settings(ate, AlignmentSettings)
    example = "iclnuim evaluate rpe groundtruth.txt estimate.txt --delta 1s"
    rpe = action(
        actions,
        "rpe",
        "relative pose error: drift over frames, seconds or metres",
        example,
        run_rpe,
    )
    _files_and_times(rpe)
    rpe.add_argument(
        "--delta",
        default="1",
        metavar="D",
        help="30 (frames), 1s (seconds) or 0.5m (metres); default: 1",
    )
    pairs = "which pairs: all, one from every pose (default), or consecutive, each starting where the last one ends"
    rpe.add_argument("--pairs", choices=("all", "consecutive"), default="all", help=pairs)
    add_settings(rpe, RelativeErrorSettings)
    example = "iclnuim evaluate surface kt2.ply --model living_room --plot error.png"
    surface = action(
        actions,
        "surface",
        "distance of a reconstruction from the true surface",
        example,
        run_surface,
    )
    add = surface.add_argument
    files = "the reconstruction, a mesh or a point cloud (.ply, .obj, .stl, .off, .glb)"
    add("mesh", type=Path, metavar="MESH", help=files)
    add(
        "--model",
        required=True,
        metavar="MODEL",
        help="the truth: living_room, office, a .blend, or a mesh file",
    )
    help = "unit of MESH: m (default), cm, mm, in, ft or a number of metres"
    add("--unit", default="m", metavar="UNIT", help=help)
    transform = "file with the 16 numbers of T_model_mesh, row by row; default: the identity"
    add("--transform", type=Path, metavar="FILE", help=transform)
    poses = "trajectory along which MESH was fused; with --truth, its first pose is aligned with the true one"
    add("--poses", type=Path, metavar="EST", help=poses)
    add(
        "--truth",
        type=Path,
        metavar="GT",
        help="ground truth of that trajectory, in the model's world",
    )
    fit = "how the poses align: origin (default): by the first pose; yaw or se3: by the whole trajectory"
    add("--fit-poses", choices=("origin", "yaw", "se3"), default="origin", help=fit)
    pairs = "points picked on both: x y z on MESH, in its unit, and x y z on the model, one pair per line"
    add("--pairs", type=Path, metavar="FILE", help=pairs)
    align = (
        "none (default), or icp: the mesh is then aligned with the model by ICP, as in the paper"
    )
    add("--align", choices=("none", "icp"), default="none", help=align)
    seen_by = "completion of what this trajectory saw: kt2, office/kt0 or a file; or all; default: GT of --truth"
    add("--seen-by", metavar="TRAJECTORY", help=seen_by)
    help = "camera of --seen-by; default: 640x480 and the paper's K"
    add("--camera", metavar="WxH[,FX,FY,CX,CY]", help=help)
    with suppress(ModuleNotFoundError):  # without the benchmark, run_surface says so
        from iclnuim.benchmark.fusion.settings import QualitySettings

        add_settings(surface, QualitySettings)
    add("--plot", type=Path, metavar="FILE", help="heat map and histogram (.png, .pdf, .svg)")
    add(
        "--max-error",
        type=float,
        default=10.0,
        metavar="MM",
        help="upper end of the heat map; default: 10",
    )
    add_rerun(surface, "the surface, coloured by its errors")
    example = "iclnuim evaluate views rendered --truth out/living_room/kt2/held_out/clean"
    views = action(
        actions,
        "views",
        "rendered views against true frames: PSNR, SSIM, LPIPS, Depth L1",
        example,
        run_views,
    )
    add = views.add_argument
    help = "rendered colour images, and depth images if any, named like the images of SEQUENCE"
    add("folder", type=Path, metavar="DIR", help=help)
    add(
        "--truth",
        type=Path,
        required=True,
        metavar="SEQUENCE",
        help="the true frames, a sequence in any format",
    )
    keyframes = "names, numbers or stamps of keyframes, one per line, or their trajectory: reported separately"
    add("--keyframes", type=Path, metavar="FILE", help=keyframes)
    add_settings(views, ViewSettings)
    add("--csv", metavar="FILE", help="write the errors of every view as a CSV table")


def _files_and_times(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "reference",
        metavar="GT",
        help="ground truth, in any format that `iclnuim trajectory info` reads",
    )
    add("estimate", metavar="EST", help="estimated trajectory")
    add(
        "--from",
        dest="format",
        metavar="FORMAT",
        help="format of EST: tum, tum-ids, tum-inverse, kitti ...",
    )
    add(
        "--reference-from",
        metavar="FORMAT",
        help="format of GT; default: by name and content, as for EST",
    )
    help = "frame rate of files that number their frames instead of giving stamps; default: 30"
    add("--file-rate", type=float, default=30.0, metavar="HZ", help=help)
    add_settings(parser, AssociationSettings)
    add("--csv", metavar="FILE", help="write the error of every pair as a CSV table")
    add(
        "--plot",
        metavar="FILE",
        help="draw the trajectories, and the error along them and over time",
    )


def spelled_out(argv: list[str]) -> list[str]:
    """`GT EST` -> `ate GT EST`. `DIR EST` -> `ate GROUNDTRUTH EST` with the ground truth found in
    the folder; `ate DIR EST` and
    `rpe DIR EST` likewise."""
    if argv[:1] in (["surface"], ["views"]):
        return argv
    named = argv[:1] if argv[:1] in (["ate"], ["rpe"]) else []
    files = argv[len(named) :]
    if not files or not os.path.isdir(files[0]):
        is_file = (
            bool(files)
            and (os.path.isfile(files[0]) or "." in files[0])
            and not files[0].startswith("-")
        )
        return ["ate", *argv] if is_file and not named else argv
    from iclnuim.dataset.frames import find_truth

    truth = find_truth(Path(files[0]))
    if truth is None and named:
        return argv  # a folder of POV-Ray camera files is itself a trajectory
    if truth is None:
        raise InputError(
            "a ground truth (groundtruth.txt, *.gt.freiburg, *.gt.sim)", path=files[0], found="none"
        )
    return [*(named or ["ate"]), str(truth), *files[1:]]


def run_ate(args: argparse.Namespace, console: Console) -> None:
    association, alignment = (
        settings_from(args, AssociationSettings()),
        settings_from(args, AlignmentSettings()),
    )
    settings = AbsoluteErrorSettings(association, alignment)
    _report(settings, args, console)


def run_rpe(args: argparse.Namespace, console: Console) -> None:
    delta, unit = parse_delta(args.delta)
    association = settings_from(args, AssociationSettings())
    base = RelativeErrorSettings(delta, unit, args.pairs == "all", association=association)
    settings = settings_from(args, base, ("tolerance", "measured_on", "correct_scale"))
    _report(settings, args, console)


def _report(
    settings: AbsoluteErrorSettings | RelativeErrorSettings,
    args: argparse.Namespace,
    console: Console,
) -> None:
    """Read ground truth and estimate, report how each was read, and report the errors."""
    sources = []
    for path, format in ((args.reference, args.reference_from), (args.estimate, args.format)):
        sources.append(ComparedFile(path, read_trajectory(path, format, rate_hz=args.file_rate)))
        console.note(f"{path}: {sources[-1].loaded.read_as.sentence}")
    report = Report.of(sources[0], sources[1], settings)
    if args.csv:
        atomic_write_text(args.csv, report.csv())
    if args.plot:
        from iclnuim.report.charts import error_figure, save

        save(error_figure(report), args.plot)
    values = report.to_dict()
    console.result(values, error_text(values))


def run_surface(args: argparse.Namespace, console: Console) -> None:
    from iclnuim.benchmark.fusion.settings import QualitySettings
    from iclnuim.benchmark.fusion.surface_error import TrueSurface, read_model, read_reconstruction
    from iclnuim.geometry.scene_axes import parse_unit

    settings, unit_m, recording = (
        settings_from(args, QualitySettings()),
        parse_unit(args.unit),
        checked_rerun(args),
    )
    _check_max_error(args.max_error)
    seen_by, whole = _seen_by(args)
    mesh = read_reconstruction(args.mesh, unit_m)
    for note in mesh.notes:
        console.note(f"note: {args.mesh}: {note}")
    given = _given_transform(args)
    picked = _fitted_transform(args, given, unit_m, console)
    with within(args.model):
        surface = TrueSurface(*read_model(args.model))
    T_model_mesh = surface.aligned(mesh.points, picked) if args.align == "icp" else picked
    error = surface.error(mesh.points, T_model_mesh, unit_m)
    if args.plot:
        from iclnuim.benchmark.fusion.pictures import error_figure
        from iclnuim.report.charts import save

        save(
            error_figure(T_model_mesh.apply(mesh.points), mesh.triangles, error, args.max_error),
            args.plot,
            100,
        )
    if recording:
        from iclnuim.benchmark.fusion.recording import record_surface

        record_surface(
            recording,
            args.mesh,
            T_model_mesh.apply(mesh.points),
            mesh.triangles,
            error,
            args.max_error,
        )
        console.note(f"{recording} written")
    values = {"mesh": str(args.mesh), "model": args.model, "align": args.align, **error.to_dict()}
    values["warnings"] = [named(text, option_name) for text in error.warnings]
    values["notes"] = list(mesh.notes)
    if T_model_mesh is not given:  # a fit was computed
        values["as_given"] = _as_given(surface, mesh.points, given, T_model_mesh)
    quality = _quality(surface, mesh, T_model_mesh, seen_by, whole, settings, console)
    values["quality"] = quality
    console.result(values, _surface_text(values))


def _check_max_error(max_error_mm: float) -> None:
    """Raises InputError unless the heat map has a range of colours."""
    low, high = _MAX_ERROR_MM
    if not low <= max_error_mm <= high:
        raise InputError(f"{low:g} to {high:g} mm", setting="--max-error", found=max_error_mm)


def run_views(args: argparse.Namespace, console: Console) -> None:
    from iclnuim.dataset.rendered_views import view_errors

    settings = settings_from(args, ViewSettings())
    found = view_errors(
        args.folder,
        args.truth,
        args.keyframes,
        settings,
        lambda n: console.progress(n, "evaluate", "views").advance,
    )
    if args.csv:
        atomic_write_text(args.csv, found.csv())
    if found.missing:
        names = ", ".join(found.missing[:3]) + (" ..." if len(found.missing) > 3 else "")
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
    heads = {
        "psnr_db": ("PSNR [dB]", 1),
        "ssim": ("SSIM", 1),
        "lpips": ("LPIPS", 1),
        "depth_l1_m": ("Depth L1 [mm]", 1e3),
        "depth_missing": ("no depth [%]", 1e2),
    }
    shown = {name: head for name, head in heads.items() if name in values["all"]}
    lines = [f"{'':<10}{'views':>6}" + "".join(f"{title:>15}" for title, _ in shown.values())]
    for group in (name for name in ("all", "keyframes", "others") if name in values):
        found = {name: values[group].get(name, "-") for name in shown}
        cells = (
            "inf" if v is None else v if v == "-" else f"{v * shown[name][1]:.4f}"
            for name, v in found.items()
        )
        lines.append(
            f"{group:<10}{values[group]['views']:>6}" + "".join(f"{cell:>15}" for cell in cells)
        )
    return "\n".join(lines)


def _seen_by(args: argparse.Namespace) -> "tuple[SeenBy | None, bool]":
    """The camera and poses that decide over which part of the model completion is measured, and
    whether it is the whole model.
    """
    from iclnuim.benchmark.fusion.quality import SeenBy
    from iclnuim.geometry.camera import PinholeCamera

    camera = PinholeCamera.parse(args.camera) if args.camera else PinholeCamera()
    if args.seen_by == "all":
        return None, True
    if args.seen_by:
        return SeenBy(camera, poses_of(args.seen_by, args.model)), False
    if args.truth:
        return SeenBy(camera, read_trajectory(args.truth).trajectory.T_world_camera), False
    return None, False


def _as_given(surface: "TrueSurface", points: "np.ndarray", given: "SE3", fitted: "SE3") -> dict:
    """The figures without the fit, and by how much the fit translated the centre of the
    reconstruction and rotated it.
    """
    T, middle = fitted @ given.inverse(), given.apply(points.mean(0))
    return {
        "distance_m": ErrorStatistics.of(surface.distance(given.apply(points))).to_dict(),
        "moved_m": math.dist(T.apply(middle), middle),
        "turned_deg": math.degrees(so3.angle(T.rotation)),
        "T_fitted_given": T.matrix.tolist(),
    }


def _quality(
    surface: "TrueSurface",
    mesh: "Reconstruction",
    T_model_mesh: "SE3",
    seen_by: "SeenBy | None",
    whole: bool,
    settings: "QualitySettings",
    console: Console,
) -> dict:
    from iclnuim.benchmark.fusion.quality import surface_quality

    poses = 2 * len(seen_by.T_world_camera[:: settings.every]) if seen_by else 0
    on_pose = console.progress(poses, "evaluate", "poses").advance if poses else lambda: None
    found = surface_quality(
        surface, mesh.points, mesh.triangles, T_model_mesh, seen_by, whole, settings, on_pose
    )
    return {**settings.to_dict(), **found.to_dict()}


def _surface_text(values: dict) -> str:
    d, quality = (
        {name: f"{1e3 * value:.3f}" for name, value in values["distance_m"].items()},
        values["quality"],
    )
    lines = [f"{values['vertices']} vertices of {values['mesh']} to {values['model']} [mm]"]
    lines += [
        f"  {name:<8}{d[name]:>10}" for name in ("mean", "median", "std", "min", "max", "rmse")
    ]
    lines.append(
        "  " + ", ".join(f"{share:.1%} within {w}" for w, share in values["within"].items())
    )
    if given := values.get("as_given"):
        moved = f"the fit moved it by {1e3 * given['moved_m']:.3f} mm and {given['turned_deg']:.4f} degrees"
        lines.append(f"  without the fit: mean {1e3 * given['distance_m']['mean']:.3f}; {moved}")
    lines.append(f"{quality['samples']} samples, uniform by area")
    for name in ("accuracy", "completion", "depth_l1"):
        if f"{name}_m" in quality:
            lines.append(
                f"  {name.replace('_l1', ' L1'):<11}{1e3 * quality[f'{name}_m']:>10.3f} mm"
            )
    for name in ("precision", "recall", "f_score"):
        if name in quality:
            shares = ", ".join(f"{share:.2%} within {w}" for w, share in quality[name].items())
            lines.append(f"  {name.replace('_', ' '):<11} {shares}")
    if "completion_m" in quality:
        seen = f", {quality['seen_m2']:.2f} m2" if "seen_m2" in quality else ""
        lines.append(f"  over {quality['model_samples']} samples of the model{seen}")
    else:
        lines.append("  no completion: name the trajectory that saw the model with --seen-by")
    return "\n".join([*lines, *(f"warning: {text}" for text in values["warnings"])])


def _given_transform(args: argparse.Namespace) -> "SE3":
    """T_model_mesh as given by the options, without a fit."""
    from iclnuim.benchmark.fusion.surface_error import first_poses_transform, read_transform
    from iclnuim.geometry.se3 import SE3

    if args.transform and (args.poses or args.truth) or bool(args.poses) != bool(args.truth):
        raise InputError(
            "--transform, or --poses and --truth together, or none of them", found="some of them"
        )
    if args.transform:
        return read_transform(args.transform)
    if not args.poses:
        return SE3.identity()
    poses, truth = (read_trajectory(path).trajectory for path in (args.poses, args.truth))
    return first_poses_transform(poses, truth)


def _fitted_transform(
    args: argparse.Namespace, given: "SE3", unit_m: float, console: Console
) -> "SE3":
    """T_model_mesh fitted to picked pairs or to the whole trajectory; `given` if the options
    request neither.
    """
    from iclnuim.benchmark.fusion.surface_error import (
        pairs_transform,
        read_pairs,
        trajectories_transform,
    )

    if args.fit_poses != "origin" and (args.pairs or not args.poses):
        raise InputError(
            "--fit-poses with --poses and --truth, and without --pairs", found=args.fit_poses
        )
    if args.pairs:
        on_mesh, on_model = read_pairs(args.pairs)
        with within(args.pairs):
            T, rms_m = pairs_transform(on_mesh * unit_m, on_model)
        console.note(f"{len(on_mesh)} pairs, residual {1e3 * rms_m:.3f} mm RMS")
        return T
    if args.fit_poses == "origin":
        return given
    poses, truth = (read_trajectory(path).trajectory for path in (args.poses, args.truth))
    return trajectories_transform(poses, truth, args.fit_poses)
