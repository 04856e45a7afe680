"""The poses of objects that move, frame by frame."""

from collections.abc import Iterator
from pathlib import Path

import bpy
import mathutils
import numpy as np

from .. import surfaces
from ..open import motion

#: Stamps are written with six decimals.
_ROUNDED_S = 1e-6
_HEAD = "stamp,id,tx,ty,tz,qx,qy,qz,qw"


def object_poses(stamps_s: np.ndarray) -> str | None:
    """A table of the poses of all moving objects with a surface, as text; None if nothing moves.

    Row by row: the stamp (s) of frame i, the number of the object, its position (m) and its
    quaternion (x y z w) in the world, without scale. An instanced object has a row for each
    instance. Call it after number_objects(); the current frame is restored.
    """
    scene = bpy.context.scene
    moving = set(motion.all_moving_names(scene))
    rows = [_HEAD]
    before = scene.frame_current
    with surfaces.as_rendered(scene) as depsgraph:
        for frame, stamp_s in enumerate(stamps_s):
            scene.frame_set(frame)
            found = sorted(_numbers_and_poses(depsgraph, moving))
            rows += [f"{stamp_s:.6f},{number},{pose}" for number, pose in found]
        scene.frame_set(before)
    return "\n".join(rows) + "\n" if len(rows) > 1 else None


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
        names = {thing.name, (instance.parent or thing).name}
        if instance.show_self and thing.type in surfaces.SURFACE_TYPES and names & moving:
            yield thing.original.pass_index, _pose(instance.matrix_world)


def _pose(matrix: mathutils.Matrix) -> str:
    place, turn, _ = matrix.decompose()
    values = (*place, turn.x, turn.y, turn.z, turn.w)
    return ",".join(f"{value + 0.0:.6f}" for value in values)
