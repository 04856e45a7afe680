"""Operators of the trajectory: a path that is made through the open scene, keyframes, a file."""

from pathlib import Path

import bpy
from bpy.props import BoolProperty, IntProperty, StringProperty
from bpy.types import Context, Event, Operator

from ..blender import surfaces
from ..blender.render import camera as keyed_camera
from ..errors import InputError
from ..geometry.camera import PinholeCamera
from ..geometry.handheld_plan import HandheldPlan, PlanSettings, Waypoint, plan, rounded
from ..geometry.trajectory import Trajectory, frame_rate_hz, trajectory_statistics
from ..raycast.scene_route import planned_in_rooms, space_around
from ..trajectory_files.trajectories import write_trajectory
from . import inputs, properties, state, trajectory_view
from .state import operator
from .surface_tree import SurfaceTree


def _this_scene(context: Context) -> None:
    """Raises InputError if the chosen scene is not the one in this window."""
    if not trajectory_view.is_chosen_scene_open(context):
        expected = "the chosen scene in this window"
        hint = "This File as {scene}, or Show the Scene"
        raise InputError(expected, found="another one", hint=hint)
    if context.mode != "OBJECT":
        raise InputError("Object Mode", found=state.sentence(context.mode.lower()))


@operator(
    "Make a Path through This Scene",
    state.idle,
    _this_scene,
    undo=True,
    invoke=lambda self, context, event: context.window_manager.invoke_props_dialog(self),
    count=IntProperty(
        name="Viewpoints", description="Number of viewpoints to choose", default=6, min=2, max=100
    ),
    **properties.properties_of(PlanSettings),
)
def make_path(self: Operator, context: Context) -> None:
    """Make a hand-held trajectory through the scene in this window, clear of its surfaces, and
    keyframe a camera along it that has the lens of the active camera.

    It leads through the selected empties in the order of their names, or else through viewpoints
    that are chosen above the floor
    """
    settings = context.scene.iclnuim
    own = context.scene.camera and keyed_camera.pinhole(context.scene, context.scene.camera)
    lens = own or settings.camera()
    made = _planned(context, self.count, PlanSettings(**properties.values_in(self, PlanSettings)))
    _keyframed(context, made.motion.trajectory, lens)
    settings.trajectory_source = "CAMERA"
    figures = trajectory_statistics(made.motion.trajectory)
    state.current().work.message = (
        f"a path of {figures.length_m:.1f} m and {figures.duration_s:.0f} s is the active camera's "
        f"animation now: {figures.frames} poses, at least {made.clearance_m:.2f} m from every "
        "surface"
    )


def _planned(context: Context, count: int, settings: PlanSettings) -> HandheldPlan:
    """A path through the selected empties, or `count` viewpoints."""
    found = surfaces.triangles()
    if not len(found.triangles):
        raise InputError("a scene with surfaces", found="none", hint="This File as {scene}")
    shape = found.vertices, found.triangles
    tree = SurfaceTree(*shape)
    empties = [thing for thing in context.selected_objects if thing.type == "EMPTY"]
    name = Path(bpy.data.filepath).stem
    if len(empties) < 2:
        made, notes = planned_in_rooms(*shape, count, name, settings, tree, tree.distance)
        state.current().work.notes += [note for note in notes if note.startswith("note")]
        return made
    places = [e.matrix_world.translation for e in sorted(empties, key=lambda e: e.name)]
    waypoints = [Waypoint(rounded(place)) for place in places]
    return plan(waypoints, space_around(waypoints, *shape, tree.distance), name, settings)


@operator("Keyframe", inputs.check_trajectory, undo=True)
def keyframe(self: Operator, context: Context) -> None:
    """Keyframe a camera along the trajectory. Frame i of the timeline has exactly pose i"""
    chosen = inputs.trajectory(context).trajectory
    keep = context.scene.iclnuim.trajectory_source == "CAMERA"
    _keyframed(context, chosen, context.scene.iclnuim.camera(), keep)
    trajectory_view.refresh(context)
    changed = "the active camera, timeline, frame rate and image size are now the trajectory's"
    state.current().work.message = f"{len(chosen)} poses are keyframed; {changed}"


def _keyframed(
    context: Context, poses: Trajectory, lens: PinholeCamera, keep: bool = False
) -> None:
    """Keyframe a camera and look through it. keep: leave the one that was keyframed before."""
    scene = context.scene
    old = bpy.data.objects.get(keyed_camera.NAME)
    if not keep and old is not None:
        parts = old.data, old.animation_data and old.animation_data.action
        bpy.data.objects.remove(old)
        bpy.data.batch_remove([part for part in parts if part is not None and not part.users])
    keyed_camera.keyframe(poses.T_world_camera, lens)
    rate_hz = frame_rate_hz(poses.stamps_s)
    scene.render.fps = max(round(rate_hz), 1)
    scene.render.fps_base = max(round(rate_hz), 1) / rate_hz
    scene.frame_set(0)
    for area in state.areas("VIEW_3D"):
        area.spaces.active.region_3d.view_perspective = "CAMERA"


@operator("Read Again")
def refresh(self: Operator, context: Context) -> None:
    """Read the trajectory again and check whether it passes through a surface of the open scene"""
    trajectory_view.refresh(context)


def _ask_for_a_file(self: Operator, context: Context, event: Event) -> set[str]:
    source = context.scene.iclnuim.trajectory_source
    name = {"CAMERA": "camera", "FILE": "trajectory"}.get(source, source)
    self.filepath = str(Path(bpy.data.filepath).parent / f"{name}.txt")
    context.window_manager.fileselect_add(self)
    return {"RUNNING_MODAL"}


@operator(
    "Save as TUM",
    inputs.check_trajectory,
    invoke=_ask_for_a_file,
    filepath=StringProperty(subtype="FILE_PATH", description="File to write, ending in .txt"),
    check_existing=BoolProperty(default=True, options={"HIDDEN"}),
    filter_glob=StringProperty(default="*.txt", options={"HIDDEN"}),
)
def save_path(self: Operator, context: Context) -> None:
    """Save the trajectory chosen above as a TUM file: seconds, metres, camera to world, x right, y
    down, z forward
    """
    file = Path(bpy.path.abspath(self.filepath)).expanduser().resolve()
    file = file.with_suffix(file.suffix or ".txt")
    poses = inputs.trajectory(context).trajectory
    write_trajectory(file, poses, "tum")
    state.current().work.message = f"{len(poses)} poses were written to {file.name}"


register, unregister = bpy.utils.register_classes_factory((make_path, keyframe, refresh, save_path))
