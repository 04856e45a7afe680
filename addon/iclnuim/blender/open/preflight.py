"""Checks of the open scene before rendering: properties that affect depth or colour."""

from collections.abc import Iterator

import bpy
import numpy as np
from bpy.types import Node, Scene

from .. import compat, materials, surfaces
from ..notes import names_of
from ..shader_nodes import constant

#: Depth is float32: at this distance from the origin its resolution is about 0.1 mm.
FAR_M = 1000.0
#: View transforms without a choice in them: none, and the defaults of Blender 2.8 and 4.0.
_USUAL = ("Standard", "Raw", "Filmic", "AgX")
#: Settings of a view layer that are off in files where it hides something.
_SHOWN = ("use_solid", "use_sky", "use_strand", "use_volumes")


def findings(baked: bool, noisy: bool = False) -> list[str]:
    """The findings in the open scene, one sentence each.

    `baked` includes limitations of baked light, `noisy` of one sample per pixel that is not
    denoised. Nothing is changed.
    """
    scene = bpy.context.scene
    mirrored = scene.cycles.caustics_reflective  # as the file says: Blender's default
    notes = [*_settings_notes(scene), *_material_notes(baked, noisy, mirrored)]
    meshes = [o for o in scene.objects if o.type == "MESH"]
    far_m = float(np.abs(surfaces.box_corners_m(meshes)).max())
    if far_m > FAR_M:
        where = f"surfaces {far_m:.0f} m from the origin"
        notes.append(f"{where}: float32 depth loses precision there")
    return notes


def _settings_notes(scene: Scene) -> list[str]:
    notes = []
    disabled = "it is disabled here (it changes Z by millimetres)"
    if scene.render.use_motion_blur:
        notes.append(f"motion blur is on in the scene: {disabled}")
    camera = scene.camera
    if camera and camera.type == "CAMERA" and camera.data.dof.use_dof:
        notes.append(f"depth of field is on in the scene's camera: {disabled}")
    view = scene.view_settings
    transform = f"view transform {view.view_transform}"
    is_usual = view.view_transform in _USUAL and view.look in ("None", "")
    if not is_usual or view.exposure != 0 or view.gamma != 1:
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


def _drawn_over(scene: Scene) -> Iterator[tuple[str, bool]]:
    """What may change the image of Cycles, and whether it does: nodes beside input and output."""
    yield "Freestyle lines", scene.render.use_freestyle
    tree = compat.compositor(scene)
    kinds = {node.type for node in tree.nodes} if tree else set()
    effects = kinds - {"R_LAYERS", "COMPOSITE", "GROUP_OUTPUT", "VIEWER", "REROUTE", "FRAME"}
    yield "effects of the compositor", scene.render.use_compositing and bool(effects)


def _material_notes(baked: bool, noisy: bool, mirrored: bool) -> list[str]:
    effects = [*_EFFECTS, *_MIRRORED_EFFECTS * mirrored]
    effects += [*_BAKED_EFFECTS * baked, *_NOISY_EFFECTS * noisy]
    used = [m for m in bpy.data.materials if m.users and m.use_nodes and m.node_tree]
    notes = []
    for what, is_so, effect in effects:
        if shown := [m for m in used if is_so(compat.nodes_of(m.node_tree))]:
            notes.append(f"{what} ({names_of(shown)}): {effect}")
    return notes


def _is_glass(nodes: list[Node]) -> bool:
    return any(map(materials.is_glass, nodes))


def _is_portal(nodes: list[Node]) -> bool:
    return any(node.type == "BSDF_RAY_PORTAL" for node in nodes)


def _is_mixed(nodes: list[Node]) -> bool:
    return any(map(_lets_through, nodes)) and not _is_glass(nodes)


def _is_bright(nodes: list[Node]) -> bool:
    return any(map(_reflects_more_than_it_gets, nodes))


def _has_bumps(nodes: list[Node]) -> bool:
    return any(node.type in ("NORMAL_MAP", "BUMP") for node in nodes)


def _is_rough_metal(nodes: list[Node]) -> bool:
    return any(map(materials.is_rough_metal, nodes))


def _is_mirror(nodes: list[Node]) -> bool:
    return any(map(materials.is_mirror, nodes))


def _reflects_more_than_it_gets(node: Node) -> bool:
    name = {"BSDF_PRINCIPLED": "Base Color", "BSDF_DIFFUSE": "Color"}.get(node.type)
    if name is None:
        return False
    socket = node.inputs[name]
    return not socket.is_linked and max(socket.default_value[:3]) > 1


def _lets_through(node: Node) -> bool:
    if node.type == "BSDF_PRINCIPLED":
        return constant(node.inputs["Alpha"]) != 1.0
    return node.type == "BSDF_TRANSPARENT"


#: What a note is about, whether the nodes of a material show it, and what it does.
_EFFECTS = (
    ("glass", _is_glass, "Z is the depth of the pane"),
    ("ray portals", _is_portal, "Z is the depth of the portal, not of what is seen through it"),
    ("partly transparent surfaces", _is_mixed, "Z is that of the nearest surface, visible or not"),
    ("colours above 1", _is_bright, "they reflect more light than they get"),
)
_MIRRORED_EFFECTS = (("mirrors", _is_mirror, "light that they throw (caustics) is not sampled"),)
_BAKED_EFFECTS = (("normal maps or bumps", _has_bumps, "with baked light visible only in gloss"),)
_NOISY_EFFECTS = (
    ("rough metal", _is_rough_metal, "noisy at 1 sample per pixel, which 16 samples mend"),
)
