"""Properties of materials that decide how light is baked and passes: diffuse, translucent,
glass.
"""

from bpy.types import Material, Node, NodeLink, NodeSocket, NodeTree

from .compat import nodes_of
from .shader_nodes import constant

#: Oren-Nayar roughness from which frames with baked light, which does not depend on the view, come
#: below 30 dB: 24 dB at 1.
_ROUGH = 0.3
#: Roughness from which a floor of metal is noisy at one sample: 39 dB at 0.1, 30 dB at 0.3.
_BLURRED = 0.2
DIFFUSE = {"BSDF_DIFFUSE", "SUBSURFACE_SCATTERING"}


def kind(material: Material | None) -> tuple[bool, bool, bool]:
    """Whether a material shows light on the side that is seen, whether light passes through from
    the other side, and whether it reflects light to others.

    No material, or one without nodes, is diffuse.
    """
    tree = tree_of(material)
    if tree is None:
        return True, False, True
    nodes = nodes_of(tree)
    types = {node.type for node in nodes}
    principled = [node for node in nodes if node.type == "BSDF_PRINCIPLED"]
    diffuse = bool(types & DIFFUSE)
    translucent = "BSDF_TRANSLUCENT" in types
    sends = diffuse or translucent or any(map(reflects, principled))
    return diffuse or any(map(has_diffuse, principled)), translucent, sends


def is_glass(node: Node) -> bool:
    """Whether the node is a shader that transmits light, at least in part."""
    if node.type == "BSDF_PRINCIPLED":
        transmission = constant(node.inputs["Transmission Weight"])
        return transmission != 0.0 and constant(node.inputs["Metallic"]) != 1.0
    return node.type in {"BSDF_GLASS", "BSDF_REFRACTION"}


def tree_of(material: Material | None) -> NodeTree | None:
    return material.node_tree if material is not None and material.use_nodes else None


def emits(material: Material | None) -> bool:
    """Whether a material gives light to others."""
    tree = tree_of(material)
    return tree is not None and any(map(_is_emitter, nodes_of(tree)))


def _is_emitter(node: Node) -> bool:
    if node.type == "EMISSION" and not all(map(_is_for_cameras, node.outputs[0].links)):
        return _is_on(node.inputs["Color"], node.inputs["Strength"])
    if node.type == "BSDF_PRINCIPLED":
        return _is_on(node.inputs["Emission Color"], node.inputs["Emission Strength"])
    return False


def _is_for_cameras(link: NodeLink) -> bool:
    """Whether only camera rays get what is linked, as from the unlit materials of glTF."""
    mix = link.to_node
    if mix.type != "MIX_SHADER" or link.to_socket != mix.inputs[2]:
        return False
    return any(factor.from_socket.name == "Is Camera Ray" for factor in mix.inputs[0].links)


def _is_on(colour: NodeSocket, strength: NodeSocket) -> bool:
    is_bright = colour.is_linked or max(tuple(colour.default_value)[:3]) > 0
    return is_bright and (strength.is_linked or strength.default_value > 0)


def has_diffuse(principled: Node) -> bool:
    """False only for pure metal or pure glass."""
    metal = constant(principled.inputs["Metallic"])
    return metal != 1.0 and constant(principled.inputs["Transmission Weight"]) != 1.0


def is_rough(node: Node) -> bool:
    """Whether the node is a diffuse shader whose roughness dims and brightens it by the angle."""
    if node.type == "BSDF_PRINCIPLED" and has_diffuse(node):
        roughness = node.inputs.get("Diffuse Roughness")  # from Blender 4.3 on
    else:
        roughness = node.inputs["Roughness"] if node.type == "BSDF_DIFFUSE" else None
    if roughness is None:
        return False
    value = constant(roughness)
    return value is None or value > _ROUGH


def is_rough_metal(node: Node) -> bool:
    """Whether the node mirrors, at least in part, in so many directions that one sample of them is
    not enough.
    """
    if not _is_metal(node):
        return False
    value = constant(node.inputs["Roughness"])
    return value is None or value > _BLURRED


def is_mirror(node: Node) -> bool:
    """Whether the node mirrors light so sharply that it throws bright spots (caustics)."""
    value = constant(node.inputs["Roughness"]) if _is_metal(node) else None
    return value is not None and value <= _BLURRED


def _is_metal(node: Node) -> bool:
    if node.type == "BSDF_PRINCIPLED":
        return constant(node.inputs["Metallic"]) != 0.0
    return node.type in {"BSDF_GLOSSY", "BSDF_METALLIC"}


def reflects(principled: Node) -> bool:
    """False only for pure glass: metal reflects light to others, too."""
    return constant(principled.inputs["Transmission Weight"]) != 1.0


def f0(ior: NodeSocket) -> float:
    """Reflectance at normal incidence; for a linked IOR, by the value of the unlinked input."""
    return float(((ior.default_value - 1) / (ior.default_value + 1)) ** 2)
