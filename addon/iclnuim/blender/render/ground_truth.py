"""The numbers of objects and classes in instance and class images, and the tables of objects and of
the poses of those that move.
"""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import bpy
import mathutils
import numpy as np

from ...errors import InputError
from ...formats.files import atomic_write_text, write_json
from ...geometry.points import upright_box
from ...labels.classes import FIRST_OWN, read_class_map
from ...sequences.run_folder import OBJECT_POSES, OBJECTS
from .. import surfaces
from ..open import motion
from ..surfaces import SURFACE_TYPES, Part

_SCHEMA_VERSION = 1
#: Stamps are written with six decimals.
_ROUNDED_S = 1e-6
_POSES_HEAD = "stamp,id,tx,ty,tz,qx,qy,qz,qw"
_DIGITS = 6  # micrometres
_MAX_OBJECTS = 32767  # the maximum of Blender's pass index
#: The 40 labels of NYU Depth v2 as reduced by Gupta, Arbelaez and Malik (CVPR 2013), from number 1
#: on.
NYU40 = read_class_map("nyu40").names[1:]
UNLABELLED = "unlabelled"


@dataclass(frozen=True)
class Kind:
    """A kind (class) of object: its number in label images, its name, and its NYU40 label (0 and
    `unlabelled` if there is none).
    """

    id: int
    name: str
    nyu40_id: int
    nyu40: str


def _kind(number: int, name: str, label: str) -> Kind:
    """The kind of an NYU40 label; of none for any other label."""
    if label not in NYU40:
        return Kind(number, name, 0, UNLABELLED)
    return Kind(number, name, NYU40.index(label) + 1, label)


#: name -> kind, of the shipped scenes
KINDS = {k.name: _kind(k.id, k.name, k.nyu40) for k in read_class_map("ours").classes}
NO_KIND = Kind(0, UNLABELLED, 0, UNLABELLED)


def kinds_of(names: list[str | None]) -> dict[str | None, Kind]:
    """The kind of every name; None and an empty name have no kind.

    NYU40's labels are also accepted as names.
    """
    found = {name: KINDS.get(name or "", NO_KIND) for name in names}
    for number, name in enumerate(sorted({n for n in names if n and n not in KINDS}), FIRST_OWN):
        found[name] = _kind(number, name, name)
    return found


def write_objects(folder: Path, stamps_s: np.ndarray) -> None:
    """Number the objects of the open scene, and write their tables into the folder, unless they are
    there: objects.json, and object_poses.csv if something moves at these stamps (s), frame by
    frame.
    """
    number_objects()
    table, poses_file = folder / OBJECTS, folder / OBJECT_POSES
    if table.is_file() and _covers(poses_file, stamps_s[-1]):
        return
    poses = _object_poses(stamps_s)
    if poses.rows:
        atomic_write_text(poses_file, poses.text)
    write_json(table, objects_table(poses.first_frames))


def number_objects() -> None:
    """Give every object that has a surface a unique pass index. Call it before light is baked:
    copies keep the index.

    A custom property `instance_id` of the scene is used if it is a whole number that no other
    object has; the other objects get the remaining numbers, in alphabetical order. Instances of one
    object share its number. Objects that only later frames show come last. Raises InputError for
    more than 32767 objects.
    """
    shown = [thing for thing in bpy.context.scene.objects if thing.type in SURFACE_TYPES]
    with surfaces.as_rendered(bpy.context.scene) as depsgraph:  # not as the viewport shows it
        instances = (i.object for i in depsgraph.object_instances if i.is_instance)
        # the type of the shown object decides: a point cloud contains meshes
        instanced = {thing.original for thing in instances if thing.type in SURFACE_TYPES}
    things = sorted(shown, key=lambda thing: thing.name)
    things += sorted(instanced.difference(shown), key=lambda thing: thing.name)
    if len(things) > _MAX_OBJECTS:
        expected = f"at most {_MAX_OBJECTS} objects for instance numbers"
        raise InputError(expected, found=len(things), hint="joining some")
    taken: set[int] = set()
    for thing in things:
        own = thing.get("instance_id")
        usable = type(own) is int and 0 < own <= _MAX_OBJECTS and own not in taken
        thing.pass_index = own if usable else 0
        taken.add(thing.pass_index)
    free = (n for n in range(1, _MAX_OBJECTS + 1) if n not in taken)
    for thing in things:
        thing.pass_index = thing.pass_index or next(free)
    later = (thing for thing in bpy.data.objects if thing.type in SURFACE_TYPES)
    for thing in sorted(set(later).difference(things), key=lambda thing: thing.name):
        thing.pass_index = next(free, 0)


def objects_table(first_frames: Mapping[int, int] | None = None) -> dict:
    """The table of all objects that the current frame shows, by number, and of those that only
    appear later, at the first of their frames. Call it after number_objects(). An instanced object
    has a row for each instance.

    `T_world_object`: Blender's matrix by rows, which may contain a scale. `box_world_m`: minimum
    and maximum x, y, z. `box_m`: the smallest upright box: centre and quaternion (x y z w) in the
    world, with its x axis along the longer horizontal side; full side lengths.
    """
    scene = bpy.context.scene
    before = scene.frame_current
    shown = _shown()
    here = {part.number for part in shown}
    later = {n: frame for n, frame in (first_frames or {}).items() if n not in here}
    for frame in sorted(set(later.values())):
        scene.frame_set(frame)
        shown += [part for part in _shown() if later.get(part.number) == frame]
    scene.frame_set(before)
    kinds = kinds_of([part.class_name for part in shown])
    rows = [part.row(kinds[part.class_name]) for part in shown]
    rows.sort(key=lambda row: (row["id"], row["box_m"]["centre"]))
    listed = sorted({kind.id: kind for kind in kinds.values()}.values(), key=lambda kind: kind.id)
    return {
        "schema_version": _SCHEMA_VERSION,
        "world": "metres, right-handed, z up",
        "objects": rows,
        "classes": [asdict(kind) for kind in listed],
    }


@dataclass(frozen=True)
class _ShownPart:
    """A rendered object or instance, as far as it does not depend on other objects."""

    number: int
    name: str
    class_name: str | None
    places: dict

    def row(self, kind: Kind) -> dict:
        return {
            "id": self.number,
            "name": self.name,
            "class": kind.name,
            "class_id": kind.id,
            "nyu40_id": kind.nyu40_id,
            **self.places,
        }


def _shown() -> list[_ShownPart]:
    shown = []
    with surfaces.rendered_parts() as (found, _):
        for part in found:
            source = part.source
            names = (source.name, surfaces.class_name(source))
            shown.append(_ShownPart(source.pass_index, *names, _places(part)))
    return shown


def _places(part: Part) -> dict:
    points_m = part.vertices_m()
    box = upright_box(points_m)
    return {
        "T_world_object": _listed(np.array(part.matrix)),
        "box_world_m": {"min": _listed(points_m.min(0)), "max": _listed(points_m.max(0))},
        "box_m": {
            "centre": _listed(box.T_world_box.translation),
            "quat_xyzw": _listed(box.T_world_box.quat_xyzw),
            "size": _listed(box.size_m),
        },
    }


def _listed(values: np.ndarray) -> list:
    return (np.round(values, _DIGITS) + 0.0).tolist()


@dataclass(frozen=True)
class _ObjectPoses:
    """The table of poses by rows, and the first frame of each object of it, by number."""

    rows: list[str]
    first_frames: dict[int, int]

    @property
    def text(self) -> str:
        return "\n".join([_POSES_HEAD, *self.rows]) + "\n"


def _object_poses(stamps_s: np.ndarray) -> _ObjectPoses:
    """The poses of all moving objects with a surface; no rows if nothing moves.

    Row by row: the stamp (s) of frame i, the number of the object, its position (m) and its
    quaternion (x y z w) in the world, without scale. An instanced object has a row for each
    instance. Call it after number_objects(); the current frame is restored.
    """
    scene = bpy.context.scene
    moving = set(motion.all_moving_names(scene))
    poses = _ObjectPoses([], {})
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


def _covers(file: Path, stamp_s: float) -> bool:
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
