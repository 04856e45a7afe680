"""Checks of the open scene before rendering: properties that affect depth or colour."""

from collections.abc import Iterator

import bpy
import numpy as np

from .. import compat, surfaces
from ..notes import names_of
from .motion import moving_names

#: Depth is float32: at this distance from the origin its resolution is about 0.1 mm.
FAR_M = 1000.0
#: Settings of a view layer that are off in files where it hides something.
_SHOWN = ("use_solid", "use_sky", "use_strand", "use_volumes")


def findings(baked: bool) -> list[str]:
    """The findings in the open scene, one sentence each.

    `baked` includes limitations of baked light. Nothing is changed.
    """
    scene = bpy.context.scene
    notes = [*_settings_notes(scene), *_material_notes(baked)]
    meshes = [o for o in scene.objects if o.type == "MESH"]
    far_m = float(np.abs(surfaces.box_corners_m(meshes)).max())
    if far_m > FAR_M:
        where = f"surfaces {far_m:.0f} m from the origin"
        notes.append(f"{where}: float32 depth loses precision there")
    if moving := moving_names(scene):
        effect = "each frame shows them at its own time"
        if baked:
            effect = "baked light would be wrong there; path tracing is correct"
        notes.append(f"objects or lights that move ({names_of(moving)}): {effect}")
    return notes


def _settings_notes(scene: bpy.types.Scene) -> list[str]:
    notes = []
    disabled = "it is disabled here (it changes Z by millimetres)"
    if scene.render.use_motion_blur:
        notes.append(f"motion blur is on in the scene: {disabled}")
    camera = scene.camera
    if camera and camera.type == "CAMERA" and camera.data.dof.use_dof:
        notes.append(f"depth of field is on in the scene's camera: {disabled}")
    view = scene.view_settings
    transform = f"view transform {view.view_transform}"
    is_linear = view.view_transform in ("Standard", "Raw") and view.look in ("None", "")
    if not is_linear or view.exposure != 0 or view.gamma != 1:
        settings = f"{transform}, exposure {view.exposure:g}, gamma {view.gamma:g}"
        notes.append(f"{settings}: not applied, frames contain scene-linear RGB")
    if drawn := [name for name, is_on in _drawn_over(scene) if is_on]:
        notes.append(f"{' and '.join(drawn)}: left out, frames contain what Cycles renders")
    layer = scene.view_layers[0]
    ignored = [name for name in _SHOWN if not getattr(layer, name)]
    if layer.material_override:
        ignored.append("material_override")
    if ignored:
        notes.append(f"settings of the view layer ({names_of(ignored)}): not applied")
    if (exposure := scene.cycles.film_exposure) != 1:
        notes.append(f"film exposure {exposure:g}: not applied, 1 is the light of the scene")
    return notes


def _drawn_over(scene: bpy.types.Scene) -> Iterator[tuple[str, bool]]:
    """What may change the image of Cycles, and whether it does: nodes beside input and output."""
    yield "Freestyle lines", scene.render.use_freestyle
    tree = compat.compositor(scene)
    kinds = {node.type for node in tree.nodes} if tree else set()
    effects = kinds - {"R_LAYERS", "COMPOSITE", "GROUP_OUTPUT", "VIEWER", "REROUTE", "FRAME"}
    yield "effects of the compositor", scene.render.use_compositing and bool(effects)


def _material_notes(baked: bool) -> list[str]:
    glass = []
    mixed = []
    bumps = []
    bright = []
    for material in bpy.data.materials:
        if not material.users or not material.node_tree:
            continue
        nodes = compat.nodes_of(material.node_tree)
        kinds = {node.type for node in nodes}
        if baked and kinds & {"NORMAL_MAP", "BUMP"}:
            bumps.append(material)
        if not material.use_nodes:
            continue
        if any(map(_reflects_more_than_it_gets, nodes)):
            bright.append(material)
        if kinds & {"BSDF_GLASS", "BSDF_REFRACTION"} or _uses(nodes, "Transmission Weight", 0.0):
            glass.append(material)
        elif "BSDF_TRANSPARENT" in kinds or _uses(nodes, "Alpha", 1.0):
            mixed.append(material)
    notes = []
    if glass:
        notes.append(f"glass ({names_of(glass)}): Z is the depth of the pane")
    if mixed:
        effect = "Z is that of the nearest surface, visible or not"
        notes.append(f"partly transparent surfaces ({names_of(mixed)}): {effect}")
    if bright:
        effect = "they reflect more light than they get"
        notes.append(f"colours above 1 ({names_of(bright)}): {effect}")
    if bumps:
        effect = "with baked light visible only in gloss"
        notes.append(f"normal maps or bumps ({names_of(bumps)}): {effect}")
    return notes


def _reflects_more_than_it_gets(node: bpy.types.Node) -> bool:
    name = {"BSDF_PRINCIPLED": "Base Color", "BSDF_DIFFUSE": "Color"}.get(node.type)
    if name is None:
        return False
    socket = node.inputs[name]
    return not socket.is_linked and max(tuple(socket.default_value)[:3]) > 1


def _uses(nodes: list[bpy.types.Node], name: str, neutral: float) -> bool:
    """Whether a Principled surface has another value than the neutral one in an input."""
    for node in nodes:
        entry = node.inputs.get(name) if node.type == "BSDF_PRINCIPLED" else None
        if entry is not None and (entry.is_linked or entry.default_value != neutral):
            return True
    return False
