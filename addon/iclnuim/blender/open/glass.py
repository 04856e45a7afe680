"""Glass of user-provided scenes: light passes through it, and false glass of .mtl files is
opaque.
"""

import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import bpy
from bpy.types import Material, Node, NodeTree

from ..compat import nodes_of
from ..materials import f0, is_glass
from ..notes import names_of
from ..shader_nodes import (
    Source,
    add_node,
    calculate,
    constant_or_input,
    one_minus,
    product,
    scaled,
)


def without_false_glass(path: Path) -> list[str]:
    """Make materials of the OBJ at `path` opaque if only `Tf` makes them glass: 3ds Max writes `Tf
    1 1 1` for all, with `d 1` and `illum 2`.
    """
    opaque = set()
    for name, values in mtl_materials(path):
        material = bpy.data.materials.get(name[:63])
        if material is None or not _is_falsely_glass(values):
            continue
        for node in material.node_tree.nodes:
            if node.type == "BSDF_PRINCIPLED":
                transmission = node.inputs["Transmission Weight"]
                if transmission.default_value > 0:
                    transmission.default_value = 0.0
                    opaque.add(material)
    if not opaque:
        return []
    return [f"Tf of opaque materials ({names_of(opaque)}): not treated as glass"]


def mtl_materials(path: Path) -> Iterator[tuple[str, dict[str, list[str]]]]:
    """(name, keyword -> arguments) of each material in the .mtl files of an OBJ."""
    named = re.findall(rb"^[ \t]*mtllib[ \t]+(.+?)[ \t\r]*$", path.read_bytes(), re.MULTILINE)
    libraries = {path.parent / os.fsdecode(name).strip('"') for name in named}
    for library in sorted(libraries | {path.with_suffix(".mtl")}):
        if not library.is_file():
            continue
        text = library.read_text("utf-8", "replace")
        for block in re.split(r"^\s*newmtl[ \t]+", text, flags=re.MULTILINE)[1:]:
            name, *lines = block.splitlines()
            words = [line.split() for line in lines if line.strip()]
            yield name.strip(), {keyword.lower(): rest for keyword, *rest in words}


def _is_falsely_glass(values: dict[str, list[str]]) -> bool:
    """Whether a material has `Tf`, but is opaque by `d` and by an `illum` without transparency."""
    opacity = values.get("d", ["1"])[-1]
    is_solid = values.get("illum") in (["0"], ["1"], ["2"]) and re.fullmatch(r"1(\.0*)?", opacity)
    return bool(is_solid) and "tf" in values


def let_light_through(materials: Iterable[Material]) -> list[str]:
    """Let light of lamps and sky pass straight through glass, reduced by its colour and reflection:
    caustics are not sampled, so otherwise no light would pass. Its appearance to cameras and in
    reflections does not change. Returns the names of the changed materials.
    """
    changed = []
    done: set[Node] = set()
    for material in materials:
        glass = [node for node in nodes_of(material.node_tree) if is_glass(node)]
        for node in glass:
            if node not in done:
                _let_through(node.id_data, node)
                done.add(node)
        if glass:
            material.use_transparent_shadow = True
            changed.append(material.name)
    return changed


def _let_through(tree: NodeTree, node: Node) -> None:
    """For shadow rays and diffuse rays, replace the glass by a Transparent BSDF."""
    targets = [link.to_socket for link in node.outputs[0].links]
    rays = tree.nodes.new("ShaderNodeLightPath").outputs
    share: Source = calculate(tree, "MAXIMUM", rays["Is Shadow Ray"], rays["Is Diffuse Ray"])
    if node.type == "BSDF_PRINCIPLED":
        not_metal = one_minus(tree, constant_or_input(node, "Metallic"))
        share = product(tree, share, constant_or_input(node, "Transmission Weight"), not_metal)
        # its colour applies to two surfaces
        colour: Source = add_node(tree, "Gamma", node.inputs["Base Color"], 0.5)
    else:
        colour = node.inputs["Color"]
    if node.type != "BSDF_REFRACTION":
        # Schlick's formula, the same from both sides, because panes are often single faces
        facing = tree.nodes.new("ShaderNodeLayerWeight")
        facing.inputs["Blend"].default_value = 0.5  # then Facing is 1 - cos
        passing = one_minus(tree, calculate(tree, "POWER", facing.outputs["Facing"], 5.0))
        colour = scaled(tree, colour, product(tree, 1.0 - f0(node.inputs["IOR"]), passing))
    clear = add_node(tree, "BsdfTransparent", colour)
    mixed = add_node(tree, "MixShader", share, node.outputs[0], clear)
    for target in targets:
        tree.links.new(mixed, target)
