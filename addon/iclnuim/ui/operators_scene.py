"""Operators of scene and trajectory: bring the room into the window, key the camera, read the path again."""

from pathlib import Path

import bpy

from .. import shipped
from ..blender import camera as keyed_camera
from ..blender import import_files, placing, scene_paths, sleeping
from ..errors import InputError
from . import inputs, path, session
from .messages import in_words
from .work import in_panel_words


class ICLNUIM_OT_load_scene(bpy.types.Operator):
    """Bring the chosen scene into this window, in a collection of its own; the room brought before is replaced"""

    bl_idname, bl_label, bl_options = "iclnuim.load_scene", "Show the Scene Here", {"REGISTER", "UNDO"}

    @in_words
    def execute(self, context):
        settings = context.scene.iclnuim
        if settings.scene_source == "OPEN":
            raise InputError("a shipped scene or a file to show", found="the open file, which is here already")
        file, reading = _scene_file(settings), settings.reading()
        scene_paths.refuse_outside(file, reading.textures)
        collection = _fresh_collection(context.scene)
        if file.suffix.lower() == ".blend":
            _append(context.scene, file, collection)
            if settings.scene_source == "FILE":
                placing.place(file, reading, list(collection.all_objects))
        else:
            _import(context, file, reading, collection)
        collection[path.SHOWN] = inputs.scene_name(settings)
        _hide_the_default_cube(context.scene)
        _hide_symbols(context)
        path.refresh(context)


class ICLNUIM_OT_keyframe(bpy.types.Operator):
    """Key a camera along the path: it plays in the timeline exactly as the poses say, pose i at frame i"""

    bl_idname, bl_label, bl_options = "iclnuim.keyframe", "Keyframe", {"REGISTER", "UNDO"}

    @in_words
    def execute(self, context):
        scene = context.scene
        chosen, _ = inputs.trajectory(context)
        lens = scene.iclnuim.camera()
        _remove_own_camera(scene, keep=scene.iclnuim.trajectory_source == "CAMERA")
        keyed_camera.keyframe(chosen.T_world_camera, lens)
        rate_hz = (len(chosen) - 1) / (chosen.stamps_s[-1] - chosen.stamps_s[0]) if len(chosen) > 1 else 30.0
        scene.render.fps, scene.render.fps_base = max(round(rate_hz), 1), max(round(rate_hz), 1) / rate_hz
        scene.frame_set(0)
        _look_through_camera(context)
        path.refresh(context)


class ICLNUIM_OT_refresh(bpy.types.Operator):
    """Read the path again and look whether it passes through a wall of the open scene"""

    bl_idname, bl_label = "iclnuim.refresh", "Read Again"

    @in_words
    def execute(self, context):
        path.refresh(context)


def _scene_file(settings) -> Path:
    if settings.scene_source == "FILE":
        if not settings.scene_file:
            raise InputError("a scene file", found="none", hint="choosing one under Scene")
        return import_files.checked_file(inputs.scene_name(settings))
    file = shipped.folder("blend") / f"{settings.scene_source}.blend"
    if not file.is_file():
        raise InputError(
            "the shipped scene", path=file, found="nothing of that name", hint="installing the extension again"
        )
    return file


def _fresh_collection(scene) -> bpy.types.Collection:
    old = bpy.data.collections.get(path.COLLECTION)
    if old is not None:
        for thing in list(old.all_objects):
            bpy.data.objects.remove(thing)
        bpy.data.collections.remove(old)
    collection = bpy.data.collections.new(path.COLLECTION)
    scene.collection.children.link(collection)
    return collection


def _append(scene, file: Path, collection) -> None:
    with bpy.data.libraries.load(str(file), link=False) as (there, here):
        here.objects, here.worlds = list(there.objects), list(there.worlds)[:1]
    sleeping.silence(here.objects)
    for thing in here.objects:
        if thing is not None:
            collection.objects.link(thing)
    if here.worlds:
        scene.world = here.worlds[0]


def _import(context, file: Path, reading, collection) -> None:
    """By way of a scene of its own: how the file is read is guessed from all that is there."""
    before, own = context.window.scene, bpy.data.scenes.new("ICL-NUIM import")
    context.window.scene = own
    try:
        import_files.load(file)
        placed = placing.place(file, reading, list(own.objects))
        for thing in list(own.collection.all_objects):
            collection.objects.link(thing)
    finally:
        context.window.scene = before
        bpy.data.scenes.remove(own)
    session.current.work.message = in_panel_words(placed.sentence)


def _hide_the_default_cube(scene) -> None:
    """The start-up file's cube, light and camera would stand in the room; they are hidden, not removed."""
    for name in ("Cube", "Light"):
        thing = scene.collection.all_objects.get(name)
        if thing is not None and thing.name not in bpy.data.collections[path.COLLECTION].all_objects:
            thing.hide_viewport = thing.hide_render = True


def _hide_symbols(context) -> None:
    """Spot lamps draw circles as wide as the garden; the panel has the switch that brings them back."""
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.spaces.active.overlay.show_extras = False


def _remove_own_camera(scene, keep: bool) -> None:
    """The camera keyed before, unless it is itself the source of the path."""
    old = bpy.data.objects.get(keyed_camera.NAME)
    if old is None or keep:
        return
    lens, action = old.data, old.animation_data and old.animation_data.action
    bpy.data.objects.remove(old)
    if lens is not None and not lens.users:
        bpy.data.cameras.remove(lens)
    if action is not None and not action.users:
        bpy.data.actions.remove(action)


def _look_through_camera(context) -> None:
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.spaces.active.region_3d.view_perspective = "CAMERA"


register, unregister = bpy.utils.register_classes_factory(
    (ICLNUIM_OT_load_scene, ICLNUIM_OT_keyframe, ICLNUIM_OT_refresh)
)
