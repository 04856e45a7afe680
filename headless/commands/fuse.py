"""`iclnuim fuse`: fuses depth images along a trajectory into a coloured surface."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from iclnuim.benchmark.fusion.settings import PRESETS, FuseSettings, VolumeSettings
from iclnuim.console import Console
from iclnuim.errors import InputError
from iclnuim.formats.files import check_file, is_file, read_json, write_json
from iclnuim.formats.ply import write_ply
from iclnuim.formats.trajectories import ANCHORED_WORLD, LoadedTrajectory, read_trajectory

from ..method_options import open_sequence, require
from ..options import add_settings, common, settings_from
from ..sequence_options import add_camera_options

if TYPE_CHECKING:
    from iclnuim.benchmark.fusion.mesh import Mesh

#: Ending of the recipe, which is written next to the mesh.
_RECIPE = ".json"


def configure(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("folder", type=Path, metavar="DIR", help="a sequence in any supported format")
    add(
        "--poses",
        type=Path,
        metavar="FILE",
        help="trajectory in any supported format; default: ground truth of DIR",
    )
    help = "the surface as a PLY with colour; its recipe is written next to it"
    add("-o", "--out", type=Path, metavar="MESH", required=True, help=help)
    help = "best (default): a window of 18 m; paper: a window of 4.5 m that follows the camera"
    add("--preset", default="best", help=help)
    add_settings(parser, VolumeSettings)
    add_settings(parser, FuseSettings)
    add(
        "--plot",
        type=Path,
        metavar="PNG",
        help="a picture of the surface, seen obliquely from above",
    )
    add_camera_options(parser)
    common(
        parser, "iclnuim fuse out/living_room/kt2/clean --poses est.txt -o kt2.ply --plot kt2.png"
    )
    parser.set_defaults(beside_out=_RECIPE)


def run(args: argparse.Namespace, console: Console) -> None:
    if args.out.suffix.lower() != ".ply":
        raise InputError("a mesh named *.ply", path=args.out)
    recipe_file = args.out.with_suffix(_RECIPE)
    check_file(args.out)
    check_file(recipe_file)
    _refuse_other_json(recipe_file)
    require("fuse", "numba", "cv2")
    if args.plot:
        require("fuse --plot", "embreex")
    from iclnuim.benchmark.fusion.sequence import fuse_sequence
    from iclnuim.dataset.frames import find_pairs, find_truth
    from iclnuim.shipped import source_commit
    from iclnuim.version import __version__

    if args.preset not in PRESETS:
        raise InputError(f"a preset ({', '.join(PRESETS)})", found=args.preset)
    settings = settings_from(args, FuseSettings(_volume_settings(args)))
    volume = settings.volume
    if args.truncation is None and volume.truncation_m > PRESETS[args.preset].truncation_m:
        console.note(
            f"truncation distance {volume.truncation_m:g} m: three voxels of {volume.voxel_m:g} m"
        )
    find_pairs(args.folder)  # a folder without a sequence is reported as such
    poses = args.poses or find_truth(args.folder)
    if poses is None:
        raise InputError(
            "a ground truth in the folder", path=args.folder, found="none", hint="--poses FILE"
        )
    loaded = read_trajectory(poses)
    console.note(f"{poses}: {loaded.read_as.sentence}")
    camera = open_sequence(args, console, args.folder).camera
    surface = fuse_sequence(args.folder, loaded.trajectory, settings, console.progress, camera)
    for line in surface.left_out[:5]:
        console.note(f"left out: {line}")
    write_ply(args.out, surface.mesh.points, surface.mesh.triangles, colours=surface.mesh.colours)
    figures = {
        "mesh": str(args.out),
        "sequence": str(args.folder),
        "poses": str(poses),
        **surface.figures,
    }
    recipe = {
        "schema_version": 1,
        "kind": "surface",
        "iclnuim": __version__,
        "source_commit": source_commit(),
    }
    write_json(recipe_file, {**recipe, **figures})
    if args.plot:
        _draw(surface.mesh, loaded, args.plot)
    f, rate = figures, figures["frames"] / figures["seconds"]
    lines = (
        f"{f['mesh']}: {f['vertices']} vertices, {f['triangles']} triangles",
        f"{f['frames']} frames fused, {f['left_out']} left out, {f['seconds']:.1f} s ({rate:.1f} frames per second with reading; "
        f"fusing alone {f['fusing_ms_a_frame']:.1f} ms per frame, meshing {f['meshing_s']:.1f} s)",
        f"at most {f['blocks_at_most']} blocks, {f['memory_mb']:.0f} MB; {f['parts_that_left']} parts left the window",
    )
    console.result(figures, "\n".join(lines))


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


def _volume_settings(args: argparse.Namespace) -> VolumeSettings:
    """The preset with the given options.

    The truncation distance, unless given, and the distance behind a surface grow with the voxels.
    """
    base = PRESETS[args.preset]
    voxel_m = base.voxel_m if args.voxel is None else args.voxel
    truncation_m = (
        max(base.truncation_m, 3 * voxel_m) if args.truncation is None else args.truncation
    )
    behind_m = min(max(base.behind_m, 2 * voxel_m), truncation_m)
    return settings_from(args, base, truncation_m=truncation_m, behind_m=behind_m)


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
