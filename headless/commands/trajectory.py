"""`iclnuim trajectory`: info, convert, plot, make, camera, adopt, resample.

Each action reports the coordinate frames of its input and output.
"""

import argparse
import json
import os
import re
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np
from iclnuim import shipped
from iclnuim.console import Console
from iclnuim.errors import InputError, WorkError
from iclnuim.formats import trajectories as files
from iclnuim.formats.files import (
    atomic_write_text,
    check_file,
    data_lines,
    make_folder,
    read_json,
    read_text,
)
from iclnuim.formats.trajectories import TUM_HEADER
from iclnuim.geometry import handheld
from iclnuim.geometry import trajectory as trajectories
from iclnuim.geometry.handheld_plan import FreeSpace, PlanSettings, Waypoint, plan
from iclnuim.geometry.scene_axes import SceneReading, is_plausible, parse_unit, shape_of
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.raycast.caster import RayCaster, viewpoints
from iclnuim.raycast.distance import TriangleDistance

from ..isolation import opened_scene
from ..options import (
    SCENE_KINDS,
    Actions,
    action,
    add_scene_options,
    add_settings,
    settings_from,
)
from ..outputs import refuse_existing

#: The planner searches this far beyond the viewpoints for a way around obstacles.
_DETOUR_M = 2.0
#: Distance from the scene in which every viewpoint is accepted.
_NEAR_M = 20.0
NAMES = [*shipped.paper_sequences(), *shipped.HARD_SEQUENCES]
#: Formats with stamps; the others number their frames.
_WITH_STAMPS = ("tum", "euroc", "vslam-lab")
_FILE = "a trajectory file or a folder of POV-Ray camera files"


def configure(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(metavar="ACTION", required=True, dest="action")
    text = "frames, length, duration, speeds, rotation rates, gaps, and how each file was read"
    info = action(
        actions, "info", text, "iclnuim trajectory info trajectories/living_room/kt2.txt", run_info
    )
    info.add_argument("files", nargs="+", metavar="FILE", help=_FILE)
    _add_reading(info)
    _configure_changes(actions)
    text, example = (
        "top view and time plots of position, speed and rotation rate",
        "kt0.txt kt2.txt -o trajectories.png",
    )
    plot = action(actions, "plot", text, f"iclnuim trajectory plot {example}", run_plot, json=False)
    plot.add_argument("files", nargs="+", metavar="FILE", help="trajectory files")
    help = "the picture (.png, .pdf or .svg); an existing file is overwritten"
    plot.add_argument("-o", "--out", required=True, metavar="PNG", help=help)
    _add_reading(plot)
    _configure_make(actions)
    text = "write the animation of a scene's camera as a TUM trajectory"
    camera = action(
        actions, "camera", text, "iclnuim trajectory camera room.blend -o film.txt", run_camera
    )
    camera.set_defaults(opens="scene")
    camera.add_argument("scene", metavar="SCENE", help=f"a file: {SCENE_KINDS}")
    camera.add_argument(
        "-o",
        "--out",
        type=Path,
        metavar="OUT",
        help="default: the scene's name with .txt, in the working folder",
    )
    camera.add_argument(
        "--camera-object", metavar="NAME", help="use this camera instead of the active one"
    )
    camera.add_argument("--force", action="store_true", help="overwrite OUT")
    add_scene_options(camera)


def _configure_changes(actions: Actions) -> None:
    """Add the actions that read a trajectory and write another."""
    text, example = (
        "convert a trajectory file to another format",
        "iclnuim trajectory convert traj0.gt.freiburg kt0.txt",
    )
    convert = action(
        actions, "convert", text, example, partial(_run_change, _restamped), json=False
    )
    convert.add_argument("source", metavar="IN", help=_FILE)
    words = ", ".join(writer.word for _, writer in files.FORMATS.values() if writer and writer.word)
    help = (
        "output file; its name decides the format: .tum .txt .csv .kitti .gt.freiburg .gt.sim; "
        f"the words {words} in the name of a .txt file select these formats instead of TUM"
    )
    convert.add_argument("out", metavar="OUT", help=help)
    help = "use the stamps 1 + i / FILE_RATE instead of those of the file"
    convert.add_argument("--restamp", action="store_true", help=help)
    text = "move any trajectory into a scene with a start pose and a uniform scale (equation 2 of the paper)"
    example = "iclnuim trajectory adopt odometer.txt --start -1.4,-1.4,1.5,0,0.707,0.707,0 --scale 0.8 -o kt9.txt"
    adopt = action(actions, "adopt", text, example, partial(_run_change, _adopted), json=False)
    # a start pose may begin with a minus, which argparse would read as an option
    adopt._negative_number_matcher = re.compile(r"^-[\d.]")
    adopt.add_argument("source", metavar="SOURCE", help="a trajectory file")
    pose = "camera to world, 'x,y,z,qx,qy,qz,qw', or a trajectory file whose first pose is used"
    adopt.add_argument("--start", required=True, metavar="POSE", help=pose)
    adopt.add_argument(
        "--scale",
        type=float,
        default=1.0,
        metavar="S",
        help="scale of the translations of SOURCE (default 1)",
    )
    text = "the same motion at another frame rate, by interpolation on SE(3)"
    example = "iclnuim trajectory resample kt2.txt --rate 120 -o kt2_120hz.txt"
    resample = action(
        actions, "resample", text, example, partial(_run_change, _resampled), json=False
    )
    resample.add_argument("source", metavar="SOURCE", help="a trajectory file")
    resample.add_argument("--rate", required=True, type=float, metavar="HZ", help="15 to 240")
    names = ", ".join(name for name, known in files.FORMATS.items() if known.writer)
    for parser in (convert, adopt, resample):
        add = parser.add_argument
        if parser is not convert:
            add("-o", "--out", metavar="OUT", help="output file; default: TUM on standard output")
        _add_reading(parser)
        help = f"format of OUT, instead of the one that its name implies: {names}"
        add("--to", dest="out_format", metavar="FORMAT", help=help)
        add(
            "--out-unit",
            type=parse_unit,
            default=1.0,
            metavar="UNIT",
            help="unit of the output (default m)",
        )
        help = "z of the start pose in gt.freiburg and gt.sim (default -2.25; office -2.5)"
        add("--start-z", type=float, default=-2.25, metavar="Z", help=help)
        add("--force", action="store_true", help="overwrite OUT")


def _configure_make(actions: Actions) -> None:
    """Add `make`: trajectories from their recipes, or one through a user-provided scene that keeps
    clear of its surfaces.
    """
    text = "make hand-held trajectories from their recipes: same recipe, same bytes"
    parser = action(
        actions, "make", text, "iclnuim trajectory make office/kt3 --out paths", run_make
    )
    parser.add_argument(
        "recipes",
        nargs="*",
        metavar="NAME|RECIPE",
        help="kt2, office/kt0, a recipe file; default: all",
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="write below DIR instead of next to the recipe"
    )
    help = "write nothing; exit with 3 if a file differs from the trajectory that its recipe makes"
    parser.add_argument("--check", action="store_true", help=help)
    # a viewpoint may begin with a minus, which argparse would read as an option
    parser._negative_number_matcher = re.compile(r"^-[\d.]")
    parser.add_argument(
        "--scene",
        metavar="NAME|FILE",
        help="make a trajectory through this scene instead of recipes",
    )
    places = (
        "positions in metres, z up, each optionally with a point to look at; or a file with one per line; "
        "or auto:N, which chooses N positions"
    )
    parser.add_argument("--viewpoints", nargs="+", metavar="X,Y,Z[:X,Y,Z]", help=places)
    add_settings(parser, PlanSettings)
    add_scene_options(parser)
    parser.set_defaults(opens="scene")


def _add_reading(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    names = (
        f"format of the input; default: recognised by name and content: {', '.join(files.FORMATS)}"
    )
    add("--from", dest="source_format", metavar="FORMAT", help=names)
    unit = "unit of the input: m (default), cm, mm, in, ft or a number of metres"
    add("--unit", type=parse_unit, default=1.0, metavar="UNIT", help=unit)
    rate = "frame rate of a file that numbers its frames instead of giving stamps (default 30)"
    add("--file-rate", type=float, default=30.0, metavar="HZ", help=rate)


def _loaded(args: argparse.Namespace, file: str) -> files.LoadedTrajectory:
    return files.read_trajectory(file, args.source_format, rate_hz=args.file_rate, unit_m=args.unit)


def run_info(args: argparse.Namespace, console: Console) -> None:
    found = []
    for file in args.files:
        loaded = _loaded(args, file)
        statistics = trajectories.statistics(loaded.trajectory)
        found.append(
            {"file": os.fspath(file), "read_as": asdict(loaded.read_as), **asdict(statistics)}
        )
    console.result({"trajectories": found}, "\n\n".join(_info_text(one) for one in found))


def _info_text(one: dict) -> str:
    gaps = (
        f"{one['gaps']}, the longest step is {one['longest_gap_s']:.3f} s"
        if one["gaps"]
        else "none"
    )
    return f"""{one["file"]}
  read as   {one["read_as"]["sentence"]}
  frames    {one["frames"]} at {one["rate_hz"]:.6g} Hz
  length    {one["length_m"]:.3f} m
  duration  {one["duration_s"]:.3f} s
  speed     {one["mean_speed"]:.3f} m/s on average, {one["max_speed"]:.3f} at most
  rotation  {one["mean_rotation_rate"]:.2f} degrees/s on average, {one["max_rotation_rate"]:.2f} at most
  gaps      {gaps}"""


def run_plot(args: argparse.Namespace, console: Console) -> None:
    loaded = [(file, _loaded(args, file)) for file in args.files]
    for file, one in loaded:
        console.note(f"{file}: {one.read_as.sentence}")
    from iclnuim.report import charts as plots  # Matplotlib takes half a second to import

    plots.save(
        plots.trajectories_figure([(os.path.basename(file), one) for file, one in loaded]), args.out
    )
    console.note(
        f"{args.out}: {len(loaded)} trajector{'y' if len(loaded) == 1 else 'ies'} drawn; gt.freiburg and gt.sim are rotated z up"
    )


def _run_change(
    change: Callable[[argparse.Namespace, Trajectory, Console], Trajectory],
    args: argparse.Namespace,
    console: Console,
) -> None:
    """Read a trajectory, change it, and write it. OUT is checked first, before anything is read."""
    to = args.out_format or (files.format_for_name(args.out) if args.out else "tum")
    if args.out:
        _check_out(args.out, args.force)
    loaded = _loaded(args, args.source)
    console.note(f"{args.source}: {loaded.read_as.sentence}")
    changed = change(args, loaded.trajectory, console)
    options = files.FileOptions(args.file_rate, args.out_unit, args.start_z)
    if args.out is None:
        console.result({}, files.trajectory_text(changed, to, options).rstrip("\n"))
        return
    files.write_trajectory(args.out, changed, to, options)
    goes_to = files.writer_of(to).goes_to
    console.note(f"{args.out}: {goes_to}")
    if to not in _WITH_STAMPS and args.file_rate != trajectories.FRAME_RATE_HZ:
        rate = f"{args.file_rate:g}"
        console.note(
            f"note: {args.out} has no stamps; its frames are at {rate} Hz: give --file-rate {rate} where it is read"
        )
    if "stamps are not written" in goes_to:
        _note_gaps(
            changed,
            "a line's number is no longer that of its frame: programs that read this file assume one pose per frame",
            console,
        )


def _restamped(args: argparse.Namespace, source: Trajectory, console: Console) -> Trajectory:
    return Trajectory.at_rate(source.T_world_camera, args.file_rate) if args.restamp else source


def _adopted(args: argparse.Namespace, source: Trajectory, console: Console) -> Trajectory:
    T_world_start, frame = _start_pose(args)
    adopted = trajectories.adopt(source, T_world_start, args.scale)
    console.note(
        f"adopted: the first pose is the start pose in {frame}, translations scaled by {args.scale:g}"
    )
    return adopted


def _resampled(args: argparse.Namespace, source: Trajectory, console: Console) -> Trajectory:
    resampled = trajectories.resample(source, args.rate)
    console.note(f"resampled: {len(source)} poses to {len(resampled)} at {args.rate:g} Hz")
    _note_gaps(source, "poses in it are interpolated as if the motion were uniform", console)
    args.file_rate = args.rate
    return resampled


def _note_gaps(trajectory: Trajectory, consequence: str, console: Console) -> None:
    found = trajectories.statistics(trajectory) if len(trajectory) > 1 else None
    if found and found.gaps:
        count = (
            f"{found.gaps} gap{'s' * (found.gaps > 1)}, the longest of {found.longest_gap_s:.3f} s"
        )
        console.note(f"note: the trajectory has {count}; {consequence}")


def _start_pose(args: argparse.Namespace) -> tuple[SE3, str]:
    """The pose given by --start, and the name of its world."""
    if os.path.exists(args.start):
        loaded = files.read_trajectory(args.start)
        return loaded.trajectory.T_world_camera[0], loaded.read_as.frame
    try:
        numbers = np.array([float(part) for part in args.start.split(",")])
    except ValueError:
        numbers = np.array([])
    if numbers.shape != (7,) or not np.isfinite(numbers).all():
        raise InputError("--start x,y,z,qx,qy,qz,qw or a trajectory file", found=args.start)
    try:
        return SE3.from_quat_xyzw(numbers[3:], numbers[:3]), "the world of --start"
    except InputError as error:
        raise InputError(f"{error.expected} in --start", found=error.found) from None


def _check_out(out: str | os.PathLike[str], force: bool) -> None:
    """Raises InputError if the file exists, unless `force` is true, or cannot be written."""
    if not force:
        refuse_existing(out, "--force to overwrite it")
    check_file(out)


def run_camera(args: argparse.Namespace, console: Console) -> None:
    """Write one pose for each frame of the scene's timeline."""
    out = args.out or Path(f"{Path(args.scene).stem}.txt")
    _check_out(out, args.force)
    reading = settings_from(args, SceneReading())
    with opened_scene("trajectory camera", str(Path(args.scene).resolve()), reading):
        import bpy
        from iclnuim.blender.render import camera as cameras

        camera = cameras.active(bpy.context.scene, args.camera_object)
        animated = cameras.trajectory(bpy.context.scene, camera if args.camera_object else None)
        lens = cameras.pinhole(bpy.context.scene, camera)
        if note := cameras.timeline_note(bpy.context.scene):
            console.note(f"note: {note}")
    files.write_trajectory(out, animated, "tum")
    figures = (
        asdict(trajectories.statistics(animated))
        if len(animated) > 1
        else {"frames": len(animated)}
    )
    option = (
        lens
        and f"{lens.width}x{lens.height},{lens.fx:.6g},{lens.fy:.6g},{lens.cx:.6g},{lens.cy:.6g}"
    )
    text = f"{out}: {len(animated)} poses of the camera {camera.name}"
    text += f"; its lens: --camera {option}" if option else ""
    console.result({"file": str(out), "camera": camera.name, "pinhole": option, **figures}, text)


def run_make(args: argparse.Namespace, console: Console) -> None:
    if args.scene or args.viewpoints:
        _make_in_scene(args, console)
        return
    made = []
    for name in NAMES if args.recipes in ([], ["all"]) else args.recipes:
        source, target = _places(name, args.out)
        content = read_json(source)
        try:
            motion = handheld.make(handheld.Recipe.from_dict(content))
        except InputError as error:
            raise error.at(source if error.path is None else f"{source}: {error.path}") from None
        text = tum_text(motion.trajectory)
        if not args.check:
            _refuse_other(target)
            make_folder(target.parent, hint="another {out}")
            atomic_write_text(target, text)
        elif not target.is_file():
            raise WorkError(f"{target}: does not exist, so it cannot be checked")
        elif target.read_bytes() != text.encode():
            raise WorkError(f"{target}: differs from the trajectory that its recipe makes")
        figures = asdict(trajectories.statistics(motion.trajectory))
        made.append({"name": name, "file": str(target), "scale": motion.scale, **figures})
    rows = [
        f"{'':16}{'frames':>8}{'length':>9}{'mean':>8}{'max':>7} m/s{'mean':>8}{'max':>7} deg/s   scale"
    ]
    rows += [
        f"{f['name']:16}{f['frames']:8d}{f['length_m']:9.3f}{f['mean_speed']:8.3f}{f['max_speed']:7.3f}    "
        f"{f['mean_rotation_rate']:8.1f}{f['max_rotation_rate']:7.1f}         {f['scale']:.4f}"
        for f in made
    ]
    console.result({"trajectories": made}, "\n".join(rows))


def _refuse_other(target: Path) -> None:
    """Raises InputError if a file exists that is no trajectory as this command writes it."""
    if target.exists() and not (
        target.is_file() and target.read_bytes().startswith(TUM_HEADER.encode())
    ):
        raise InputError(
            "no file, or a trajectory that was made before",
            path=target,
            found="another file",
            hint="another {out}",
        )


def tum_text(made: Trajectory) -> str:
    """A TUM file with 1e-6 m and 1e-7 in the quaternion: so few digits that rounding differences
    between processors do not appear.
    """
    rows = np.column_stack(
        [made.stamps_s, made.positions_m, made.T_world_camera.quat_xyzw + 0.0]
    ).tolist()
    line = "%.6f %.6f %.6f %.6f %.7f %.7f %.7f %.7f\n"
    text = "".join([line % tuple(row) for row in rows])
    return TUM_HEADER + text.replace("-0.000000 ", "0.000000 ").replace("-0.0000000", "0.0000000")


def _places(name: str, out: Path | None) -> tuple[Path, Path]:
    """The file of the recipe and that of the trajectory, for `kt2`, `office/kt0` or a recipe file."""
    known = f"living_room/{name}" if f"living_room/{name}" in NAMES else name
    if known in NAMES:
        folder = shipped.folder("trajectories")
        return folder / f"{known}.json", (out or folder) / f"{known}.txt"
    source = Path(name)
    if source.suffix != ".json":
        raise InputError(f"one of {', '.join(NAMES)} or a recipe file *.json", found=name)
    return source, (out or source.parent) / f"{source.stem}.txt"


def _make_in_scene(args: argparse.Namespace, console: Console) -> None:
    """Plan a trajectory through a scene; write it as NAME.txt (TUM) and its recipe as NAME.json."""
    if not args.scene or not args.viewpoints or args.recipes:
        raise InputError(
            "--scene and --viewpoints together, and no recipe", hint="--viewpoints auto:6"
        )
    settings = settings_from(args, PlanSettings())
    file = args.scene if args.scene in shipped.SCENE_NAMES else str(Path(args.scene).resolve())
    with opened_scene(
        "a trajectory through a scene", file, settings_from(args, SceneReading())
    ) as notes:
        from iclnuim.blender import surfaces

        found = surfaces.triangles()
    for note in notes:
        console.note(f"note: {note}")
    if not len(found.triangles):
        raise InputError("a scene with surfaces", path=args.scene, found="none")
    clearance = TriangleDistance(found.vertices, found.triangles).distance
    texts = args.viewpoints
    if len(texts) == 1 and (auto := re.fullmatch(r"auto(?::(\d+))?", texts[0])):
        shape = shape_of(found.vertices, found.triangles)
        if not is_plausible(shape.extent, "z"):
            size = " x ".join(f"{x:.3g}" for x in shape.extent)
            hint = "another {unit_m}, or explicit viewpoints"
            raise InputError(
                "a scene of the size of a room or building", found=f"{size} m", hint=hint
            )
        low, high = (
            np.maximum(shape.low - 0.5, found.vertices.min(0)),
            shape.low + shape.extent + 0.5,
        )
        space = FreeSpace.between(low, np.minimum(high, found.vertices.max(0)), clearance)
        waypoints = viewpoints(
            space,
            RayCaster(found.vertices, found.triangles),
            int(auto.group(1) or 6),
            settings.clearance_m,
            settings.seed,
        )
        for waypoint in waypoints:
            points = (waypoint.position_m, waypoint.look_at_m or ())
            console.note(
                "viewpoint " + ":".join(",".join(f"{x:.2f}" for x in point) for point in points)
            )
    else:
        waypoints = _waypoints(texts)
        places = np.array([w.position_m for w in waypoints])
        _check_near(places, found.vertices)
        space = FreeSpace.between(places.min(0) - _DETOUR_M, places.max(0) + _DETOUR_M, clearance)
    made = plan(waypoints, space, Path(args.scene).name, settings)
    name = (args.out or Path()) / Path(args.scene).stem
    texts_by_file = {
        name.with_suffix(".json"): json.dumps(asdict(made.recipe), indent=2) + "\n",
        name.with_suffix(".txt"): tum_text(made.motion.trajectory),
    }
    for file, text in texts_by_file.items():
        if file.exists() and file.read_bytes() != text.encode():
            raise InputError(
                "a new file name",
                path=file,
                found="a file with other content",
                hint="another {out}",
            )
    make_folder(name.parent, hint="another {out}")
    for file, text in texts_by_file.items():
        atomic_write_text(file, text)
    figures = asdict(trajectories.statistics(made.motion.trajectory))
    text = (
        f"{name}.txt: {figures['frames']} poses, {figures['length_m']:.2f} m, "
        f"{figures['mean_speed']:.3f} m/s, {figures['mean_rotation_rate']:.1f} deg/s, "
        f"at least {made.clearance_m:.3f} m from every surface; its recipe is {name}.json"
    )
    console.result(
        {
            "file": f"{name}.txt",
            "recipe": f"{name}.json",
            "clearance_m": made.clearance_m,
            **figures,
        },
        text,
    )


def _check_near(places: np.ndarray, vertices: np.ndarray) -> None:
    """Raises InputError for a viewpoint farther from the scene than the scene is large, and than
    _NEAR_M.
    """
    low, high = vertices.min(0), vertices.max(0)
    limit_m = max(_NEAR_M, float(np.linalg.norm(high - low)))
    for place in places:
        if (beyond_m := float(np.linalg.norm(place - place.clip(low, high)))) > limit_m:
            found = f"{','.join(f'{x:g}' for x in place)}, {beyond_m:.3g} m outside it"
            raise InputError(
                f"viewpoints in the scene or at most {limit_m:.3g} m outside it", found=found
            )


def _waypoints(texts: list[str]) -> list[Waypoint]:
    if len(texts) == 1 and Path(texts[0]).is_file():
        rows = data_lines(read_text(texts[0]))
        if not rows:
            raise InputError("viewpoints", path=texts[0], found="comments alone")
        return [_waypoint(row, path=texts[0], line=k) for k, row in rows]
    return [_waypoint(text) for text in texts]


def _waypoint(text: str, path: str | None = None, line: int | None = None) -> Waypoint:
    """Parse `x,y,z` or `x,y,z:x,y,z`; files may have spaces instead of commas.

    A seventh number is a pause in seconds.
    """
    try:
        numbers = [float(part) for part in re.split(r"[,:\s]+", text.strip())]
    except ValueError:
        numbers = []
    if len(numbers) not in (3, 6, 7) or not np.isfinite(numbers).all():
        raise InputError("a viewpoint X,Y,Z or X,Y,Z:X,Y,Z", path=path, line=line, found=text)
    x, y, z, *rest = numbers
    look_at_m = (rest[0], rest[1], rest[2]) if rest else None
    return Waypoint((x, y, z), look_at_m, rest[3] if len(rest) == 4 else 0.0)
