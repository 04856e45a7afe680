"""Opening a scene: a shipped one, or a user-provided file of any kind, made fit to be rendered: in metres, z up, repaired, lit.

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

from .. import shipped
from ..errors import InputError
from ..formats.ply import check_ply
from ..geometry.points import farthest_points
from ..geometry.scene_axes import SceneReading
from ..job import RenderJob
from ..shipped import SCENES
from . import compat, lit_scene, orient, preflight, sanitize, scene_paths, surfaces

#: The file's own axes are kept: turning and scaling is left to orient.py.
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
#: A light map has about as many texels; more triangles than that gain nothing from it, and laying them out takes minutes.
MAX_BAKED = 2_000_000
#: For light inside: places tried, and sight lines from each.
_PLACES, _RAYS = 400, 48
#: Less of a place's sight lines than this reach the sky: then it needs lamps.
_SHUT_IN = 0.03
_LAMPS, _RADIUS_M = 4, 0.15
#: Watts for a square metre of the room's walls: mid-grey surfaces come out at about a third of white.
_W_PER_M2 = 1.0
#: What glows and is smaller than this is a status lamp, not the light of a room.
_SMALLEST_EMITTER_M = 0.03


def open_empty() -> None:
    """An empty scene with factory settings, whatever the user's start-up file holds. Scripts in .blend files do not run."""
    compat.require_supported_version()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.preferences.filepaths.use_scripts_auto_execute = False


def open_scene(name: str, reading: SceneReading | None = None) -> list[str]:
    """Open `name`; returns notes worth telling. Raises InputError for what cannot be opened."""
    open_empty()
    if is_shipped(name):
        bpy.ops.wm.open_mainfile(filepath=str(shipped_file(name)), load_ui=False, use_scripts=False)
        return []
    return open_file(checked_file(name), reading or SceneReading())


def is_shipped(name: str) -> bool:
    return name in SCENES


def scene_sha256(name: str) -> str:
    """What tells one version of a scene from another: the hash of its file, and of what it takes from beside it.

    Textures of a file that only Blender can read count once it is open: open it first.
    """
    if not is_shipped(name):
        return scene_paths.sha256(checked_file(name))
    return hashlib.sha256(shipped_file(name).read_bytes()).hexdigest()


def shipped_file(name: str) -> Path:
    """The built .blend of a shipped scene. Raises InputError where it is not there."""
    path = shipped.folder("blend") / f"{name}.blend"
    if not path.is_file():
        raise InputError("the shipped scene", path=path, found="no such file", hint="installing iclnuim again")
    return path


def open_file(path: Path, reading: SceneReading) -> list[str]:
    """Into the empty session; returns notes worth telling, first how it was taken. Raises InputError for what cannot be used."""
    missing = scene_paths.check(path, reading)
    load(path)
    scene_paths.check_open(path, reading)
    if bpy.data.libraries:  # what comes from a library may be changed in memory, as all else
        bpy.ops.object.make_local(type="ALL")
    scene = bpy.context.scene
    _neutral_settings(path, scene)
    _with_background_sets(scene)
    _look_at_rendered_layer(scene)
    notes = [*missing, *_without_grease_pencil(), *sanitize.sanitize(scene)]
    if path.suffix.lower() == ".obj":
        notes += sanitize.without_false_glass(path)
    if not any(o.type in surfaces.SURFACE_TYPES or o.instance_collection for o in scene.objects):
        raise InputError("a scene with at least one surface", path=path, found=missing[0] if missing else "none")
    sentence, worth_telling = orient.orient(path, reading, list(scene.objects))
    notes = [*([sentence] if worth_telling else []), *notes]
    bpy.context.view_layer.update()
    notes += sanitize.displace_meshes(scene)
    triangles = surfaces.triangle_count()
    if not triangles and not len(surfaces.triangles().triangles):
        raise InputError("a scene with at least one surface", path=path, found="points and edges without a face")
    if triangles <= MAX_BAKED:
        notes += sanitize.remove_coincident_faces(scene)
    return [*notes, *_light_passes_glass(), *_light_up(scene)]


def _neutral_settings(path: Path, scene: bpy.types.Scene) -> None:
    """Of the scene in the file at `path`: what would change or hide surfaces, and what its reader left as it was."""
    scene.cycles.shading_system = False  # shaders in OSL are scripts, which may read files
    scene.render.use_simplify = False
    cameras = [o for o in scene.objects if o.type == "CAMERA"]
    if scene.camera is None and len(cameras) == 1:
        scene.camera = cameras[0]  # formats without an active camera: their only one is
    if path.suffix.lower() == ".blend":
        return
    scene.view_settings.view_transform = "Standard"  # Blender's default for new files, not the file's wish
    ranges = [tuple(action.frame_range) for action in bpy.data.actions]
    if ranges:  # readers leave the timeline as it was: as long as what moves
        scene.frame_start = max(0, math.floor(min(first for first, _ in ranges)))
        scene.frame_end = max(scene.frame_start, math.ceil(max(last for _, last in ranges)))


def _with_background_sets(scene: bpy.types.Scene) -> None:
    """What renders from other scenes, as the background set of this one, becomes its own."""
    behind, scene.background_set = scene.background_set, None
    while behind is not None:
        for name in ("objects", "children"):
            own = getattr(scene.collection, name)
            for thing in getattr(behind.collection, name):
                if thing.name not in own:
                    own.link(thing)
        behind = behind.background_set


def _without_grease_pencil() -> list[str]:
    """Blender draws it over the picture by another engine, which rounds the depth of all pixels."""
    drawings = [o for o in bpy.data.objects if o.type in ("GREASEPENCIL", "GPENCIL") and not o.hide_render]
    for thing in drawings:
        thing.hide_render = True
    names = ", ".join(sorted(o.name for o in drawings))[:120]
    return [f"Grease Pencil ({names}): left out, it is drawn over the picture and has no depth"] if drawings else []


def _look_at_rendered_layer(scene: bpy.types.Scene) -> None:
    """The first view layer is rendered: it is the one looked at, too; what its collections hold out or hide from cameras, objects do."""
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
    glass = lit_scene.let_light_through(m for m in bpy.data.materials if m.use_nodes and m.node_tree)
    if not glass:
        return []
    return [f"glass ({', '.join(sorted(glass))[:120]}): lamps and sky shine through it unbent, without caustics"]


def lit_as_it_can_be(job: RenderJob) -> tuple[RenderJob, list[str]]:
    """The job with the light that the open scene allows, and a word where that is not the light asked for."""
    if job.light == "path" or (hindrance := why_not_baked(bpy.context.scene)) is None:
        return job, []
    return with_light(job, "path"), [f"{hindrance}: path traced instead of baked light"]


def with_light(job: RenderJob, light: str) -> RenderJob:
    """The job settled on a light; samples that were given with light "auto" stay. Denoising only where this Blender can."""
    job = replace(job, light=light) if job.light == "auto" else job.changed(light=light)
    return job if compat.has_denoiser() else job.changed(denoise=False)


def why_not_baked(scene: bpy.types.Scene) -> str | None:
    """What stands against a light map, or None."""
    hindrances = {
        "objects or lights that move": preflight.moving_names(scene),
        "hair, curves or points": preflight.strand_names(scene),
        "volumes": preflight.volume_names(scene) or preflight.made_volume_names(scene),
        "light linking": preflight.light_linking_names(scene),
        "toon or sheen shaders, over 6 UV maps, or materials that differ by instance": preflight.unmappable_names(
            scene
        ),
    }
    for what, names in hindrances.items():
        if names:
            return f"{what} ({', '.join(names)[:120]})"
    kinds = map(lit_scene.kind, _shown_materials(scene))
    if not any(diffuse or translucent for diffuse, translucent, _ in kinds):
        return "no diffuse surface"
    count = surfaces.triangle_count()
    return f"{count} triangles, more than the texels of a light map" if count > MAX_BAKED else None


def _shown_materials(scene: bpy.types.Scene) -> set[bpy.types.Material | None]:
    """Of all surfaces, instanced collections included; None for a surface without a material."""
    things = {*scene.objects, *(o for c in bpy.data.collections for o in c.all_objects)}
    shown = [thing for thing in things if thing.type in surfaces.SURFACE_TYPES]
    bare = {None for thing in shown if not thing.material_slots}
    return bare | {slot.material for thing in shown for slot in thing.material_slots}


def checked_file(name: str) -> Path:
    """The full path of a user-provided file. Raises InputError for what is not there or of no known kind."""
    path = Path(name).expanduser().resolve()
    if path.suffix.lower() not in KINDS:
        raise InputError(f"a scene: {', '.join(SCENES)} or a scene file ending in {', '.join(KINDS)}", found=name)
    if not path.is_file():
        raise InputError("a scene file", path=path, found="a folder" if path.is_dir() else "no such file")
    if not path.stat().st_size:
        raise InputError("a scene file", path=path, found="an empty file")
    return path


def load(path: Path) -> None:
    """Bring the file into the open session; a .blend takes the session's place, and its scripts stay asleep. Raises InputError."""
    if path.suffix.lower() == ".ply":
        check_ply(path)
    logging.disable(
        logging.ERROR
    )  # readers written in Python tell every node of the file, and every texture that is missing
    try:
        with redirect_stdout(io.StringIO()):  # where bpy.ops prints the errors of readers a second time
            if path.suffix.lower() == ".blend":
                result = bpy.ops.wm.open_mainfile(filepath=str(path), load_ui=False, use_scripts=False)
            else:
                result = IMPORTERS[path.suffix.lower()](str(path))
    except AttributeError:
        without = f"{compat.version_line()} without its reader"
        raise InputError("a Blender that reads this kind of file", path=path, found=without) from None
    except (RuntimeError, TypeError, UnicodeDecodeError) as error:
        # what the reader said last; a Python reader's whole traceback comes with it
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        told = [line for line in lines if not line.startswith(("Location:", "File "))]
        last = (told or lines or ["no reason given"])[-1].removeprefix("Error: ")
        raise InputError("a scene that Blender can read", path=path, found=last) from None
    finally:
        logging.disable(logging.NOTSET)
    if result != {"FINISHED"}:
        raise InputError("a scene that Blender can read", path=path, found="a file that its reader gives up on")


def _light_up(scene: bpy.types.Scene) -> list[str]:
    """Light for a scene that has none: an even white sky, and lamps inside where the sky does not reach; then a sentence that says so."""
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
    return [f"the scene has no light: an even white sky was added{inside}"]


def _has_light(scene: bpy.types.Scene) -> bool:
    lamps = [lamp.data for lamp in surfaces.rendered_lamps(scene)]
    instanced = any(o.type == "EMPTY" and o.instance_collection for o in scene.objects) and bpy.data.lights
    if any(lamp.energy > 0 for lamp in lamps) or instanced or _shines(scene.world):
        return True
    things = [o for o in scene.objects if o.type in surfaces.SURFACE_TYPES and not o.hide_render]
    glowing = [o for o in things if any(s.material and _emits(s.material.node_tree) for s in o.material_slots)]
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
    """Lamps at free places that are shut in, far from one another; how many."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    shown = [o for o in scene.objects if o.type == "MESH" and not o.hide_render and len(o.data.polygons)]
    corners = np.array([np.array(o.matrix_world) @ (*c, 1.0) for o in shown for c in o.bound_box] or [np.zeros(4)])
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
        lamp.location, lamp.visible_camera = place, False  # seen in gloss: metal shows nothing else
        scene.collection.objects.link(lamp)
    return len(chosen)


def _look_round(depsgraph: bpy.types.Depsgraph, place: np.ndarray, rays: np.ndarray) -> tuple[float, float, float]:
    """Shares of sight lines that reach the sky and that end at a back, and the nearest surface in metres."""
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
