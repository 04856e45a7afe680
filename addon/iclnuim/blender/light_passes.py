"""Light on points, source by source: every lamp alone, the sky, then what the lit surfaces themselves send.

Many lamps sampled together bring far more noise than each one alone: with one lamp a sample is wasted only in its penumbra. So
small lamps need few samples; windows, skies and surfaces need many.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import bpy
import numpy as np

from .light_points import Target, batches, kept

#: Lamps beyond this number share passes.
_PASSES = 12
#: A lamp is small when its radius is below this, a sun when its angle (radians) is.
_SMALL_M, _SMALL_RAD = 0.15, 0.1
#: A small lamp takes this part of the samples.
_SMALL_SHARE = 8
#: More large lamps than this share the samples that so many would take: each is then the smaller part of the light.
_LARGE = 3


@dataclass(frozen=True, eq=False)
class Halves:
    """Light (n, 3) by two independent halves of the samples."""

    a: np.ndarray
    b: np.ndarray

    def __add__(self, other: Halves) -> Halves:
        return Halves(self.a + other.a, self.b + other.b)

    @property
    def mean(self) -> np.ndarray:
        return (self.a + self.b) / 2


def direct(
    points_m: np.ndarray, normals: np.ndarray, samples: int, seed: int, materials: list[bpy.types.Material]
) -> Halves:
    """Light that comes straight from lamps and sky of the open scene; what `materials` emit is left out."""
    light = _nothing(len(points_m))
    with without_glow(materials):
        for part in batches(len(points_m)):
            with Target(points_m[part], normals[part]) as target:
                for number, (lamps, world, share) in enumerate(_sources()):
                    with only(lamps, world):
                        _add(light, part, target, max(1, samples // (2 * share)), seed + 100 * number)
    return light


def gathered(points_m: np.ndarray, normals: np.ndarray, samples: int, seed: int) -> Halves:
    """Light that the surfaces of the open scene send, shown as they glow: by emission, or by baked light."""
    light = _nothing(len(points_m))
    with only([], False):
        for part in batches(len(points_m)):
            with Target(points_m[part], normals[part]) as target:
                _add(light, part, target, max(1, samples // 2), seed)
    return light


def _nothing(count: int) -> Halves:
    return Halves(np.zeros((count, 3), np.float32), np.zeros((count, 3), np.float32))


def _add(light: Halves, part: slice, target: Target, samples: int, seed: int) -> None:
    light.a[part] += target.irradiance(samples, 2 * seed)
    light.b[part] += target.irradiance(samples, 2 * seed + 1)


def _sources() -> list[tuple[list[bpy.types.Object], bool, int]]:
    """Lamps that shine together, whether the sky does, and by how much fewer samples they need."""
    lamps = [thing for thing in bpy.context.scene.objects if thing.type == "LIGHT" and not thing.hide_render]
    portals = [lamp for lamp in lamps if lamp.data.type == "AREA" and lamp.data.cycles.is_portal]
    lamps = [lamp for lamp in lamps if lamp not in portals]
    groups = [lamps[first::_PASSES] for first in range(min(_PASSES, len(lamps)))]
    small = [len(group) == 1 and _is_small(group[0].data) for group in groups]
    large = max(1, -(-small.count(False) // _LARGE))
    found = [(group, False, _SMALL_SHARE if s else large) for group, s in zip(groups, small, strict=True)]
    return [*found, (portals, True, 1)] if bpy.context.scene.world else found


def _is_small(lamp: bpy.types.Light) -> bool:
    if lamp.type == "SUN":
        return lamp.angle < _SMALL_RAD
    return lamp.type != "AREA" and lamp.shadow_soft_size < _SMALL_M


@contextmanager
def only(lamps: list[bpy.types.Object], world: bool) -> Iterator[None]:
    """The open scene with these lamps alone, with or without its world."""
    scene = bpy.context.scene
    with ExitStack() as stack:
        for thing in scene.objects:
            if thing.type == "LIGHT" and thing not in lamps:
                stack.enter_context(kept(thing, hide_render=True))
        if not world:
            stack.enter_context(kept(scene, world=None))
        yield


@contextmanager
def without_glow(materials: list[bpy.types.Material]) -> Iterator[None]:
    """Materials that emit nothing for a while."""
    with ExitStack() as stack:
        for material in materials:
            if material.node_tree is not None:
                _darken(material.node_tree, stack)
        yield


def _darken(tree: bpy.types.NodeTree, stack: ExitStack) -> None:
    for node in tree.nodes:
        if node.type == "EMISSION":
            stack.enter_context(kept(node, mute=True))
        elif node.type == "BSDF_PRINCIPLED":
            strength = node.inputs["Emission Strength"]
            stack.enter_context(kept(strength, default_value=0.0))
            for link in strength.links:
                stack.enter_context(kept(link, is_muted=True))
        elif node.type == "GROUP" and node.node_tree:
            _darken(node.node_tree, stack)
