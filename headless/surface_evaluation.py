"""`iclnuim evaluate surface`: the distance of a reconstruction from the true surface, as in the paper's Tables II and VII."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from .console import Console
from .options import action

if TYPE_CHECKING:
    import numpy as np


def configure(actions: argparse._SubParsersAction) -> None:
    example = "iclnuim evaluate surface kt2.ply --model living_room --plot error.png"
    parser = action(actions, "surface", "distance of a reconstruction from the true surface", example, run)
    add = parser.add_argument
    add("mesh", type=Path, metavar="MESH", help="the reconstruction (.ply, .obj, .stl, .off, .glb)")
    add("--model", required=True, metavar="MODEL", help="the truth: living_room, office, a .blend, or a mesh file")
    add(
        "--transform",
        type=Path,
        metavar="FILE",
        help="the 16 numbers of T_model_mesh, row by row; default: none needed",
    )
    add(
        "--poses",
        type=Path,
        metavar="EST",
        help="trajectory that MESH was fused along; with --truth, the first poses are laid together",
    )
    add("--truth", type=Path, metavar="GT", help="ground truth of that trajectory, in the model's world")
    add(
        "--align",
        default="none",
        metavar="HOW",
        help="none (default), or icp: then fitted to the model, as the paper did",
    )
    add("--plot", type=Path, metavar="FILE", help="heat map and histogram (.png, .pdf, .svg)")
    add("--most", type=float, default=10.0, metavar="MM", help="red end of the heat map; default: 10")


def run(args: argparse.Namespace, console: Console) -> None:
    from iclnuim.errors import InputError
    from iclnuim.fusion.models import read_mesh, read_model
    from iclnuim.fusion.surface_error import Judge

    if args.align not in ("none", "icp"):
        raise InputError("an alignment of none or icp", found=args.align)
    points, triangles, _ = read_mesh(args.mesh)
    T_model_mesh = _given(args)
    judge = Judge(*read_model(args.model))
    if args.align == "icp":
        T_model_mesh = judge.refined(points, T_model_mesh)
    error = judge.error(points, T_model_mesh)
    if args.plot:
        from iclnuim.fusion.error_picture import figure
        from iclnuim.report import charts as plots

        plots.save(
            figure(points @ T_model_mesh[:3, :3].T + T_model_mesh[:3, 3], triangles, error, args.most), args.plot, 100
        )
    values = {"mesh": str(args.mesh), "model": args.model, "align": args.align, **error.to_dict()}
    console.result(values, _text(values))


def _given(args: argparse.Namespace) -> np.ndarray:
    """T_model_mesh (4, 4) as far as it is given."""
    import numpy as np
    from iclnuim.errors import InputError
    from iclnuim.formats.trajectories import read_trajectory

    if args.transform and (args.poses or args.truth) or bool(args.poses) != bool(args.truth):
        raise InputError("--transform, or --poses and --truth together, or none of them", found="some of them")
    if args.transform:
        return _read_transform(args.transform)
    if not args.poses:
        return np.eye(4)
    poses, truth = (read_trajectory(path).trajectory for path in (args.poses, args.truth))
    nearest = int(np.abs(truth.stamps_s - poses.stamps_s[0]).argmin())
    if abs(truth.stamps_s[nearest] - poses.stamps_s[0]) > 0.02:
        raise InputError(
            f"a pose at {poses.stamps_s[0]:.3f} s", path=args.truth, found=f"{truth.stamps_s[nearest]:.3f} s at best"
        )
    return (truth.T_world_camera[nearest] @ poses.T_world_camera[0].inverse()).matrix


def _read_transform(path: Path) -> np.ndarray:
    import numpy as np
    from iclnuim.errors import InputError
    from iclnuim.formats.files import read_text

    try:
        T = np.array([float(word) for word in read_text(path).replace(",", " ").split()])
    except ValueError as error:
        raise InputError("the 16 numbers of a 4x4 matrix", path=path, found=error) from None
    if T.size != 16:
        raise InputError("the 16 numbers of a 4x4 matrix", path=path, found=f"{T.size} numbers")
    T = T.reshape(4, 4)
    if (
        not np.isfinite(T).all()
        or not np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-3)
        or np.abs(T[3] - (0, 0, 0, 1)).max() > 1e-9
    ):
        raise InputError("a rigid motion, last row 0 0 0 1", path=path)
    return T


def _text(values: dict) -> str:
    d = {name: f"{1e3 * value:.3f}" for name, value in values["distance_m"].items()}
    lines = [f"{values['vertices']} vertices of {values['mesh']} to {values['model']} [mm]"]
    lines += [f"  {name:<8}{d[name]:>10}" for name in ("mean", "median", "std", "min", "max", "rmse")]
    return "\n".join([*lines, "  " + ", ".join(f"{share:.1%} within {w}" for w, share in values["within"].items())])
