"""Glass of user-provided scenes: light passes through it, and false glass of .mtl files is opaque."""

import os
import re
from collections.abc import Iterable
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
    named = re.findall(rb"^[ \t]*mtllib[ \t]+(.+?)[ \t\r]*$", path.read_bytes(), re.MULTILINE)
    libraries = {path.parent / os.fsdecode(name).strip('"') for name in named} | {
        path.with_suffix(".mtl")
    }
    texts = [
        library.read_text("utf-8", "replace") for library in sorted(libraries) if library.is_file()
    ]
    opaque = []
    for block in (
        block
        for text in texts
        for block in re.split(r"^\s*newmtl[ \t]+", text, flags=re.MULTILINE)[1:]
    ):
        name, *lines = block.splitlines()
        values = {
            word.lower(): rest for word, *rest in (line.split() for line in lines if line.strip())
        }
        solid = values.get("illum") in (["0"], ["1"], ["2"]) and re.fullmatch(
            r"1(\.0*)?", values.get("d", ["1"])[-1]
        )
        material = bpy.data.materials.get(name.strip()[:63]) if solid and "tf" in values else None
        for node in material.node_tree.nodes if material else ():
            if (
                node.type == "BSDF_PRINCIPLED"
                and node.inputs["Transmission Weight"].default_value > 0
            ):
                node.inputs["Transmission Weight"].default_value = 0.0
                opaque.append(material)
    return [f"Tf of opaque materials ({names_of(opaque)}): not treated as glass"] if opaque else []


def let_light_through(materials: Iterable[Material]) -> list[str]:
    """Let light of lamps and sky pass straight through glass, reduced by its colour and reflection:
    caustics are not sampled, so otherwise no
    light would pass. Its appearance to cameras and in reflections does not change. Returns the
    names of the changed materials.
    """
    changed, done = [], set()
    for material in materials:
        glass = [node for node in nodes_of(material.node_tree) if is_glass(node)]
        for node in (node for node in glass if node not in done):
            _let_through(node.id_data, node)
        done.update(glass)
        if glass:
            material.use_transparent_shadow = True
            changed.append(material.name)
    return changed


def _let_through(tree: NodeTree, node: Node) -> None:
    """For shadow rays and diffuse rays, replace the glass by a Transparent BSDF."""
    targets, rays = (
        [link.to_socket for link in node.outputs[0].links],
        tree.nodes.new("ShaderNodeLightPath"),
    )
    share: Source = calculate(
        tree, "MAXIMUM", rays.outputs["Is Shadow Ray"], rays.outputs["Is Diffuse Ray"]
    )
    colour: Source = node.inputs["Base Color" if node.type == "BSDF_PRINCIPLED" else "Color"]
    if node.type == "BSDF_PRINCIPLED":  # its colour applies to two surfaces
        share = product(
            tree,
            share,
            constant_or_input(node, "Transmission Weight"),
            one_minus(tree, constant_or_input(node, "Metallic")),
        )
        colour = add_node(tree, "Gamma", colour, 0.5)
    if (
        node.type != "BSDF_REFRACTION"
    ):  # Schlick's formula, the same from both sides, because panes are often single faces
        facing = tree.nodes.new("ShaderNodeLayerWeight")
        facing.inputs["Blend"].default_value = 0.5  # then Facing is 1 - cos
        passing = one_minus(tree, calculate(tree, "POWER", facing.outputs["Facing"], 5.0))
        colour = scaled(tree, colour, product(tree, 1.0 - f0(node.inputs["IOR"]), passing))
    mixed = add_node(
        tree, "MixShader", share, node.outputs[0], add_node(tree, "BsdfTransparent", colour)
    )
    for target in targets:
        tree.links.new(mixed, target)
