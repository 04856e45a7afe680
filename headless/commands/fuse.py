"""`iclnuim fuse`: fuses depth images along a trajectory into a coloured surface."""

from argparse import ArgumentParser, Namespace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from iclnuim.benchmark.fusion.settings import PRESETS, FuseSettings, VolumeSettings
from iclnuim.console import Console
from iclnuim.errors import InputError, StrPath, named
from iclnuim.formats.files import check_file, is_file, read_json, write_json
from iclnuim.formats.ply import write_ply
from iclnuim.trajectory_files.trajectories import ANCHORED_WORLD, LoadedTrajectory

from ..method_options import require
from ..options import add_settings, common, option_name, settings_from, trajectory_file
from ..planned_work import FUSE_CORE_S, PlannedWork, announce
from ..sequence_input import add_camera_options, note_sequence, opened_with_camera

if TYPE_CHECKING:
    from iclnuim.benchmark.fusion.mesh import Mesh
    from iclnuim.sequences.stored_sequence import StoredSequence

#: Ending of the recipe, which is written next to the mesh.
_RECIPE = ".json"


def configure(parser: ArgumentParser) -> None:
    add = parser.add_argument
    add("folder", type=Path, metavar="DIR", help="a sequence in any supported format")
    help = "trajectory in any supported format; default: ground truth of DIR"
    add("--poses", type=trajectory_file, metavar="FILE", help=help)
    help = "the surface as a PLY with colour; its recipe is written next to it"
    add("-o", "--out", type=Path, metavar="MESH", required=True, help=help)
    help = "best (default): a window of 18 m; paper: a window of 4.5 m that follows the camera"
    add("--preset", default="best", help=help)
    add_settings(parser, VolumeSettings)
    add_settings(parser, FuseSettings)
    help = "a picture of the surface, seen obliquely from above"
    add("--plot", type=Path, metavar="PNG", help=help)
    add_camera_options(parser)
    example = "iclnuim fuse out/living_room/kt2/clean --poses est.txt -o kt2.ply --plot kt2.png"
    common(parser, example)
    parser.set_defaults(beside_out=_RECIPE)


def run(args: Namespace, console: Console) -> None:
    if args.out.suffix.lower() != ".ply":
        raise InputError("a mesh named *.ply", path=args.out)
    if args.plot and args.plot.suffix.lower() != ".png":
        raise InputError("a picture named *.png", path=args.plot)
    recipe_file = args.out.with_suffix(_RECIPE)
    check_file(args.out)
    check_file(recipe_file)
    _refuse_other_json(recipe_file)
    require(console, "fuse", "numba", "cv2")
    if args.plot:
        require(console, "fuse --plot", "embreex")
    from iclnuim.benchmark.fusion.sequence import fuse_sequence
    from iclnuim.benchmark.odometry.run import Sequence

    settings = _settings(args, console)
    stored = opened_with_camera(args, args.folder)
    poses, loaded = _poses(args, stored)
    console.note(f"{poses}: {loaded.read_as.sentence}")
    sequence = Sequence(stored, frames=settings.frames)
    note_sequence(stored, console, loaded.trajectory)
    what = f"{len(sequence)} frames to fuse"
    announce(PlannedWork(what, len(sequence) * FUSE_CORE_S), args, console)
    surface = fuse_sequence(stored, loaded.trajectory, settings, console.progress)
    for line in surface.left_out[:5]:
        console.note(f"left out: {line}")
    for sentence in surface.notes:
        console.note(f"warning: {args.folder}: {named(sentence, option_name)}")
    mesh = surface.mesh
    write_ply(args.out, mesh.points, mesh.triangles, colours=mesh.colours)
    figures = {"mesh": str(args.out), "sequence": str(args.folder), "poses": str(poses)}
    figures |= surface.figures
    write_json(recipe_file, {**_recipe_head(), **figures})
    if args.plot:
        _draw(mesh, loaded, args.plot)
    console.note(f"{recipe_file} written: how the surface was fused")
    console.result(figures, _text(figures))


def _poses(args: Namespace, sequence: "StoredSequence") -> tuple[StrPath, LoadedTrajectory]:
    """The file of the poses, and the poses."""
    assert sequence.pairs  # a folder without a sequence is reported as such
    if args.poses:
        return args.poses, sequence.load_poses(args.poses)
    poses = sequence.truth_path
    loaded = sequence.loaded_truth
    if poses is None or loaded is None:
        raise InputError(
            "a ground truth in the folder", path=args.folder, found="none", hint="--poses FILE"
        )
    return poses, loaded


def _recipe_head() -> dict:
    from iclnuim.shipped import source_commit
    from iclnuim.version import __version__

    return {
        "schema_version": 1,
        "kind": "surface",
        "iclnuim": __version__,
        "source_commit": source_commit(),
    }


def _text(f: dict) -> str:
    return (
        f"{f['mesh']}: {f['vertices']} vertices, {f['triangles']} triangles\n"
        f"{f['frames']} frames fused, {f['left_out']} left out, {f['seconds']:.1f} s "
        f"({f['frames'] / f['seconds']:.1f} frames per second with reading; fusing alone "
        f"{f['fusing_ms_per_frame']:.1f} ms per frame, meshing {f['meshing_s']:.1f} s)\n"
        f"at most {f['max_blocks_used']} blocks, {f['memory_mb']:.0f} MB; {f['parts_out_of_window']} "
        "parts left the window"
    )


def _refuse_other_json(path: Path) -> None:
    """Raises InputError if a file exists where the recipe is to be written and is not the recipe of
    a surface.
    """
    if not is_file(path):
        return
    try:
        found = read_json(path).get("kind")
    except InputError:
        found = None
    if found != "surface":
        expected = "no file, or the recipe of an earlier surface, which the new one replaces"
        raise InputError(expected, path=path, found="another file", hint="another name for {out}")


def _settings(args: Namespace, console: Console) -> FuseSettings:
    """The preset with the given options.

    The truncation distance, unless given, and the distance behind a surface grow with the voxels.
    """
    if args.preset not in PRESETS:
        raise InputError(f"a preset ({', '.join(PRESETS)})", found=args.preset)
    base = PRESETS[args.preset]
    voxel_m = base.voxel_m if args.voxel is None else args.voxel
    truncation_m, behind_m = base.reach_m(voxel_m)
    if args.truncation is not None:
        truncation_m = args.truncation
        behind_m = min(behind_m, truncation_m)
    volume = settings_from(args, base, truncation_m=truncation_m, behind_m=behind_m)
    if args.truncation is None and volume.truncation_m > base.truncation_m:
        console.note(f"truncation distance {truncation_m:g} m: three voxels of {voxel_m:g} m")
    return settings_from(args, FuseSettings(volume))


def _draw(mesh: "Mesh", loaded: LoadedTrajectory, path: Path) -> None:
    """Draw the mesh.

    If the world is the frame of the first camera (y down), it is rotated z up, as far as the tilt
    of that camera allows.
    """
    from iclnuim.benchmark.fusion.pictures import picture
    from iclnuim.formats.png import write_png
    from iclnuim.geometry.axes import Z_UP_FROM_Y_DOWN

    first = loaded.trajectory.T_world_camera[0].matrix
    y_down = loaded.read_as.frame == ANCHORED_WORLD or np.allclose(first, np.eye(4), atol=1e-3)
    points = mesh.points @ Z_UP_FROM_Y_DOWN.T if y_down else mesh.points
    write_png(path, picture(points, mesh.triangles, mesh.colours))
