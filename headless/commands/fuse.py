"""`iclnuim fuse`: depth images and a trajectory to a coloured surface."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from iclnuim.formats.files import check_file

from ..console import Console
from ..options import common
from ..sequence_camera import add_camera_options, camera_from, words


def configure(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("folder", type=Path, metavar="DIR", help="a sequence in TUM form, or in the original's")
    add("--poses", type=Path, metavar="FILE", help="trajectory, any format that is known; default: DIR's ground truth")
    add(
        "-o",
        "--out",
        type=Path,
        metavar="MESH",
        required=True,
        help="the surface as a PLY with colour; its recipe beside it",
    )
    add(
        "--preset", default="best", help="best (default): a window of 18 m; paper: one of 4.5 m that follows the camera"
    )
    add("--voxel", type=float, metavar="M", help="side of a voxel; default: 0.00879, the paper's 4.5 m in 512")
    add("--truncation", type=float, metavar="M", help="default: 0.045, as in the paper")
    add("--far", type=float, metavar="M", help="no depth beyond this; default: 8")
    add(
        "--least-weight",
        type=float,
        default=0.25,
        metavar="N",
        help="mesh only what N frames saw, slanted views counting less; default: 0.25, use 3 with noise",
    )
    add("--frames", default="::", metavar="A:B:S", help="only these images, as a Python slice")
    add(
        "--most-blocks",
        type=int,
        metavar="N",
        help="memory: blocks of 8^3 voxels held at once; default: 120000 (0.9 GB)",
    )
    add("--plot", type=Path, metavar="PNG", help="a picture of the surface, from above and aside")
    add_camera_options(parser)
    common(parser, "iclnuim fuse out/living_room/kt2/clean --poses est.txt -o kt2.ply --plot kt2.png")


def run(args: argparse.Namespace, console: Console) -> int:
    from iclnuim.errors import InputError
    from iclnuim.formats.files import write_json
    from iclnuim.formats.trajectories import read_trajectory

    if args.out.suffix.lower() != ".ply":
        raise InputError("a mesh named *.ply", path=args.out)
    check_file(args.out)
    _needs_numba()
    settings = _settings(args)
    poses = args.poses or _truth(args.folder)
    loaded = read_trajectory(poses)
    console.note(f"{poses}: {loaded.taken.sentence}")
    from iclnuim.formats.ply import write_ply
    from iclnuim.fusion.from_sequence import fuse_sequence

    surface = fuse_sequence(args.folder, loaded.trajectory, settings, console.progress, camera_from(args))
    if surface.camera.assumed:
        console.note(words(surface.camera))
    for line in surface.left_out[:5]:
        console.note(f"left out: {line}")
    write_ply(args.out, surface.mesh.points, surface.mesh.triangles, colours=surface.mesh.colours)
    figures = {"mesh": str(args.out), "sequence": str(args.folder), "poses": str(poses), **surface.figures}
    write_json(args.out.with_suffix(".json"), {**_recipe(), **figures})
    if args.plot:
        _draw(surface.mesh, loaded, args.plot)
    console.result(figures, _text(figures))
    return 0


def _needs_numba() -> None:
    from importlib.util import find_spec

    from iclnuim.errors import WorkError

    if find_spec("numba") is None:
        raise WorkError("fuse needs numba; try: pip install 'iclnuim[odometry]'")


def _settings(args: argparse.Namespace):
    from iclnuim.errors import InputError
    from iclnuim.fusion.from_sequence import FuseSettings
    from iclnuim.fusion.volume import PRESETS

    if args.preset not in PRESETS:
        raise InputError(f"a preset ({', '.join(PRESETS)})", found=args.preset)
    given = {
        "voxel_m": args.voxel,
        "truncation_m": args.truncation or (args.voxel and max(0.045, 3 * args.voxel)),
        "far_m": args.far,
        "most_blocks": args.most_blocks,
    }
    volume = replace(PRESETS[args.preset], **{key: value for key, value in given.items() if value is not None})
    return FuseSettings(volume, args.least_weight, args.frames)


def _truth(folder: Path) -> Path:
    from iclnuim.dataset.images import find_truth
    from iclnuim.errors import InputError

    truth = find_truth(folder)
    if truth is None:
        raise InputError("a ground truth in the folder", path=folder, found="none", hint="--poses FILE")
    return truth


def _recipe() -> dict:
    from iclnuim import __version__
    from iclnuim.shipped import source_commit

    return {"schema_version": 1, "kind": "surface", "iclnuim": __version__, "source_commit": source_commit()}


def _draw(mesh, loaded, path: Path) -> None:
    """Worlds that are the first camera's frame (y down) are stood upright, as well as its tilt allows."""
    import numpy as np
    from iclnuim.formats.columns import ANCHORED_WORLD
    from iclnuim.formats.png import write_png
    from iclnuim.fusion.shading import picture
    from iclnuim.geometry.axes import Z_UP_FROM_Y_DOWN

    first = loaded.trajectory.T_world_camera[0].matrix
    y_down = loaded.taken.frame == ANCHORED_WORLD or np.allclose(first, np.eye(4), atol=1e-3)
    points = mesh.points @ Z_UP_FROM_Y_DOWN.T if y_down else mesh.points
    write_png(path, picture(points, mesh.triangles, mesh.colours))


def _text(f: dict) -> str:
    rate = f["frames"] / f["seconds"]
    return "\n".join(
        [
            f"{f['mesh']}: {f['vertices']} vertices, {f['triangles']} triangles",
            f"{f['frames']} frames fused, {f['left_out']} left out, {f['seconds']:.1f} s ({rate:.1f} a second with reading; "
            f"fusing alone {f['fusing_ms_a_frame']:.1f} ms a frame, meshing {f['meshing_s']:.1f} s)",
            f"{f['blocks_at_most']} blocks, {f['memory_mb']:.0f} MB; {f['parts_that_left']} parts left the window",
        ]
    )
