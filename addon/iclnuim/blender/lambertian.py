"""The open scene without view-dependent light: gloss taken out of every material, in memory.

A mix or sum with a Glossy BSDF becomes its other part; a metal becomes a matt surface of its colour; a Principled surface loses
specular, metallic, coat and sheen. What an odometer gains on such frames is what reflections cost it.
"""

import bpy

_MATT = {"Specular IOR Level": 0.0, "Metallic": 0.0, "Coat Weight": 0.0, "Sheen Weight": 0.0}


def apply() -> None:
    """Change all materials of the open scene."""
    for material in bpy.data.materials:
        if material.use_nodes and material.node_tree:
            _without_gloss(material.node_tree)


def _without_gloss(tree: bpy.types.NodeTree) -> None:
    for node in [n for n in tree.nodes if n.type in ("MIX_SHADER", "ADD_SHADER")]:
        shaders = [s for s in node.inputs if s.type == "SHADER" and s.is_linked]
        others = [s.links[0].from_socket for s in shaders if not s.links[0].from_node.type.startswith("BSDF_GLOSSY")]
        if len(shaders) == 2 and len(others) == 1:
            for link in list(node.outputs[0].links):
                tree.links.new(others[0], link.to_socket)
    for node in [n for n in tree.nodes if n.type == "BSDF_GLOSSY"]:
        _as_diffuse(tree, node)
    for node in [n for n in tree.nodes if n.type == "BSDF_PRINCIPLED"]:
        for name, value in _MATT.items():
            if name in node.inputs:
                for link in list(node.inputs[name].links):
                    tree.links.remove(link)
                node.inputs[name].default_value = value


def _as_diffuse(tree: bpy.types.NodeTree, glossy: bpy.types.Node) -> None:
    matt = tree.nodes.new("ShaderNodeBsdfDiffuse")
    matt.inputs["Color"].default_value = glossy.inputs["Color"].default_value
    if glossy.inputs["Color"].is_linked:
        tree.links.new(glossy.inputs["Color"].links[0].from_socket, matt.inputs["Color"])
    for link in list(glossy.outputs[0].links):
        tree.links.new(matt.outputs[0], link.to_socket)
    tree.nodes.remove(glossy)
