"""Small arithmetic in shader node trees: every function adds nodes and returns the socket of the result."""

from __future__ import annotations

import bpy

#: What can be fed into a node: a constant, an output, or an input whose source is shared.
Source = float | bpy.types.NodeSocket


def feed(tree: bpy.types.NodeTree, source: Source, target: bpy.types.NodeSocket) -> None:
    """Give `target` a constant, an output, or whatever feeds another input."""
    if isinstance(source, int | float):
        target.default_value = source
    elif source.is_output:
        tree.links.new(source, target)
    else:
        same_source(tree, source, target)


def same_source(tree: bpy.types.NodeTree, source: bpy.types.NodeSocket, target: bpy.types.NodeSocket) -> None:
    """Feed `target` with what feeds the input `source`: its link, or its value, grey where only one of them is a colour."""
    if source.is_linked:
        tree.links.new(source.links[0].from_socket, target)
        return
    value, wanted = source.default_value, target.default_value
    if isinstance(wanted, float):
        target.default_value = value if isinstance(value, float) else sum(tuple(value)[:3]) / 3
    elif isinstance(value, float):
        target.default_value = (value,) * 3 + (1.0,) * (len(wanted) - 3)
    else:
        target.default_value = (*tuple(value)[: len(wanted)], *(1.0,) * (len(wanted) - len(value)))


def constant(socket: bpy.types.NodeSocket) -> float | None:
    """The value of an input, None where it is linked."""
    return None if socket.is_linked else float(socket.default_value)


def put(tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket, value: float | tuple) -> None:
    """A constant in place of whatever fed an input."""
    for link in list(socket.links):
        tree.links.remove(link)
    socket.default_value = value


def calculate(tree: bpy.types.NodeTree, operation: str, *sources: Source) -> bpy.types.NodeSocket:
    """A Math node: `ADD`, `MULTIPLY_ADD`, `EXPONENT`, ..."""
    node = tree.nodes.new("ShaderNodeMath")
    node.operation = operation
    for source, target in zip(sources, node.inputs, strict=False):
        feed(tree, source, target)
    return node.outputs[0]


def product(tree: bpy.types.NodeTree, *sources: Source) -> Source:
    """Of numbers; constants are multiplied here, and 1 costs no node."""
    known, rest = 1.0, []
    for source in sources:
        if isinstance(source, int | float):
            known *= source
        else:
            rest.append(source)
    result: Source = known if known != 1.0 or not rest else rest.pop(0)
    for source in rest:
        result = calculate(tree, "MULTIPLY", result, source)
    return result


def one_minus(tree: bpy.types.NodeTree, source: Source) -> Source:
    return 1.0 - source if isinstance(source, int | float) else calculate(tree, "SUBTRACT", 1.0, source)


def polynomial(tree: bpy.types.NodeTree, coefficients: tuple[float, ...], x: Source) -> Source:
    """c0 + c1 x + c2 x^2 ..., by Horner's rule; a number where x is one."""
    if isinstance(x, int | float):
        return float(sum(c * x**k for k, c in enumerate(coefficients)))
    result: Source = coefficients[-1]
    for c in reversed(coefficients[:-1]):
        result = calculate(tree, "MULTIPLY_ADD", result, x, c)
    return result


def scaled(tree: bpy.types.NodeTree, vector: bpy.types.NodeSocket, factor: Source) -> bpy.types.NodeSocket:
    """A colour times a number."""
    if isinstance(factor, int | float) and factor == 1.0:
        return vector
    node = tree.nodes.new("ShaderNodeVectorMath")
    node.operation = "SCALE"
    feed(tree, vector, node.inputs[0])
    feed(tree, factor, node.inputs["Scale"])
    return node.outputs[0]


def vectors(tree: bpy.types.NodeTree, operation: str, *sources: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
    """A Vector Math node on colours: `ADD`, `MULTIPLY`."""
    node = tree.nodes.new("ShaderNodeVectorMath")
    node.operation = operation
    for source, target in zip(sources, node.inputs, strict=False):
        feed(tree, source, target)
    return node.outputs[0]
