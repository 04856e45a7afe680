"""`iclnuim evaluate surface`: the distance of a reconstruction from the true surface, its accuracy
and completion.
"""

from argparse import ArgumentParser, Namespace
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from iclnuim.console import Console, Meter
from iclnuim.errors import InputError, named, within
from iclnuim.geometry.scene_axes import parse_unit
from iclnuim.trajectory_files.trajectories import read_trajectory

from ..isolation import isolated_model
from ..options import (
    Actions,
    action,
    add_rerun,
    add_settings,
    checked_rerun,
    option_name,
    settings_from,
    trajectory_file,
)
from .evaluate_labels import add_classes, label_notes, labels_text
from .surface import poses_of

if TYPE_CHECKING:
    from iclnuim.benchmark.fusion.evaluation import Placement
    from iclnuim.benchmark.fusion.labels import TrueLabels
    from iclnuim.benchmark.fusion.quality import SeenBy
    from iclnuim.benchmark.fusion.reconstruction import Reconstruction
    from iclnuim.benchmark.fusion.surface_error import SurfaceError
    from iclnuim.blender.open.model_file import ClassedModel
    from iclnuim.geometry.se3 import SE3
    from iclnuim.geometry.trajectory import Trajectory

#: Least and largest upper end of a heat map.
_MIN_ERROR_MM = 1e-3
_MAX_ERROR_MM = 1e5
#: A share of the true poses without one of the estimate that is more than some lost frames.
_NOTED_SHARE = 0.1


def configure(actions: Actions) -> None:
    text = "distance of a reconstruction from the true surface"
    example = "iclnuim evaluate surface kt2.ply --model living_room --plot error.png"
    surface = action(actions, "surface", text, example, run)
    add = surface.add_argument
    help = "the reconstruction, a mesh or a point cloud (.ply, .obj, .stl, .off, .glb)"
    add("mesh", type=Path, metavar="MESH", help=help)
    help = "the truth: living_room, office, a .blend, or a mesh file"
    add("--model", required=True, metavar="MODEL", help=help)
    help = "unit of a mesh file as MODEL: as --unit"
    add("--model-unit", default="m", metavar="UNIT", help=help)
    _add_placement(surface)
    help = (
        "completion of what this trajectory saw: kt2, office/kt0 or a file; or all; default: GT of "
        "--truth"
    )
    add("--seen-by", metavar="TRAJECTORY", help=help)
    help = "camera of --seen-by; default: 640x480 and the paper's K"
    add("--camera", metavar="WxH[,FX,FY,CX,CY]", help=help)
    with suppress(ModuleNotFoundError):  # without the benchmark, `run` says so
        from iclnuim.benchmark.fusion.settings import QualitySettings

        add_settings(surface, QualitySettings)
    help = (
        "also compare the labels of MESH, a property class or label of faces or vertices of a "
        ".ply, with the classes of the model"
    )
    add("--labels", action="store_true", help=help)
    add_classes(surface)
    add("--plot", type=Path, metavar="FILE", help="heat map and histogram (.png, .pdf, .svg)")
    help = "upper end of the heat map; default: 10"
    add("--max-error", type=float, default=10.0, metavar="MM", help=help)
    add_rerun(surface, "the surface, coloured by its errors")


def _add_placement(parser: ArgumentParser) -> None:
    """Add the options that place the mesh in the model's world."""
    add = parser.add_argument
    help = "unit of MESH: m (default), cm, mm, inch, foot or a number of metres"
    add("--unit", default="m", metavar="UNIT", help=help)
    help = "file with the 16 numbers of T_model_mesh, row by row; default: the identity"
    add("--transform", type=Path, metavar="FILE", help=help)
    help = (
        "trajectory along which MESH was fused; with --truth, its first pose is aligned with the "
        "true one"
    )
    add("--poses", type=trajectory_file, metavar="EST", help=help)
    help = "ground truth of that trajectory, in the model's world"
    add("--truth", type=trajectory_file, metavar="GT", help=help)
    help = (
        "how the poses align: origin (default): by the first pose; yaw or se3: by the whole "
        "trajectory"
    )
    add("--fit-poses", choices=("origin", "yaw", "se3"), default="origin", help=help)
    help = (
        "points picked on both: x y z on MESH, in its unit, and x y z on the model, one pair per "
        "line"
    )
    add("--pairs", type=Path, metavar="FILE", help=help)
    help = "none (default), or icp: the mesh is then aligned with the model by ICP, as in the paper"
    add("--align", choices=("none", "icp"), default="none", help=help)


def run(args: Namespace, console: Console) -> None:
    from iclnuim.benchmark.fusion.evaluation import evaluate_surface
    from iclnuim.benchmark.fusion.reconstruction import read_reconstruction
    from iclnuim.benchmark.fusion.settings import QualitySettings
    from iclnuim.benchmark.fusion.surface_error import TrueSurface

    settings = settings_from(args, QualitySettings())
    unit_m, model_unit_m = map(parse_unit, (args.unit, args.model_unit))
    recording = checked_rerun(args)
    seen_by = _checked_seen_by(args, console)
    mesh = read_reconstruction(args.mesh, unit_m, args.labels)
    for note in mesh.notes:
        console.note(f"note: {args.mesh}: {note}")
    placement = _placement(args, unit_m, model_unit_m, console)
    with within(args.model):
        model = isolated_model(args.model, model_unit_m)
        surface = TrueSurface(model.points, model.triangles)
    found = evaluate_surface(
        mesh,
        surface,
        placement,
        seen_by=seen_by,
        whole=args.seen_by == "all",
        settings=settings,
        labels=_true_labels(args.model, model) if args.labels else None,
        classes=args.classes,
        progress=_phases(console),
    )
    _draw(args, mesh, found.error, recording, console)
    values = {"mesh": str(args.mesh), "model": args.model, "align": args.align, **found.to_dict()}
    values["warnings"] = [named(text, option_name) for text in found.error.warnings]
    values["notes"] = list(mesh.notes)
    for sentence in label_notes(values["labels"]) if found.labels else ():
        console.note(f"note: {sentence}")
    console.result(values, _text(values))


def _phases(console: Console) -> Meter:
    """A progress display of what_was_seen() for each of its two sets of samples."""
    names = iter(("find what was seen", "sample what was seen"))
    return lambda total, _: console.progress(total, next(names), "poses")


def _checked_seen_by(args: Namespace, console: Console) -> "SeenBy | None":
    """_seen_by(). Raises InputError for options that do not fit together."""
    if not _MIN_ERROR_MM <= args.max_error <= _MAX_ERROR_MM:
        expected = f"{_MIN_ERROR_MM:g} to {_MAX_ERROR_MM:g} mm"
        raise InputError(expected, setting="--max-error", found=args.max_error)
    seen_by = _seen_by(args, console)
    if args.labels and seen_by is None and args.seen_by != "all":
        expected = "{labels} with {seen_by}: a trajectory, or all"
        raise InputError(expected, found="no trajectory that saw the model")
    return seen_by


def _true_labels(name: str, model: "ClassedModel") -> "TrueLabels":
    """The classes of a scene, or the labels of a mesh file in our numbering."""
    from iclnuim.benchmark.fusion.labels import TrueLabels
    from iclnuim.formats.ply import read_ply_labels

    if model.names:
        return TrueLabels.of_names(model.names, model.of_triangles)
    if not name.lower().endswith(".ply"):
        raise InputError("a scene, or a .ply with labels of its faces", path=name)
    with within(name):
        return TrueLabels.of_mesh(read_ply_labels(Path(name)))


def _draw(
    args: Namespace,
    mesh: "Reconstruction",
    error: "SurfaceError",
    recording: Path | None,
    console: Console,
) -> None:
    """Write the files of --plot and --rerun."""
    points = error.T_model_mesh.apply(mesh.points)
    if args.plot:
        from iclnuim.benchmark.fusion.pictures import error_figure
        from iclnuim.report.charts import save

        save(error_figure(points, mesh.triangles, error, args.max_error), args.plot, 100)
    if recording:
        from iclnuim.benchmark.fusion.recording import record_surface

        record_surface(recording, args.mesh, points, mesh.triangles, error, args.max_error)
        console.note(f"{recording} written")


def _seen_by(args: Namespace, console: Console) -> "SeenBy | None":
    """The camera and poses that decide over which part of the model completion is measured."""
    from iclnuim.benchmark.fusion.quality import SeenBy
    from iclnuim.geometry.camera import PinholeCamera

    camera = PinholeCamera.parse(args.camera) if args.camera else PinholeCamera()
    if args.seen_by == "all":
        return None
    if args.seen_by:
        return SeenBy(camera, poses_of(args.seen_by, args.model))
    if args.poses and args.truth:
        estimate, truth = _poses_and_truth(args)
        _note_truth_alone(args, estimate, truth, console)
        return SeenBy(camera, truth.T_world_camera)
    return None


def _note_truth_alone(
    args: Namespace, estimate: "Trajectory", truth: "Trajectory", console: Console
) -> None:
    """Print a note if the true camera saw more than that of the estimate."""
    from iclnuim.sequences.frames import posed

    alone = int((~posed(truth.stamps_s, estimate)).sum())
    if alone > _NOTED_SHARE * len(truth):
        there = f"{args.poses} has no pose at {alone} of the {len(truth)} poses of {args.truth}"
        console.note(f"note: {there}; what these saw counts as missing")


def _placement(
    args: Namespace, unit_m: float, model_unit_m: float, console: Console
) -> "Placement":
    """T_model_mesh as given by the options, and by the fit that they request."""
    from iclnuim.benchmark.fusion.evaluation import Placement

    given = _given_transform(args)
    fitted = _fitted_transform(args, unit_m, console)
    return Placement(given, fitted, args.align == "icp", unit_m, model_unit_m)


def _given_transform(args: Namespace) -> "SE3":
    """T_model_mesh as given by the options, without a fit."""
    from iclnuim.benchmark.fusion.alignment import first_poses_transform
    from iclnuim.benchmark.fusion.reconstruction import read_transform
    from iclnuim.geometry.se3 import SE3

    if args.transform and (args.poses or args.truth) or bool(args.poses) != bool(args.truth):
        expected = "--transform, or --poses and --truth together, or none of them"
        raise InputError(expected, found="some of them")
    if args.transform:
        return read_transform(args.transform)
    if not args.poses:
        return SE3.identity()
    return first_poses_transform(*_poses_and_truth(args))


def _fitted_transform(args: Namespace, unit_m: float, console: Console) -> "SE3 | None":
    """T_model_mesh fitted to picked pairs or to the whole trajectory; None if the options request
    neither.
    """
    from iclnuim.benchmark.fusion.alignment import (
        doubtful_pairs,
        pairs_transform,
        trajectories_transform,
    )
    from iclnuim.benchmark.fusion.reconstruction import read_pairs

    if args.fit_poses != "origin" and (args.pairs or not args.poses):
        expected = "--fit-poses with --poses and --truth, and without --pairs"
        raise InputError(expected, found=args.fit_poses)
    if args.pairs:
        on_mesh, on_model = read_pairs(args.pairs)
        with within(args.pairs):
            T, rms_m = pairs_transform(on_mesh * unit_m, on_model)
        console.note(f"{len(on_mesh)} pairs, residual {1e3 * rms_m:.3f} mm RMS")
        if sentence := doubtful_pairs(on_mesh * unit_m, on_model):
            console.note(f"warning: {args.pairs}: {named(sentence, option_name)}")
        return T
    if args.fit_poses == "origin":
        return None
    return trajectories_transform(*_poses_and_truth(args), args.fit_poses)


def _poses_and_truth(args: Namespace) -> "tuple[Trajectory, Trajectory]":
    """--poses and --truth, with the stamps of the same frames."""
    from iclnuim.sequences.pose_lines import tied_to_poses

    estimate = read_trajectory(args.poses)
    with within(args.poses):
        truth, estimate = tied_to_poses(read_trajectory(args.truth), estimate)
    return estimate.trajectory, truth.trajectory


def _text(values: dict) -> str:
    lines = [f"{values['vertices']} vertices of {values['mesh']} to {values['model']} [mm]"]
    for name in ("mean", "median", "std", "min", "max", "rmse"):
        lines.append(f"  {name:<8}{1e3 * values['distance_m'][name]:>10.3f}")
    is_fitted = values["align"] == "icp"
    lines[1] += (
        "  (the paper's figure)" if is_fitted else "  (not fitted; the paper's is: --align icp)"
    )
    lines.append(f"  {_shares(values['within'], 1)}")
    if fit := values.get("fit"):
        lines.append(
            f"  without the fit: mean {1e3 * fit['unfitted_distance_m']['mean']:.3f}; the fit moved "
            f"it by {1e3 * fit['translation_m']:.3f} mm and {fit['rotation_deg']:.4f} degrees"
        )
    lines += _quality_lines(values["quality"])
    lines += [f"warning: {text}" for text in values["warnings"]]
    if "labels" in values:
        lines.append(labels_text(values["labels"]))
    return "\n".join(lines)


def _quality_lines(quality: dict) -> list[str]:
    lines = [f"{quality['samples']} samples, uniform by area; not the paper's figures"]
    for name in ("accuracy", "completion", "depth_l1"):
        if f"{name}_m" in quality:
            title = name.replace("_l1", " L1")
            holes = ", holes count as 0 m" * (name == "depth_l1")
            lines.append(f"  {title:<11}{1e3 * quality[f'{name}_m']:>10.3f} mm{holes}")
    for name in ("precision", "recall", "f_score"):
        if name in quality:
            lines.append(f"  {name.replace('_', ' '):<11} {_shares(quality[name], 2)}")
    if "completion_m" not in quality:
        return [*lines, "  no completion: name the trajectory that saw the model with --seen-by"]
    seen = f", {quality['seen_m2']:.2f} m2" if "seen_m2" in quality else ""
    return [*lines, f"  over {quality['model_samples']} samples of the model{seen}"]


def _shares(shares: dict[str, float], digits: int) -> str:
    """`12.0% within 1mm, 40.1% within 5mm`."""
    return ", ".join(f"{share:.{digits}%} within {limit}" for limit, share in shares.items())
