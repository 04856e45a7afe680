"""Differences between Blender versions, one function for each, and helpers that several modules
share.

Each function checks for the feature, not for the version.
"""

import io
import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from typing import Any

import bpy
import numpy as np
from bpy.types import (
    ID,
    Action,
    FCurve,
    ImageFormatSettings,
    Material,
    Node,
    NodeSocket,
    NodeTree,
    Object,
    Scene,
)

from ..errors import InputError, WorkError

OLDEST = (4, 2, 0)
#: Upper limit of Cycles' tile_size. From 5.2 on larger images are always rendered in tiles.
LARGEST_TILE_PX = 8192


def require_supported_version() -> None:
    """Raises InputError for a Blender older than 4.2."""
    if bpy.app.version < OLDEST:
        raise InputError(
            "Blender 4.2 or newer",
            found=f"Blender {bpy.app.version_string}",
            hint="4.5 LTS or 5.2 LTS",
        )


def is_package() -> bool:
    """Whether this is the bpy package. Before 4.5 Blender does not say; the package has no path."""
    return getattr(bpy.app, "module", not bpy.app.binary_path)


def converts_libraries() -> bool:
    """Whether colours of a library with another working colour space are converted when it is
    linked: Blender 5.0.
    """
    return hasattr(bpy.types, "BlendFileColorspace")


def version_line() -> str:
    """Version and build hash, such as `4.5.3 LTS (hash)`, which identify the build."""
    return f"{bpy.app.version_string} ({bpy.app.build_hash.decode(errors='replace')})"


@contextmanager
def temporarily(thing: object, **settings: object) -> Iterator[None]:
    """Change settings of a Blender struct temporarily.

    Settings that this version does not have are ignored.
    """
    before = {name: getattr(thing, name) for name in settings if hasattr(thing, name)}
    try:
        for name in before:
            setattr(thing, name, settings[name])
        yield
    finally:
        for name, value in before.items():
            setattr(thing, name, value)


def matt_material(name: str, colour: tuple[float, ...] | None = None) -> tuple[Material, Node]:
    """A new material with a Diffuse BSDF, and that node.

    From 5.0 on every material has a node tree.
    """
    material = bpy.data.materials.new(name)
    if material.node_tree is None:
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    if colour is not None:
        diffuse.inputs["Color"].default_value = colour
    return material, diffuse


def add_white_sky(scene: Scene, strength: float) -> None:
    """Give the scene a uniform sky."""
    world = bpy.data.worlds.new("Neutral light")
    if world.node_tree is None:
        world.use_nodes = True
    sky = world.node_tree.nodes["Background"].inputs
    sky["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    sky["Strength"].default_value = strength
    scene.world = world


def nodes_of(tree: NodeTree) -> list[Node]:
    """All nodes of a tree, including those of groups."""
    found = list(tree.nodes)
    for node in tree.nodes:
        if node.type == "GROUP" and node.node_tree:
            found += nodes_of(node.node_tree)
    return found


def volume_outputs() -> list[Node]:
    """The output nodes with a volume, of materials and worlds in use."""
    found = []
    for block in (*bpy.data.materials, *bpy.data.worlds):
        for node in block.node_tree.nodes if block.users and block.node_tree else ():
            is_output = node.type in ("OUTPUT_MATERIAL", "OUTPUT_WORLD")
            if is_output and node.inputs["Volume"].is_linked:
                found.append(node)
    return found


def compositor(scene: Scene) -> NodeTree | None:
    """The compositor's nodes; from 5.0 on they are a group."""
    if hasattr(scene, "compositing_node_group"):
        return scene.compositing_node_group
    return scene.node_tree if scene.use_nodes else None


def unlink(socket: NodeSocket) -> None:
    """Remove all links of an input or output."""
    for link in list(socket.links):
        socket.id_data.links.remove(link)


def redirect(old: NodeSocket, new: NodeSocket) -> None:
    """Move all links of the output `old` to the output `new`."""
    for target in [link.to_socket for link in old.links]:
        old.id_data.links.new(new, target)


def bake(thing: Object, **options: object) -> None:
    """Bake one object with Cycles. Raises WorkError with Blender's message."""
    layer = bpy.context.view_layer
    layer.update()  # otherwise an object that was just linked may not be in the layer yet
    for other in layer.objects:
        other.select_set(other == thing)
    layer.objects.active = thing
    try:
        with redirect_stdout(io.StringIO()):  # Blender prints each time that the image is not saved
            result = bpy.ops.object.bake(**options)
    except RuntimeError as error:
        message = " ".join(str(error).split())
        raise WorkError(f"{thing.name}: cannot be baked: Blender: {message}") from None
    if result != {"FINISHED"}:
        raise WorkError(f"{thing.name}: Blender stopped baking")


def set_multilayer_exr(image_settings: ImageFormatSettings) -> None:
    """Set 32-bit float multilayer EXR, not compressed.

    From 5.0 on the media type must be set before the format.
    """
    if hasattr(image_settings, "media_type"):
        image_settings.media_type = "MULTI_LAYER_IMAGE"
    image_settings.file_format = "OPEN_EXR_MULTILAYER"
    image_settings.color_depth = "32"
    image_settings.exr_codec = "NONE"


def fcurves(datablock: ID, action: Action) -> Any:
    """The F-curves of `action` for `datablock`.

    From 4.4 on they are in layers, strips and channel bags of a slot.
    """
    animation = datablock.animation_data_create()
    animation.action = action
    if not hasattr(action, "slots"):
        return action.fcurves
    slots = action.slots
    layers = action.layers
    slot = next(iter(slots), None) or slots.new(id_type=datablock.id_type, name=datablock.name)
    animation.action_slot = slot
    layer = next(iter(layers), None) or layers.new("Layer")
    strip = next(iter(layer.strips), None) or layer.strips.new(type="KEYFRAME")
    return strip.channelbag(slot, ensure=True).fcurves


@contextmanager
def passes_in_memory(wanted: bool) -> Iterator[dict[str, np.ndarray] | None]:
    """Yields a dictionary that gets the channels (h, w) of the render in the `with` block, top row
    first, named as in Blender's multilayer EXR; None if they are not wanted, if this version does
    not allow it, or if the image is larger than a tile.

    The Python part of Cycles is intercepted: once the render has ended, passes are no longer
    accessible from Python.
    """
    cycles: Any = sys.modules.get("cycles.engine")
    original = getattr(cycles, "render", None)
    accessible = (
        "get_result" in bpy.types.RenderEngine.bl_rna.functions
        and "rect" in bpy.types.RenderPass.bl_rna.properties
    )
    frame = bpy.context.scene.render
    whole = max(frame.resolution_x, frame.resolution_y) <= LARGEST_TILE_PX
    if not (wanted and whole and accessible) or original is None:
        yield None
        return
    passes: dict[str, np.ndarray] = {}

    def render(engine: Any, depsgraph: Any) -> None:
        original(engine, depsgraph)
        passes.update(_channels(engine.get_result()))

    cycles.render = render
    try:
        yield passes
    finally:
        cycles.render = original


def _channels(result: Any) -> dict[str, np.ndarray]:
    """The channels of all passes of a RenderResult."""
    channels: dict[str, np.ndarray] = {}
    for layer in result.layers:
        for found in layer.passes:
            size = (result.resolution_y, result.resolution_x, found.channels)
            values = np.empty(math.prod(size), np.float32)
            found.rect.foreach_get(values)
            image = values.reshape(size)[::-1]
            names = found.channel_id or "RGBA"
            for k in range(found.channels):
                channels[f"{layer.name}.{found.name}.{names[k]}"] = image[..., k]
    return channels


def has_denoiser() -> bool:
    """Whether this build has OpenImageDenoise (Debian's builds do not)."""
    try:
        import _cycles

        return bool(getattr(_cycles, "with_openimagedenoise", False))
    except ImportError:
        return False


def leave_out_experiments(scene: Scene) -> None:
    """Use only Cycles' supported features. From 5.2 on there is no other feature set."""
    if hasattr(scene.cycles, "feature_set"):
        scene.cycles.feature_set = "SUPPORTED"


def import_fbx(path: str) -> object:
    """Import FBX by Blender's importer (from 4.5 on), or else by that of the add-on.

    Raises AttributeError if there is none.
    """
    for group, name in (("wm", "fbx_import"), ("import_scene", "fbx")):
        reader = getattr(getattr(bpy.ops, group), name)
        if _is_there(reader):
            return reader(filepath=path)
    raise AttributeError("fbx")


def import_usd(path: str) -> object:
    """Import USD with preview materials. Raises AttributeError in builds without USD."""
    if not _is_there(bpy.ops.wm.usd_import):
        raise AttributeError("usd")
    known = bpy.ops.wm.usd_import.get_rna_type().properties.keys()
    wanted = {"import_usd_preview", "apply_unit_conversion_scale"}
    options = dict.fromkeys(wanted & set(known), True)
    if "set_frame_range" in known:
        options["set_frame_range"] = False
    add_white_sky(bpy.context.scene, 0.0)  # Blender passes over dome lights if there is no sky
    return bpy.ops.wm.usd_import(filepath=path, **options)


def gltf_extensions() -> set[str]:
    """The extensions that Blender's importer of glTF reads."""
    from io_scene_gltf2.io.imp.gltf2_io_gltf import glTFImporter

    return set(glTFImporter("", {"import_user_extensions": []}).extensions_managed)


def _is_there(operator: Any) -> bool:
    try:
        operator.get_rna_type()
    except (KeyError, RuntimeError, AttributeError):
        return False
    return True


def animated_curves(block: ID | None) -> list[FCurve]:
    """All F-curves of a datablock: of its action and of its strips, without drivers."""
    animation = getattr(block, "animation_data", None)
    if animation is None:
        return []
    actions = [animation.action]
    for track in animation.nla_tracks:
        actions += [strip.action for strip in track.strips]
    curves = []
    for action in filter(None, actions):
        curves += curves_of(action)
    return curves


def curves_of(action: Action) -> list[FCurve]:
    """All F-curves of an action, of all slots.

    Nothing is changed. See `fcurves` about layers and slots.
    """
    if not hasattr(action, "layers"):
        return list(action.fcurves)
    curves = []
    for layer in action.layers:
        for strip in layer.strips:
            for bag in strip.channelbags:
                curves += bag.fcurves
    return curves
