"""Measures which part of a room no shipped trajectory sees: shares of its triangles, its surface,
and the texels of its light map.
"""

import os
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np
from iclnuim import shipped
from iclnuim.blender import surfaces
from iclnuim.blender.light import light_files
from iclnuim.blender.open import scene
from iclnuim.blender.render import model
from iclnuim.formats.scene_model import SceneModel
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.native_output import native_output_in
from iclnuim.raycast.visibility import Visibility
from iclnuim.trajectory_files.trajectories import read_trajectory

#: Longest edge of the pieces whose visibility is tested.
PIECE_M = 0.1
#: Surfaces farther from the world's origin are the painted surroundings.
_OUTSIDE_M = 8.0


@dataclass(frozen=True)
class Unseen:
    """poses: number of poses. triangles, surface (by area, without the painted surroundings),
    texels: shares, 0..1, that no pose sees.

    texels is None without a light map.
    """

    room: str
    poses: int
    triangles: float
    surface: float
    texels: float | None


def measure(room: str, every: int, camera: PinholeCamera, light: Path | None) -> Unseen:
    """Shares that are not seen from every Nth pose of the room's four trajectories. light: folder
    of its baked light. A triangle seen in part counts as seen.
    """
    with native_output_in(Path(os.devnull)):
        scene.open_scene(room)
        whole = model.scene_model()
        layout = _map_uv(light) if light else None
    pieces, origin = whole.cut(PIECE_M)
    visibility = Visibility(pieces)
    poses = 0
    for kt in shipped.TRAJECTORY_NAMES:
        trajectory = read_trajectory(shipped.trajectory_file(f"{room}/{kt}")).trajectory
        T_world_camera = trajectory.T_world_camera[::every]
        visibility.along(camera, T_world_camera, lambda: None)
        poses += len(T_world_camera)
    seen = visibility.seen
    triangles = np.zeros(len(whole), bool)
    triangles[origin[seen.any(1)]] = True
    area = np.where(np.abs(pieces.corners_m).max((1, 2)) < _OUTSIDE_M, pieces.area_m2(), 0.0)
    surface = float(area[~seen.any(1)].sum() / area.sum())
    texels = _texels(whole, *layout, seen) if layout else None
    return Unseen(room, poses, float(1 - triangles.mean()), surface, texels)


def _map_uv(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    """(2, m, 3, 2) positions in the light map of front and back, and (2, m) which sides have one;
    triangles in the order of scene_model.
    """
    layout = light_files.load_layout(folder)
    with surfaces.as_rendered(bpy.context.scene) as depsgraph:
        parts = surfaces.parts(depsgraph)
        try:
            loops = surfaces.joined(parts).triangles
            shown = np.concatenate(
                [np.full(len(p.mesh.loop_triangles), p.source.visible_camera) for p in parts]
            )
        finally:
            for part in parts:
                bpy.data.meshes.remove(part.mesh)
    return layout.uv[:, loops[shown]], layout.has[:, loops[shown, 0]]


def _texels(whole: SceneModel, uv: np.ndarray, has: np.ndarray, seen: np.ndarray) -> float:
    """Share of the used area of the light map that is not seen, over both sides of the triangles.

    Pieces are cut like those of `seen`, with their positions in the map.
    """
    total = unseen = 0.0
    for side in (0, 1):
        pieces, origin = replace(whole, uv=uv[side]).cut(PIECE_M)
        a, b, c = np.moveaxis(pieces.uv, 1, 0)
        area = np.abs(np.cross(b - a, c - a)) / 2 * has[side, origin]
        total += float(area.sum())
        unseen += float(area[~seen[:, side]].sum())
    return unseen / total if total else 0.0
