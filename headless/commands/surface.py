"""`iclnuim surface SCENE`: exports the scene as a surface model: all of it, or what a trajectory
saw.
"""

from argparse import ArgumentParser, Namespace
from pathlib import Path

import numpy as np
from iclnuim import shipped
from iclnuim.console import Console
from iclnuim.errors import InputError
from iclnuim.formats.files import check_file
from iclnuim.formats.scene_model import SceneModel, obj_parts, write_obj, write_ply
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.scene_axes import SceneReading
from iclnuim.geometry.se3 import SE3
from iclnuim.trajectory_files.trajectories import read_trajectory

from ..isolation import opened_scene
from ..options import SCENE_KINDS, add_scene_options, common, settings_from
from ..outputs import refuse_existing

#: Number of pieces that --seen-by may cut a scene into: about 4 GB.
_MAX_PIECES = 20_000_000
WRITERS = {".ply": write_ply, ".obj": write_obj}


def configure(parser: ArgumentParser) -> None:
    add = parser.add_argument
    add("scene", metavar="SCENE", help=f"living_room, office, or a file: {SCENE_KINDS}")
    help = ".ply, or .obj with .mtl and textures; default: SCENE.ply, if there is no such file"
    add("-o", "--out", type=Path, metavar="MODEL", help=help)
    help = "only what this trajectory saw: kt2, office/kt0 or a file; may be given several times"
    add("--seen-by", action="append", metavar="TRAJECTORY", help=help)
    help = "for --seen-by: use every Nth pose; default: 10"
    add("--every", type=int, default=10, metavar="N", help=help)
    help = (
        "for --seen-by: longest edge of the pieces whose visibility is tested, in metres; "
        "default: 0.05"
    )
    add("--cell", type=float, default=0.05, metavar="M", help=help)
    help = "camera of --seen-by; default: 640x480 and the paper's K"
    add("--camera", metavar="WxH[,FX,FY,CX,CY]", help=help)
    help = "leave out an object, or a class such as backdrop; may be given several times"
    add("--without", action="append", default=[], metavar="NAME", help=help)
    add_scene_options(parser)
    example = "iclnuim surface living_room -o living_room_kt2.ply --seen-by kt2 --without backdrop"
    common(parser, example)
    parser.set_defaults(opens="scene")


def run(args: Namespace, console: Console) -> None:
    out = _checked_out(args)
    if args.every < 1 or not args.cell > 0:
        expected = "--every of at least 1 and --cell above 0"
        raise InputError(expected, found=f"{args.every}, {args.cell:g}")
    poses = [poses_of(name, args.scene)[:: args.every] for name in args.seen_by or ()]
    camera = PinholeCamera.parse(args.camera) if args.camera else PinholeCamera()
    model = _model(args, out)
    if not len(model):
        found = "all objects left out by --without"
        raise InputError("at least one object of the scene", found=found)
    whole_m2 = float(model.area_m2().sum())
    if poses:
        model = _seen(model, camera, poses, args.cell, console)
        if not len(model):
            what = "a trajectory that sees part of the scene"
            raise InputError(what, found="nothing seen", hint="a trajectory of this scene")
    WRITERS[out.suffix.lower()](out, model)
    area_m2 = float(model.area_m2().sum())
    points_m = model.corners_m.reshape(-1, 3)
    figures = {
        "file": str(out),
        "triangles": len(model),
        "objects": len(np.unique(model.instance)),
        "area_m2": round(area_m2, 3),
    }
    if poses:
        figures["share_of_surface"] = round(area_m2 / whole_m2, 4) if whole_m2 else 0.0
    figures["min_m"] = points_m.min(0).round(3).tolist()
    figures["max_m"] = points_m.max(0).round(3).tolist()
    console.result(figures, "\n".join(f"{key:17} {value}" for key, value in figures.items()))


def _checked_out(args: Namespace) -> Path:
    """The file to write; raises InputError if it cannot be, or if others would be lost."""
    out = args.out or Path(f"{Path(args.scene).stem}.ply")
    if out.suffix.lower() not in WRITERS:
        expected = "a file name ending in .ply or .obj"
        raise InputError(expected, path=out, found=out.suffix or "no ending")
    if args.out is None:
        refuse_existing(out, "-o MODEL")
    check_file(out)
    if out.suffix.lower() == ".obj" and not out.exists():
        for part in obj_parts(out):
            refuse_existing(part, "another name for {out}")
    return out


def poses_of(name: str, scene: str) -> SE3:
    """The poses (k,) of a shipped trajectory (of the room `scene` if the name gives no room) or of
    a file.
    """
    own = name if "/" in name or scene not in shipped.SCENE_NAMES else f"{scene}/{name}"
    path = shipped.trajectory_file(own) if own in shipped.sequence_names() else Path(name)
    return read_trajectory(path).trajectory.T_world_camera


def _model(args: Namespace, out: Path) -> SceneModel:
    reading = settings_from(args, SceneReading())
    with opened_scene("surface", args.scene, reading, writes=[out]):
        from iclnuim.blender.render import ground_truth, model

        found = model.scene_model()
        rows = ground_truth.objects_table()["objects"]
    left_out = {0}  # held out of frames
    for word in args.without:
        ids = {row["id"] for row in rows if word in (row["name"], row["class"])}
        if not ids:
            listed = ", ".join(sorted({row["class"] for row in rows}))
            raise InputError(f"an object's name or a class ({listed})", found=word)
        left_out |= ids
    return found.chosen(~np.isin(found.instance, sorted(left_out)))


def _seen(
    model: SceneModel, camera: PinholeCamera, poses: list[SE3], cell_m: float, console: Console
) -> SceneModel:
    from iclnuim.raycast.visibility import Visibility

    smallest_m = float(np.sqrt(2 * model.area_m2().sum() / _MAX_PIECES))
    if cell_m < smallest_m:
        expected = f"at least {smallest_m:.3g} m in a scene of this size"
        raise InputError(expected, setting="--cell", found=f"{cell_m:g}")
    pieces, _ = model.cut(cell_m)
    visibility = Visibility(pieces)
    progress = console.progress(sum(len(T.translation) for T in poses), "surface", "poses")
    for T_world_camera in poses:
        visibility.along(camera, T_world_camera, progress.advance)
    return pieces.chosen(visibility.seen.any(1))
