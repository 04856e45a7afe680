"""Opening a scene: a shipped scene, or a user-provided file of any supported format, which is
converted to metres and z up, repaired and lit.

The file itself is never written.
"""

import hashlib
import math
import tempfile
from pathlib import Path

import bpy
from bpy.types import Scene, ViewLayer

from ... import shipped
from ...errors import InputError
from ...geometry.scene_axes import SceneReading
from ...native_output import native_output_in
from .. import compat, surfaces
from ..notes import names_of
from . import (
    coplanar,
    displacement,
    fluids,
    glass,
    left_out,
    missing_images,
    neutral_light,
    orient,
    plain_names,
    sanitize,
    saved_by,
    scene_paths,
    simulations,
)
from .importers import checked_file, load, open_blend
from .light_choice import MAX_BAKED
from .run_frames import RunFrames


def open_empty() -> None:
    """Open an empty scene with factory settings, without the user's start-up file.

    Scripts in .blend files do not run.
    """
    compat.require_supported_version()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.preferences.filepaths.use_scripts_auto_execute = False


def open_scene(
    name: str, reading: SceneReading | None = None, run: RunFrames | None = None
) -> list[str]:
    """Open a shipped scene or a file, for the frames of a run if there is one; then at frame 0.

    Returns notes for the user. Raises InputError if it cannot be opened.
    """
    open_empty()
    if shipped.is_scene(name):
        open_blend(shipped.scene_file(name))
        return []
    return open_file(checked_file(name), reading or SceneReading(), run)


def scene_sha256(name: str) -> str:
    """The hash of a version of a scene: of its file and of the files it refers to.

    Textures that only Blender can find are included only if the scene is open: open it first.
    """
    if not shipped.is_scene(name):
        return scene_paths.sha256(checked_file(name))
    return hashlib.sha256(shipped.scene_file(name).read_bytes()).hexdigest()


def open_file(path: Path, reading: SceneReading, run: RunFrames | None = None) -> list[str]:
    """Open a file in the empty session, for the frames of a run if there is one.

    Returns notes for the user; the first describes how it was read. Raises InputError if it cannot
    be used.
    """
    notes = scene_paths.check(path, reading)
    if path.suffix.lower() == ".blend":
        notes += saved_by.check(path)
        fluids.refuse_fluids(path)
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "blender.log"
        with native_output_in(log):
            load(path, log)
        scene_paths.check_open(path, reading, log.read_text("utf-8", "replace"))
    saved_by.check_libraries(path)
    if bpy.data.libraries:  # local copies of linked datablocks can be changed in memory
        bpy.ops.object.make_local(type="ALL")
    notes += plain_names.rename()
    notes += left_out.completed(path)
    if run is not None:
        copy, words = simulations.baked(path, run)
        notes += words
        if copy is not None:
            open_blend(copy)
    scene = bpy.context.scene
    _neutral_settings(path, scene)
    if run is not None:
        scene.frame_start = 0
        scene.frame_end = run.poses - 1
        scene.frame_set(0)
    _with_background_sets(scene)
    notes += _with_rendered_layer(scene)
    _leave_edit_mode(scene.view_layers[0])
    _refuse_without_surfaces(path, scene, found=[*notes, "none"][0])
    notes += _without_grease_pencil()
    words, lost_sky = missing_images.replace_missing(scene)
    notes += words
    notes += sanitize.sanitize(scene)
    if path.suffix.lower() == ".obj":
        notes += glass.without_false_glass(path)
    sentence, unusual = orient.orient(path, reading, list(scene.objects))
    if unusual:
        notes.insert(0, sentence)
    bpy.context.view_layer.update()
    notes += displacement.displace_meshes(scene)
    triangles = surfaces.triangle_count()
    if not triangles and not len(surfaces.triangles().triangles):
        bare = "points and edges without a face"
        raise InputError("a scene with at least one surface", path=path, found=bare)
    if triangles <= MAX_BAKED:
        notes += coplanar.remove_coincident_faces(scene)
    panes = (m for m in bpy.data.materials if m.use_nodes and m.node_tree)
    if names := glass.let_light_through(panes):
        passes = "light of lamps and sky passes straight through it, without caustics"
        notes.append(f"glass ({names_of(names)}): {passes}")
    notes += neutral_light.light_up(scene, lost_sky)
    if run is not None:
        simulations.play_hair(scene, run.last)
    return notes


def _refuse_without_surfaces(path: Path, scene: Scene, found: str) -> None:
    if any(o.type in surfaces.SURFACE_TYPES or o.instance_collection for o in scene.objects):
        return
    others = set(bpy.data.scenes) - {scene}
    hint = f"saving it with another scene active ({names_of(others)})" if others else None
    raise InputError("a scene with at least one surface", path=path, found=found, hint=hint)


def _neutral_settings(path: Path, scene: Scene) -> None:
    """Reset settings of the scene in the file at `path` that would change or hide surfaces, and set
    those that its importer does not set.
    """
    scene.cycles.shading_system = False  # shaders in OSL are scripts, which may read files
    scene.render.use_simplify = False
    cameras = [o for o in scene.objects if o.type == "CAMERA"]
    if scene.camera is None and len(cameras) == 1:
        # formats without an active camera: the only camera becomes active
        scene.camera = cameras[0]
    if path.suffix.lower() == ".blend":
        return
    # the setting after an import is Blender's default, not the file's
    scene.view_settings.view_transform = "Standard"
    ranges = [tuple(action.frame_range) for action in bpy.data.actions]
    if ranges:  # importers do not set the timeline: it gets the range of all animations
        firsts, lasts = zip(*ranges, strict=True)
        scene.frame_start = max(0, math.floor(min(firsts)))
        scene.frame_end = max(scene.frame_start, math.ceil(max(lasts)))


def _with_background_sets(scene: Scene) -> None:
    """Link the objects of the background sets, which are rendered from other scenes."""
    behind = scene.background_set
    scene.background_set = None
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
    hidden = []
    for thing in bpy.data.objects:
        if thing.type in ("GREASEPENCIL", "GPENCIL") and not thing.hide_render:
            thing.hide_render = True
            hidden.append(thing)
    if not hidden:
        return []
    reason = "it is drawn over the image and has no depth"
    return [f"Grease Pencil ({names_of(hidden)}): left out, because {reason}"]


def _with_rendered_layer(scene: Scene) -> list[str]:
    """Make the first view layer that is used for rendering the only one. Returns a note on others.

    Holdouts and indirect-only settings of its collections are moved to objects.
    """
    layers = list(scene.view_layers)
    used = [layer for layer in layers if layer.use] or layers
    layer = used[0]
    if bpy.context.window is not None:
        bpy.context.window.view_layer = layer
    note = f"view layers ({names_of(used[1:])}): left out, {layer.name} is rendered"
    for other in layers:
        if other != layer:
            scene.view_layers.remove(other)
    layer.use = True
    for thing in layer.objects:
        if thing.indirect_only_get(view_layer=layer):
            thing.visible_camera = False
        if thing.holdout_get(view_layer=layer):
            thing.is_holdout = True
    for collection in surfaces.layers_below(layer.layer_collection):
        collection.indirect_only = False
        collection.holdout = False
    if getattr(layer, "world_override", None):  # from Blender 4.4 on
        scene.world = layer.world_override
        layer.world_override = None
    return [note] if len(used) > 1 else []


def _leave_edit_mode(layer: ViewLayer) -> None:
    """A mesh that was edited when its file was saved has no UV maps until it is left."""
    for thing in layer.objects:
        if thing.mode == "EDIT":
            layer.objects.active = thing
            bpy.ops.object.mode_set(mode="OBJECT")
