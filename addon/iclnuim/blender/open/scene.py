"""Opening a scene: a shipped scene, or a user-provided file of any supported format, which is
converted to metres and z up, repaired and lit.

The file itself is never written.
"""

import hashlib
import io
import logging
import math
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

from ... import shipped
from ...errors import InputError
from ...formats.ply import check_ply
from ...geometry.points import farthest_points
from ...geometry.scene_axes import SceneReading
from ...job import RenderJob
from ...shipped import SCENES
from .. import compat, materials, surfaces
from . import coplanar, displacement, glass, orient, preflight, sanitize, scene_paths

#: The importers keep the file's axes: orient.py rotates and scales.
_OWN_AXES = {"forward_axis": "Y", "up_axis": "Z"}

IMPORTERS: dict[str, Callable[[str], object]] = {
    ".obj": lambda path: bpy.ops.wm.obj_import(filepath=path, **_OWN_AXES),
    ".ply": lambda path: bpy.ops.wm.ply_import(filepath=path, **_OWN_AXES),
    ".glb": lambda path: bpy.ops.import_scene.gltf(filepath=path),
    ".gltf": lambda path: bpy.ops.import_scene.gltf(filepath=path),
    ".fbx": compat.import_fbx,
    **{kind: compat.import_usd for kind in (".usd", ".usda", ".usdc", ".usdz")},
}
KINDS = (".blend", *IMPORTERS)
#: Maximum number of triangles for baked light. A light map has about as many texels, and a layout
#: of more triangles takes minutes.
MAX_BAKED = 2_000_000
#: For lamps inside: number of random places, and number of rays from each.
_PLACES, _RAYS = 400, 48
#: A place needs lamps if less than this share of its rays reaches the sky.
_SHUT_IN = 0.03
_LAMPS, _RADIUS_M = 4, 0.15
#: Watts per square metre of the room's walls: mid-grey surfaces then have about a third of white.
_W_PER_M2 = 1.0
#: A smaller emitting object is a status lamp, not the light of a room.
_SMALLEST_EMITTER_M = 0.03


def open_empty() -> None:
    """Open an empty scene with factory settings, without the user's start-up file.

    Scripts in .blend files do not run.
    """
    compat.require_supported_version()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.preferences.filepaths.use_scripts_auto_execute = False


def open_scene(name: str, reading: SceneReading | None = None) -> list[str]:
    """Open a shipped scene or a file.

    Returns notes for the user. Raises InputError if it cannot be opened.
    """
    open_empty()
    if shipped.is_scene(name):
        bpy.ops.wm.open_mainfile(
            filepath=str(shipped.scene_file(name)), load_ui=False, use_scripts=False
        )
        return []
    return open_file(checked_file(name), reading or SceneReading())


def scene_sha256(name: str) -> str:
    """The hash of a version of a scene: of its file and of the files it refers to.

    Textures that only Blender can find are included only if the scene is open: open it first.
    """
    if not shipped.is_scene(name):
        return scene_paths.sha256(checked_file(name))
    return hashlib.sha256(shipped.scene_file(name).read_bytes()).hexdigest()


def open_file(path: Path, reading: SceneReading) -> list[str]:
    """Open a file in the empty session.

    Returns notes for the user; the first describes how it was read. Raises InputError if it cannot
    be used.
    """
    missing = scene_paths.check(path, reading)
    load(path)
    scene_paths.check_open(path, reading)
    if bpy.data.libraries:  # local copies of linked datablocks can be changed in memory
        bpy.ops.object.make_local(type="ALL")
    scene = bpy.context.scene
    _neutral_settings(path, scene)
    _with_background_sets(scene)
    _look_at_rendered_layer(scene)
    notes = [*missing, *_without_grease_pencil(), *sanitize.sanitize(scene)]
    if path.suffix.lower() == ".obj":
        notes += glass.without_false_glass(path)
    if not any(o.type in surfaces.SURFACE_TYPES or o.instance_collection for o in scene.objects):
        raise InputError(
            "a scene with at least one surface", path=path, found=missing[0] if missing else "none"
        )
    sentence, unusual = orient.orient(path, reading, list(scene.objects))
    notes = [*([sentence] if unusual else []), *notes]
    bpy.context.view_layer.update()
    notes += displacement.displace_meshes(scene)
    triangles = surfaces.triangle_count()
    if not triangles and not len(surfaces.triangles().triangles):
        raise InputError(
            "a scene with at least one surface", path=path, found="points and edges without a face"
        )
    if triangles <= MAX_BAKED:
        notes += coplanar.remove_coincident_faces(scene)
    return [*notes, *_light_passes_glass(), *_light_up(scene)]


def _neutral_settings(path: Path, scene: bpy.types.Scene) -> None:
    """Reset settings of the scene in the file at `path` that would change or hide surfaces, and set
    those that its importer does not set.
    """
    scene.cycles.shading_system = False  # shaders in OSL are scripts, which may read files
    scene.render.use_simplify = False
    cameras = [o for o in scene.objects if o.type == "CAMERA"]
    if scene.camera is None and len(cameras) == 1:
        scene.camera = cameras[
            0
        ]  # formats without an active camera: the only camera becomes active
    if path.suffix.lower() == ".blend":
        return
    scene.view_settings.view_transform = (
        "Standard"  # the setting after an import is Blender's default, not the file's
    )
    ranges = [tuple(action.frame_range) for action in bpy.data.actions]
    if ranges:  # importers do not set the timeline: it gets the range of all animations
        scene.frame_start = max(0, math.floor(min(first for first, _ in ranges)))
        scene.frame_end = max(scene.frame_start, math.ceil(max(last for _, last in ranges)))


def _with_background_sets(scene: bpy.types.Scene) -> None:
    """Link the objects of the background sets, which are rendered from other scenes, to this scene."""
    behind, scene.background_set = scene.background_set, None
    while behind is not None:
        for name in ("objects", "children"):
            own = getattr(scene.collection, name)
            for thing in getattr(behind.collection, name):
                if thing.name not in own:
                    own.link(thing)
        behind = behind.background_set


def _without_grease_pencil() -> list[str]:
    """Hide Grease Pencil: Blender draws it over the image by another engine, which rounds the depth
    of all pixels.
    """
    drawings = [
        o for o in bpy.data.objects if o.type in ("GREASEPENCIL", "GPENCIL") and not o.hide_render
    ]
    for thing in drawings:
        thing.hide_render = True
    names = ", ".join(sorted(o.name for o in drawings))[:120]
    return (
        [f"Grease Pencil ({names}): left out, because it is drawn over the image and has no depth"]
        if drawings
        else []
    )


def _look_at_rendered_layer(scene: bpy.types.Scene) -> None:
    """Make the first view layer, which is rendered, the active one too.

    Holdouts and indirect-only settings of its collections are moved to objects.
    """
    layer = scene.view_layers[0]
    if bpy.context.window is not None:
        bpy.context.window.view_layer = layer
    for thing in layer.objects:
        if thing.indirect_only_get(view_layer=layer):
            thing.visible_camera = False
        if thing.holdout_get(view_layer=layer):
            thing.is_holdout = True
    for collection in surfaces.layers_below(layer.layer_collection):
        collection.indirect_only = collection.holdout = False
    if getattr(layer, "world_override", None):  # from Blender 4.4 on
        scene.world, layer.world_override = layer.world_override, None


def _light_passes_glass() -> list[str]:
    names = glass.let_light_through(m for m in bpy.data.materials if m.use_nodes and m.node_tree)
    if not names:
        return []
    return [
        f"glass ({', '.join(sorted(names))[:120]}): light of lamps and sky passes straight through it, without caustics"
    ]


def with_possible_light(job: RenderJob) -> tuple[RenderJob, list[str]]:
    """The job with the light that the open scene allows, and a note if that is not the requested
    light.
    """
    if job.light == "path" or (obstacle := reason_against_baking(bpy.context.scene)) is None:
        return job, []
    return with_light(job, "path"), [f"{obstacle}: path traced instead of baked light"]


def with_light(job: RenderJob, light: str) -> RenderJob:
    """The job with this light.

    Samples that were set with light "auto" are kept. Denoising is disabled if this Blender has no
    denoiser.
    """
    job = replace(job, light=light) if job.light == "auto" else job.changed(light=light)
    return job if compat.has_denoiser() else job.changed(denoise=False)


def reason_against_baking(scene: bpy.types.Scene) -> str | None:
    """The reason why the scene cannot have a light map, or None."""
    obstacles = {
        "objects or lights that move": preflight.moving_names(scene),
        "hair, curves or points": preflight.strand_names(scene),
        "volumes": preflight.volume_names(scene) or preflight.made_volume_names(scene),
        "light linking": preflight.light_linking_names(scene),
        "toon or sheen shaders, over 6 UV maps, or materials that differ by instance": preflight.unmappable_names(
            scene
        ),
    }
    for what, names in obstacles.items():
        if names:
            return f"{what} ({', '.join(names)[:120]})"
    kinds = map(materials.kind, _shown_materials(scene))
    if not any(diffuse or translucent for diffuse, translucent, _ in kinds):
        return "no diffuse surface"
    count = surfaces.triangle_count()
    return f"{count} triangles, more than the texels of a light map" if count > MAX_BAKED else None


def _shown_materials(scene: bpy.types.Scene) -> set[bpy.types.Material | None]:
    """The materials of all surfaces, including instanced collections; None for a surface without a
    material.
    """
    things = {*scene.objects, *(o for c in bpy.data.collections for o in c.all_objects)}
    shown = [thing for thing in things if thing.type in surfaces.SURFACE_TYPES]
    bare = {None for thing in shown if not thing.material_slots}
    return bare | {slot.material for thing in shown for slot in thing.material_slots}


def checked_file(name: str) -> Path:
    """The full path of a user-provided file.

    Raises InputError if it does not exist or its format is not supported.
    """
    path = Path(name).expanduser().resolve()
    if path.suffix.lower() not in KINDS:
        raise InputError(
            f"a scene: {', '.join(SCENES)} or a scene file ending in {', '.join(KINDS)}", found=name
        )
    if not path.is_file():
        raise InputError(
            "a scene file", path=path, found="a folder" if path.is_dir() else "no such file"
        )
    if not path.stat().st_size:
        raise InputError("a scene file", path=path, found="an empty file")
    return path


def load(path: Path) -> None:
    """Import the file into the open session.

    A .blend replaces the session, and its scripts are not run. Raises InputError.
    """
    if path.suffix.lower() == ".ply":
        check_ply(path)
    logging.disable(
        logging.ERROR
    )  # importers written in Python log every node of the file and every missing texture
    try:
        with redirect_stdout(io.StringIO()):  # bpy.ops prints the errors of importers a second time
            if path.suffix.lower() == ".blend":
                result = bpy.ops.wm.open_mainfile(
                    filepath=str(path), load_ui=False, use_scripts=False
                )
            else:
                result = IMPORTERS[path.suffix.lower()](str(path))
    except AttributeError:
        without = f"{compat.version_line()} without its importer"
        raise InputError(
            "a Blender that can import this format", path=path, found=without
        ) from None
    except (RuntimeError, TypeError, UnicodeDecodeError) as error:
        # the last line of the importer's message; for an importer in Python the message contains a
        # traceback
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        messages = [line for line in lines if not line.startswith(("Location:", "File "))]
        last = (messages or lines or ["no reason given"])[-1].removeprefix("Error: ")
        raise InputError("a scene that Blender can read", path=path, found=last) from None
    finally:
        logging.disable(logging.NOTSET)
    if result != {"FINISHED"}:
        raise InputError(
            "a scene that Blender can read", path=path, found="a file that its importer rejects"
        )


def _light_up(scene: bpy.types.Scene) -> list[str]:
    """Add light to a scene that has none: a uniform white sky, and lamps inside rooms that the sky
    does not reach. Returns a note if light was added.
    """
    if _has_light(scene):
        return []
    world = bpy.data.worlds.new("Neutral light")
    if world.node_tree is None:
        world.use_nodes = True
    sky = world.node_tree.nodes["Background"].inputs
    sky["Color"].default_value, sky["Strength"].default_value = (1.0, 1.0, 1.0, 1.0), 1.0
    scene.world = world
    lamps = _light_inside(scene)
    inside = f", and {lamps} soft lamps inside, where the sky does not reach" if lamps else ""
    return [f"the scene has no light: a uniform white sky was added{inside}"]


def _has_light(scene: bpy.types.Scene) -> bool:
    lamps = [lamp.data for lamp in surfaces.rendered_lamps(scene)]
    instanced = (
        any(o.type == "EMPTY" and o.instance_collection for o in scene.objects) and bpy.data.lights
    )
    if any(lamp.energy > 0 for lamp in lamps) or instanced or _shines(scene.world):
        return True
    things = [o for o in scene.objects if o.type in surfaces.SURFACE_TYPES and not o.hide_render]
    glowing = [
        o
        for o in things
        if any(s.material and _emits(s.material.node_tree) for s in o.material_slots)
    ]
    return any(max(o.dimensions) > _SMALLEST_EMITTER_M for o in glowing)


def _shines(world: bpy.types.World | None) -> bool:
    if world is None:
        return False
    if world.node_tree is None or not world.use_nodes:
        return max(world.color) > 0
    nodes = world.node_tree.nodes
    sky = any(_is_on(n, "Color", "Strength") for n in nodes if n.type == "BACKGROUND")
    return sky or any(n.type in ("EMISSION", "GROUP") for n in nodes)


def _emits(tree: bpy.types.NodeTree | None) -> bool:
    return tree is not None and any(
        (n.type == "EMISSION" and _is_on(n, "Color", "Strength"))
        or (n.type == "BSDF_PRINCIPLED" and _is_on(n, "Emission Color", "Emission Strength"))
        for n in compat.nodes_of(tree)
    )


def _is_on(node: bpy.types.Node, *names: str) -> bool:
    colour, strength = (node.inputs[name] for name in names)
    bright = colour.is_linked or max(tuple(colour.default_value)[:3]) > 0
    return bright and (strength.is_linked or strength.default_value > 0)


def _light_inside(scene: bpy.types.Scene) -> int:
    """Add lamps at enclosed places in free space, far from one another. Returns their number."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    shown = [
        o for o in scene.objects if o.type == "MESH" and not o.hide_render and len(o.data.polygons)
    ]
    corners = np.array(
        [np.array(o.matrix_world) @ (*c, 1.0) for o in shown for c in o.bound_box] or [np.zeros(4)]
    )
    low, high = corners[:, :3].min(0), corners[:, :3].max(0)
    rng = np.random.default_rng(0)
    places = low + (high - low) * rng.uniform(0.05, 0.95, (_PLACES, 3))
    rays = rng.normal(size=(_RAYS, 3))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    seen = np.array([_look_round(depsgraph, place, rays) for place in places])
    free = (seen[:, 1] < 0.1) & (seen[:, 2] > 2 * _RADIUS_M)
    shut_in = free & (seen[:, 0] < _SHUT_IN)
    if shut_in.sum() < 0.5 * max(free.sum(), 1):
        return 0
    chosen = farthest_points(places[shut_in], _LAMPS, first=int(places[shut_in][:, 2].argmax()))
    size = high - low
    watts = _W_PER_M2 * 2 * float(size[0] * size[1] + size[1] * size[2] + size[2] * size[0])
    for place in chosen:
        data = bpy.data.lights.new("Neutral light", "POINT")
        data.energy, data.shadow_soft_size = watts / len(chosen), _RADIUS_M
        lamp = bpy.data.objects.new("Neutral light", data)
        lamp.location, lamp.visible_camera = (
            place,
            False,
        )  # visible in reflections, because metal shows nothing else
        scene.collection.objects.link(lamp)
    return len(chosen)


def _look_round(
    depsgraph: bpy.types.Depsgraph, place: np.ndarray, rays: np.ndarray
) -> tuple[float, float, float]:
    """The share of rays that reach the sky, the share that end at a back face, and the distance of
    the nearest surface in metres.
    """
    sky = backs = 0
    nearest = np.inf
    origin = Vector(place)
    for ray in rays:
        hit, location, normal, *_ = depsgraph.scene.ray_cast(depsgraph, origin, Vector(ray))
        sky += not hit
        if hit:
            backs += normal.dot(Vector(ray)) > 0
            nearest = min(nearest, (location - origin).length)
    return sky / len(rays), backs / len(rays), nearest
