"""The chosen scene, shown in this window in a collection of its own. What is hidden meanwhile comes
back when the scene is removed.
"""

from pathlib import Path
from typing import Any

import bpy
import mathutils
import numpy as np
from bpy.app.handlers import persistent
from bpy.types import Collection, Context, Operator, Scene, SpaceView3D

from .. import shipped
from ..blender.open import importers, orient, sanitize, scene_paths
from ..errors import IclnuimError, InputError
from ..geometry.scene_axes import SceneReading
from . import inputs, state, trajectory_view
from .state import operator

#: Properties of the collection, of what is hidden, and of what was set before.
_HIDDEN = "iclnuim_hidden"
_WORLD = "iclnuim_world"
_VIEW = "iclnuim_view"
#: Property of everything that was loaded with the scene.
_LOADED = "iclnuim_loaded"
#: Share of the corners of all objects on either side that are not framed: a backdrop is far away.
_FAR = 0.05


def _shown(context: Context) -> Collection:
    collection = bpy.data.collections.get(trajectory_view.COLLECTION)
    if collection is None:
        raise InputError("a shown scene", found="none", hint="Show the Scene")
    return collection


def _can_be_shown(context: Context) -> None:
    chosen = inputs.chosen_scene(context.scene.iclnuim)
    # Blender cannot append objects of the open file
    if chosen == "OPEN" or Path(chosen) == Path(bpy.data.filepath).resolve():
        found = "the open file, which is already shown"
        raise InputError("a built-in scene or a file to show", found=found)


@operator("Show the Scene", _can_be_shown, undo=True)
def load_scene(self: Operator, context: Context) -> None:
    """Load the chosen scene into this window, in a collection of its own, and frame it.

    It replaces the scene that was loaded before
    """
    settings = context.scene.iclnuim
    name = inputs.chosen_scene(settings)
    find = shipped.scene_file if shipped.is_scene(name) else importers.checked_file
    file = find(name)
    if settings.scene_source == "FILE":
        scene_paths.check(file, settings.reading())
    if trajectory_view.COLLECTION in bpy.data.collections:
        _restore(context)
    collection = bpy.data.collections.new(trajectory_view.COLLECTION)
    collection[_WORLD] = context.scene.world
    context.scene.collection.children.link(collection)
    before = set(bpy.data.user_map())
    try:
        read_as = _load(context, file, collection)
    except IclnuimError:
        _restore(context)
        raise
    for block in set(bpy.data.user_map()) - before:
        if block.library is None:
            block[_LOADED] = True
            block.use_fake_user = False
    collection[trajectory_view.SHOWN] = name
    hidden = _hide_start_up(context.scene, collection)
    for area in state.areas("VIEW_3D"):
        _look_into(context, area.spaces.active, collection)
    state.current().view_before = tuple(collection.get(_VIEW, (True, False)))
    trajectory_view.refresh(context)
    hidden += ["symbols of lamps and cameras", "backs of walls"]
    work = state.current().work
    work.message = f"{file.stem} is shown; hidden until Remove: {', '.join(hidden)}"
    work.notes += filter(None, [read_as])


@operator("Remove", _shown, undo=True)
def remove_scene(self: Operator, context: Context) -> None:
    """Remove the scene that is shown, and show again what was hidden for it"""
    _restore(context)
    trajectory_view.refresh(context)
    state.current().work.message = "the scene is removed; what was hidden is shown again"


def _restore(context: Context) -> None:
    collection = _shown(context)
    context.scene.world = collection.get(_WORLD)
    if _VIEW in collection:
        _set_views(*collection[_VIEW])
    state.current().view_before = None
    bpy.data.batch_remove([*collection.all_objects, collection])
    while unused := [block for block in bpy.data.user_map() if _is_unused(block)]:
        bpy.data.batch_remove(unused)
    for thing in context.scene.objects:
        if thing.pop(_HIDDEN, False):
            thing.hide_viewport = thing.hide_render = False


def _is_unused(block: bpy.types.ID) -> bool:
    return block.users == 0 and _LOADED in block


def _set_views(show_extras: bool, show_backface_culling: bool) -> None:
    for area in state.areas("VIEW_3D"):
        _set_view(area.spaces.active, show_extras, show_backface_culling)


@persistent
def _undone(*_: Any) -> None:
    """Undo and redo show and remove the scene, but do not change what the views hide for it."""
    panel = state.current()
    collection = bpy.data.collections.get(trajectory_view.COLLECTION)
    if collection is None and panel.view_before is not None:
        _set_views(*panel.view_before)
        panel.view_before = None
    elif collection is not None and panel.view_before is None:
        _set_views(False, True)
        panel.view_before = tuple(collection.get(_VIEW, (True, False)))


def _set_view(space: SpaceView3D, show_extras: bool, show_backface_culling: bool) -> None:
    """Extras are lamps, cameras and empties: spot lamps draw wide circles. Culling shows the
    inside of a room from outside.
    """
    space.overlay.show_extras = bool(show_extras)
    space.shading.show_backface_culling = bool(show_backface_culling)


def _hide_start_up(scene: Scene, collection: Collection) -> list[str]:
    """Hide the objects of the start-up file, which would be inside the room. Returns their
    names.
    """
    hidden = []
    for name in ("Cube", "Light"):
        thing = scene.objects.get(name)
        if thing is None or thing.hide_viewport or name in collection.all_objects:
            continue
        thing.hide_viewport = thing.hide_render = True
        thing[_HIDDEN] = True
        hidden.append(name)
    return hidden


def _look_into(context: Context, space: SpaceView3D, collection: Collection) -> None:
    """Frame the collection, and hide what is in the way."""
    collection[_VIEW] = [space.overlay.show_extras, space.shading.show_backface_culling]
    _set_view(space, False, True)
    context.view_layer.update()
    corners = []
    for thing in collection.all_objects:
        if thing.type == "MESH":
            corners += [thing.matrix_world @ mathutils.Vector(c) for c in thing.bound_box]
    if not corners:
        return
    low, high = np.quantile(np.array(corners), (_FAR, 1 - _FAR), axis=0)
    view = space.region_3d
    view.view_perspective = "PERSP"
    view.view_location = (low + high) / 2
    view.view_distance = 1.5 * float(np.linalg.norm(high - low))


def _load(context: Context, file: Path, collection: Collection) -> str:
    """Load the file into the collection. Returns how it was read, empty for a built-in scene."""
    settings = context.scene.iclnuim
    reading = settings.reading()
    read_as = ""
    if file.suffix.lower() != ".blend":
        read_as = _import(context, file, reading, collection)
    else:
        _append(context.scene, file, collection)
        if settings.scene_source == "FILE":
            read_as, _ = orient.orient(file, reading, list(collection.all_objects))
    for thing in collection.all_objects:
        thing.select_set(False)
    return read_as


def _append(scene: Scene, file: Path, collection: Collection) -> None:
    before = set(bpy.data.user_map())
    with bpy.data.libraries.load(str(file), link=False) as (there, here):
        here.objects = list(there.objects)
        here.worlds = list(there.worlds)[:1]
    sanitize.remove_python_drivers(set(bpy.data.user_map()) - before)
    for thing in here.objects:
        if thing is not None:
            collection.objects.link(thing)
    if here.worlds:
        scene.world = here.worlds[0]


def _import(context: Context, file: Path, reading: SceneReading, collection: Collection) -> str:
    """Import the file through a separate scene, because axes and units are guessed from everything
    in the scene. Returns how it was read.
    """
    before = context.window.scene
    own = bpy.data.scenes.new("ICL-NUIM import")
    context.window.scene = own
    try:
        importers.load(file)
        sentence, _ = orient.orient(file, reading, list(own.objects))
        for thing in list(own.collection.all_objects):
            collection.objects.link(thing)
    finally:
        context.window.scene = before
        bpy.data.scenes.remove(own)
    return sentence


_register, _unregister = bpy.utils.register_classes_factory((load_scene, remove_scene))


def register() -> None:
    _register()
    bpy.app.handlers.undo_post.append(_undone)
    bpy.app.handlers.redo_post.append(_undone)


def unregister() -> None:
    bpy.app.handlers.undo_post.remove(_undone)
    bpy.app.handlers.redo_post.remove(_undone)
    _unregister()
