"""Arithmetic in shader node trees: each function adds nodes and returns the result's socket."""

import math
from typing import TypeAlias

from bpy.types import Node, NodeSocket, NodeTree

from .compat import unlink

#: A source for a node's input: a constant, an output, or another input, whose link or value is
#: used.
Source: TypeAlias = float | tuple[float, ...] | NodeSocket


def feed(tree: NodeTree, source: Source, target: NodeSocket) -> None:
    """Connect `target` to an output, set it to a constant, or copy the link or value of another
    input; colours and numbers are converted.
    """
    if isinstance(source, NodeSocket) and (source.is_output or source.is_linked):
        tree.links.new(source if source.is_output else source.links[0].from_socket, target)
        return
    value = source.default_value if isinstance(source, NodeSocket) else source
    wanted = target.default_value
    if isinstance(wanted, int | float):  # in bpy 5.2 this includes booleans
        if not isinstance(value, int | float):
            value = sum(tuple(value)[:3]) / 3
        target.default_value = value
    elif isinstance(value, int | float):
        target.default_value = (value,) * 3 + (1.0,) * (len(wanted) - 3)
    else:
        target.default_value = (*tuple(value)[: len(wanted)], *(1.0,) * (len(wanted) - len(value)))


def set_constant(socket: NodeSocket, value: float | tuple) -> None:
    """Unlink an input and set it to a constant."""
    unlink(socket)
    socket.default_value = value


def constant(socket: NodeSocket) -> float | None:
    """The value of an input, None if it is linked."""
    return None if socket.is_linked else float(socket.default_value)


def constant_or_input(node: Node, name: str) -> Source:
    value = constant(node.inputs[name])
    return node.inputs[name] if value is None else value


def add_node(tree: NodeTree, kind: str, *sources: Source, **settings: object) -> NodeSocket:
    """Add a node whose first inputs get the sources. Returns its first output."""
    node = tree.nodes.new(f"ShaderNode{kind}")
    for name, value in settings.items():
        setattr(node, name, value)
    for source, target in zip(sources, node.inputs, strict=False):
        feed(tree, source, target)
    return node.outputs[0]


def calculate(tree: NodeTree, operation: str, *sources: Source) -> NodeSocket:
    """A Math node: `ADD`, `MULTIPLY_ADD`, `EXPONENT`, ..."""
    return add_node(tree, "Math", *sources, operation=operation)


def vectors(tree: NodeTree, operation: str, *sources: Source) -> NodeSocket:
    """A Vector Math node on colours: `ADD`, `MULTIPLY`."""
    return add_node(tree, "VectorMath", *sources, operation=operation)


def scaled(tree: NodeTree, vector: Source, factor: Source) -> Source:
    """A colour times a number."""
    if isinstance(factor, int | float) and factor == 1.0:
        return vector
    result = vectors(tree, "SCALE", vector)
    feed(tree, factor, result.node.inputs["Scale"])
    return result


def product(tree: NodeTree, *sources: Source) -> Source:
    """The product of numbers. Constants are multiplied directly; a factor of 1 adds no node."""
    known = math.prod(s for s in sources if isinstance(s, int | float))
    rest = [s for s in sources if not isinstance(s, int | float)]
    result: Source = known if known != 1.0 or not rest else rest.pop(0)
    for source in rest:
        result = calculate(tree, "MULTIPLY", result, source)
    return result


def one_minus(tree: NodeTree, source: Source) -> Source:
    if isinstance(source, int | float):
        return 1.0 - source
    return calculate(tree, "SUBTRACT", 1.0, source)


def polynomial(tree: NodeTree, coefficients: tuple[float, ...], x: Source) -> Source:
    """c0 + c1 x + c2 x^2 ..., by Horner's rule; a number if x is a number."""
    if isinstance(x, int | float):
        return float(sum(c * x**k for k, c in enumerate(coefficients)))
    result: Source = coefficients[-1]
    for c in reversed(coefficients[:-1]):
        result = calculate(tree, "MULTIPLY_ADD", result, x, c)
    return result
