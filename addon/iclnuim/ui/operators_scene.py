"""Operators of scene and trajectory: show the scene, keyframe the camera, read the trajectory again, save it as a file."""

from pathlib import Path

import bpy

from .. import shipped
from ..blender import camera as keyed_camera
from ..blender import orient, sanitize, scene_paths, user_scene
from ..errors import InputError
from ..formats.trajectories import write_trajectory
from ..geometry.scene_axes import SceneReading
from . import inputs, state, trajectory_view
from .state import reported


class ICLNUIM_OT_load_scene(bpy.types.Operator):
    """Bring the chosen scene into this window, in a collection of its own; replaces the scene brought before"""

    bl_idname, bl_label, bl_options = "iclnuim.load_scene", "Show the Scene Here", {"REGISTER", "UNDO"}

    @reported
    def execute(self, context):
        settings = context.scene.iclnuim
        if settings.scene_source == "OPEN":
            raise InputError("a built-in scene or a file to show", found="the open file, which is here already")
        file, reading = _scene_file(settings), settings.reading()
        scene_paths.refuse_outside(file, reading.textures)
        collection = _fresh_collection(context.scene)
        if file.suffix.lower() == ".blend":
            _append(context.scene, file, collection)
            if settings.scene_source == "FILE":
                orient.orient(file, reading, list(collection.all_objects))
        else:
            _import(context, file, reading, collection)
        collection[trajectory_view.SHOWN] = inputs.scene_name(settings)
        _hide_the_default_cube(context.scene)
        for view in _views(context):
            view.overlay.show_extras = False  # spot lamps draw wide circles; the panel has the switch that shows them
        trajectory_view.refresh(context)


class ICLNUIM_OT_keyframe(bpy.types.Operator):
    """Keyframe a camera along the trajectory: the timeline plays the poses exactly, pose i at frame i"""

    bl_idname, bl_label, bl_options = "iclnuim.keyframe", "Keyframe", {"REGISTER", "UNDO"}

    @reported
    def execute(self, context):
        scene = context.scene
        chosen, _ = inputs.trajectory(context)
        lens = scene.iclnuim.camera()
        _remove_own_camera(scene, keep=scene.iclnuim.trajectory_source == "CAMERA")
        keyed_camera.keyframe(chosen.T_world_camera, lens)
        rate_hz = (len(chosen) - 1) / (chosen.stamps_s[-1] - chosen.stamps_s[0]) if len(chosen) > 1 else 30.0
        scene.render.fps, scene.render.fps_base = max(round(rate_hz), 1), max(round(rate_hz), 1) / rate_hz
        scene.frame_set(0)
        for view in _views(context):
            view.region_3d.view_perspective = "CAMERA"
        trajectory_view.refresh(context)


class ICLNUIM_OT_refresh(bpy.types.Operator):
    """Read the trajectory again and check whether it passes through a surface of the open scene"""

    bl_idname, bl_label = "iclnuim.refresh", "Read Again"

    @reported
    def execute(self, context):
        trajectory_view.refresh(context)


class ICLNUIM_OT_save_path(bpy.types.Operator):
    """Save the trajectory chosen above as a TUM file: seconds, metres, camera to world, x right, y down, z forward"""

    bl_idname, bl_label = "iclnuim.save_path", "Save as TUM"

    filepath: bpy.props.StringProperty(subtype="FILE_PATH", description="File to write, ending in .txt")
    check_existing: bpy.props.BoolProperty(default=True, options={"HIDDEN"})
    filter_glob: bpy.props.StringProperty(default="*.txt", options={"HIDDEN"})

    def invoke(self, context, event):
        source = context.scene.iclnuim.trajectory_source
        name = {"CAMERA": "camera", "FILE": "trajectory"}.get(source, source)
        self.filepath = str(Path(bpy.data.filepath).with_name(f"{name}.txt")) if bpy.data.filepath else f"{name}.txt"
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    @reported
    def execute(self, context):
        if not self.filepath:
            raise InputError("a file to write", found="none")
        file = Path(bpy.path.abspath(self.filepath)).expanduser().resolve()
        poses, sentence = inputs.trajectory(context)
        write_trajectory(file.with_suffix(file.suffix or ".txt"), poses, "tum")
        state.current().work.message = f"{len(poses)} poses of {sentence} are in {file.name}"


def _scene_file(settings: bpy.types.PropertyGroup) -> Path:
    if settings.scene_source == "FILE":
        if not settings.scene_file:
            raise InputError("a scene file", found="none", hint="choosing one under {scene}")
        return user_scene.checked_file(inputs.scene_name(settings))
    file = shipped.folder("blend") / f"{settings.scene_source}.blend"
    if not file.is_file():
        raise InputError("the built-in scene", path=file, found="no such file", hint="installing the extension again")
    return file


def _fresh_collection(scene: bpy.types.Scene) -> bpy.types.Collection:
    old = bpy.data.collections.get(trajectory_view.COLLECTION)
    if old is not None:
        for thing in list(old.all_objects):
            bpy.data.objects.remove(thing)
        bpy.data.collections.remove(old)
    collection = bpy.data.collections.new(trajectory_view.COLLECTION)
    scene.collection.children.link(collection)
    return collection


def _append(scene: bpy.types.Scene, file: Path, collection: bpy.types.Collection) -> None:
    with bpy.data.libraries.load(str(file), link=False) as (there, here):
        here.objects, here.worlds = list(there.objects), list(there.worlds)[:1]
    sanitize.remove_python_drivers(here.objects)
    for thing in here.objects:
        if thing is not None:
            collection.objects.link(thing)
    if here.worlds:
        scene.world = here.worlds[0]


def _import(context: bpy.types.Context, file: Path, reading: SceneReading, collection: bpy.types.Collection) -> None:
    """Through a scene of its own: axes and units are guessed from everything in the scene."""
    before, own = context.window.scene, bpy.data.scenes.new("ICL-NUIM import")
    context.window.scene = own
    try:
        user_scene.load(file)
        placed = orient.orient(file, reading, list(own.objects))
        for thing in list(own.collection.all_objects):
            collection.objects.link(thing)
    finally:
        context.window.scene = before
        bpy.data.scenes.remove(own)
    state.current().work.message = placed.sentence


def _hide_the_default_cube(scene: bpy.types.Scene) -> None:
    """The start-up file's cube and light would stand in the room; they are hidden, not removed."""
    for name in ("Cube", "Light"):
        thing = scene.collection.all_objects.get(name)
        if thing is not None and thing.name not in bpy.data.collections[trajectory_view.COLLECTION].all_objects:
            thing.hide_viewport = thing.hide_render = True


def _views(context: bpy.types.Context) -> list[bpy.types.SpaceView3D]:
    areas = (area for window in context.window_manager.windows for area in window.screen.areas)
    return [area.spaces.active for area in areas if area.type == "VIEW_3D"]


def _remove_own_camera(scene: bpy.types.Scene, keep: bool) -> None:
    """The camera keyframed before, unless it is itself the source of the trajectory."""
    old = bpy.data.objects.get(keyed_camera.NAME)
    if old is None or keep:
        return
    lens, action = old.data, old.animation_data and old.animation_data.action
    bpy.data.objects.remove(old)
    if lens is not None and not lens.users:
        bpy.data.cameras.remove(lens)
    if action is not None and not action.users:
        bpy.data.actions.remove(action)


register, unregister = bpy.utils.register_classes_factory(
    (ICLNUIM_OT_load_scene, ICLNUIM_OT_keyframe, ICLNUIM_OT_refresh, ICLNUIM_OT_save_path)
)
