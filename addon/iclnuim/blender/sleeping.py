"""Scripts of somebody's file stay asleep in the user's window too: what is brought in loses its drivers written in Python.

A file opened for a render runs nothing, by use_scripts=False. In a window the user may trust the open file; what is appended
to it comes from another one.
"""

from __future__ import annotations

from collections.abc import Iterable

import bpy


def silence(things: Iterable[bpy.types.Object | None]) -> int:
    """Remove drivers that need Python from objects, their data, shape keys and materials, before they are evaluated; how many."""
    blocks = {block for thing in things if thing is not None for block in _blocks_of(thing)}
    return sum(_without_python(block) for block in blocks)


def _blocks_of(thing: bpy.types.Object) -> list[bpy.types.ID]:
    data = thing.data
    materials = [slot.material for slot in thing.material_slots if slot.material]
    blocks = [thing, data, getattr(data, "shape_keys", None), getattr(data, "node_tree", None)]
    blocks += [*materials, *(m.node_tree for m in materials)]
    blocks += [m.node_group for m in thing.modifiers if m.type == "NODES"]
    return [block for block in blocks if block is not None]


def _without_python(block: bpy.types.ID) -> int:
    animation = getattr(block, "animation_data", None)
    if animation is None:
        return 0
    curves = [c for c in animation.drivers if c.driver.type == "SCRIPTED" and not c.driver.is_simple_expression]
    for curve in curves:
        animation.drivers.remove(curve)
    return len(curves)
