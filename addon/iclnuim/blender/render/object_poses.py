"""The poses of objects that move, frame by frame."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import bpy
import mathutils
import numpy as np

from .. import surfaces
from ..open import motion

#: Stamps are written with six decimals.
_ROUNDED_S = 1e-6
_HEAD = "stamp,id,tx,ty,tz,qx,qy,qz,qw"


@dataclass(frozen=True)
class ObjectPoses:
    """The table of poses by rows, and the first frame of each object of it, by number."""

    rows: list[str]
    first_frames: dict[int, int]

    @property
    def text(self) -> str:
        return "\n".join([_HEAD, *self.rows]) + "\n"


def object_poses(stamps_s: np.ndarray) -> ObjectPoses:
    """The poses of all moving objects with a surface; no rows if nothing moves.

    Row by row: the stamp (s) of frame i, the number of the object, its position (m) and its
    quaternion (x y z w) in the world, without scale. An instanced object has a row for each
    instance. Call it after number_objects(); the current frame is restored.
    """
    scene = bpy.context.scene
    moving = set(motion.all_moving_names(scene))
    poses = ObjectPoses([], {})
    if not moving:
        return poses
    before = scene.frame_current
    with surfaces.as_rendered(scene) as depsgraph:
        go_to = surfaces.frame_changer(scene)
        for frame, stamp_s in enumerate(stamps_s):
            go_to(frame)
            for number, pose in sorted(_numbers_and_poses(depsgraph, moving)):
                poses.rows.append(f"{stamp_s:.6f},{number},{pose}")
                poses.first_frames.setdefault(number, frame)
        go_to(before)
    return poses


def covers(file: Path, stamp_s: float) -> bool:
    """Whether a table reaches a stamp."""
    if not file.is_file():
        return False
    *_, last = file.read_text().splitlines()
    return not last.startswith("stamp") and float(last.split(",")[0]) >= stamp_s - _ROUNDED_S


def _numbers_and_poses(
    depsgraph: bpy.types.Depsgraph, moving: set[str]
) -> Iterator[tuple[int, str]]:
    for instance in depsgraph.object_instances:
        thing = instance.object
        if thing.name not in moving and (instance.parent or thing).name not in moving:
            continue
        if instance.show_self and thing.type in surfaces.SURFACE_TYPES:
            yield thing.original.pass_index, _pose(instance.matrix_world)


def _pose(matrix: mathutils.Matrix) -> str:
    place, turn, _ = matrix.decompose()
    values = (*place, turn.x, turn.y, turn.z, turn.w)
    return ",".join(f"{value + 0.0:.6f}" for value in values)
