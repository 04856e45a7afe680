"""Light of each light source on points of the open scene, and whether cameras can see the points.

Light sources are sampled one after another: the lamps, the sky, then the light from lit surfaces.
Lamps sampled together usually give far more noise than separate ones: with a single lamp a sample
is wasted only in its penumbra. So small lamps need few samples; windows, skies and surfaces need
many. A power of two of small lamps can share a pass without more noise: each gets the same number
of a point's samples, because Cycles' samples are stratified in powers of two. Large lamps can do so
only if each has a single sample: several samples on one lamp are stratified less in a shared pass.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace

import bpy
import numpy as np
from bpy.types import Light, Material, Object, Scene

from .. import compat
from ..compat import temporarily
from ..sky import gives_light, sampled_at_image_size
from ..surfaces import rendered_objects
from .point_bake import AT_ONCE, batches, target

#: Maximum number of passes; if there are more lamps, they share passes.
_PASSES = 12
#: A lamp is small if its radius is below this; a sun, if its angle in radians is below this: their
#: penumbra is then a small part of what they light.
_SMALL_M = 0.15
_SMALL_RAD = 0.1
#: The number of samples is divided by this for a small lamp.
_SMALL_SHARE = 8
#: If there are more large lamps than this, they share the samples of this number of lamps: each
#: contributes a smaller part of the light.
_LARGE = 3
#: Samples of a point in the rounds of `seen`; the second is for points without light after the
#: first.
_TESTS = (4, 64)
#: Power of test lamps (W), and the radiance that separates their light from that of emitting
#: surfaces, which baking cannot exclude.
_POWER = 1e9
_GLOW = 1e4


@dataclass(frozen=True)
class _BakePass:
    """Lamps, whether the world emits light, samples of each half, whether each lamp gets the same
    number of samples, and the seed.
    """

    lamps: list[Object]
    world: bool
    samples: int
    seed: int = 0
    evenly: bool = False


def direct(
    points_m: np.ndarray,
    normals: np.ndarray,
    samples: int,
    seed: int,
    materials: list[Material],
    sky: bool = True,
    together: bool = False,
) -> np.ndarray:
    """(2, n, 3) direct light from lamps and, with `sky`, from the sky, by two independent halves of
    the samples, without the emission of `materials`.

    together: all lamps share one pass, which is faster and noisier.
    """
    lamps, portals = _sources()
    each_half = max(1, samples // 2)
    if together and lamps:
        passes = [_BakePass(lamps, False, each_half)]
    else:
        passes = _lamp_passes(lamps, samples // 2)
    if sky and gives_light(bpy.context.scene.world):
        passes.append(_BakePass(portals, True, each_half))
    passes = [replace(one, seed=seed + 100 * number) for number, one in enumerate(passes)]
    with without_glow(materials):
        return _sampled(points_m, normals, passes)


def gathered(
    points_m: np.ndarray, normals: np.ndarray, samples: int, seed: int, sky: bool = False
) -> np.ndarray:
    """(2, n, 3) light from the surfaces of the open scene, by two halves of the samples: their
    emission, including baked light shown as emission.

    With `sky`, also that of the sky, for which the same rays are used.
    """
    each_half = max(1, samples // 2)
    one = _BakePass([], False, each_half, seed)
    if sky and gives_light(bpy.context.scene.world):
        _, portals = _sources()
        one = _BakePass(portals, True, each_half, seed)
    return _sampled(points_m, normals, [one])


def _sampled(points_m: np.ndarray, normals: np.ndarray, passes: list[_BakePass]) -> np.ndarray:
    """(2, n, 3) the sum of the passes, by two halves of the samples.

    Both are baked at once, as different points in the same place.
    """
    light = np.zeros((2, len(points_m), 3), np.float32)
    for part in batches(len(points_m), AT_ONCE // 2):
        with target(np.tile(points_m[part], (2, 1)), np.tile(normals[part], (2, 1))) as irradiance:
            for one in passes:
                with only(one.lamps, one.world, one.evenly):
                    light[:, part] += irradiance(one.samples, one.seed).reshape(2, -1, 3)
    return light


def _sources() -> tuple[list[Object], list[Object]]:
    """The lamps, and the portals, through which the sky is sampled.

    Lamps without light are left out, as Cycles gives them no samples.
    """
    lamps = rendered_objects(bpy.context.scene, {"LIGHT"})
    portals = [lamp for lamp in lamps if lamp.data.type == "AREA" and lamp.data.cycles.is_portal]
    shining = [lamp for lamp in lamps if lamp.data.energy != 0 and any(lamp.data.color)]
    return [lamp for lamp in shining if lamp not in portals], portals


def _lamp_passes(lamps: list[Object], samples: int) -> list[_BakePass]:
    """The passes for all lamps, without seeds. samples: those of each half for a large lamp, if
    there are few.
    """
    together = [lamps[first::_PASSES] for first in range(min(_PASSES, len(lamps)))]
    crowds = [group for group in together if len(group) > 1]
    single = [group[0] for group in together if len(group) == 1]
    small = [lamp for lamp in single if _is_small(lamp.data)]
    large = [lamp for lamp in single if not _is_small(lamp.data)]
    share = max(1, -(-(len(large) + len(crowds)) // _LARGE))
    for_small = max(1, samples // _SMALL_SHARE)
    for_large = max(1, samples // share)
    sharing = {for_small: small}
    if for_large == 1:  # a single sample of a lamp is not stratified in any case
        sharing[1] = [*sharing.get(1, []), *large]
        large = []
    passes = []
    for each, group in sharing.items():
        for some in _powers_of_two(group):
            passes.append(_BakePass(some, False, each * len(some), evenly=True))
    passes += [_BakePass([lamp], False, for_large) for lamp in large]
    passes += [_BakePass(crowd, False, for_large) for crowd in crowds]
    return passes


def _powers_of_two(lamps: list[Object]) -> list[list[Object]]:
    """The lamps in lists whose lengths are powers of two, longest first."""
    lists = []
    while lamps:
        count = 1 << (len(lamps).bit_length() - 1)
        lists.append(lamps[:count])
        lamps = lamps[count:]
    return lists


def _is_small(lamp: Light) -> bool:
    if lamp.type == "SUN":
        return lamp.angle < _SMALL_RAD
    return lamp.type != "AREA" and lamp.shadow_soft_size < _SMALL_M


@contextmanager
def only(lamps: list[Object], world: bool, evenly: bool = False) -> Iterator[None]:
    """The open scene with only these lamps, with or without its world, temporarily. evenly: without
    the light tree, which prefers strong lamps.
    """
    scene = bpy.context.scene
    with ExitStack() as stack:
        for thing in scene.objects:
            if thing.type == "LIGHT" and thing not in lamps:
                stack.enter_context(temporarily(thing, hide_render=True))
        if evenly:
            stack.enter_context(temporarily(scene.cycles, use_light_tree=False))
        if world:
            stack.enter_context(sampled_at_image_size(scene.world))
        else:
            stack.enter_context(temporarily(scene, world=None))
        yield


@contextmanager
def without_glow(materials: list[Material]) -> Iterator[None]:
    """Disable the emission of the materials temporarily."""
    with ExitStack() as stack:
        for material in materials:
            for node in compat.nodes_of(material.node_tree) if material.node_tree else ():
                if node.type == "EMISSION":
                    stack.enter_context(temporarily(node, mute=True))
                elif node.type == "BSDF_PRINCIPLED":
                    strength = node.inputs["Emission Strength"]
                    stack.enter_context(temporarily(strength, default_value=0.0))
                    for link in strength.links:
                        stack.enter_context(temporarily(link, is_muted=True))
        yield


def seen(
    points_m: np.ndarray,
    normals: np.ndarray,
    places_m: np.ndarray,
    seed: int,
    hidden: Callable[[np.ndarray], np.ndarray] | None = None,
) -> np.ndarray:
    """(n,) light of point lamps at the places on each point; 0 if no light reaches its front. Light
    passes through glass.

    This light decreases with distance and angle like the number of pixels that a surface fills in
    the images of cameras at these places. Cycles distributes the samples of a point evenly over the
    lamps, so that one sample for each place finds nearly all visible points.

    hidden: from the points that a few samples found, (n,) bool, those of the others that need no
    more samples.
    """
    light = np.zeros(len(points_m), np.float32)
    if not len(places_m):
        return light + 1
    with _only_lamps(bpy.context.scene, places_m):
        for repeat, samples in enumerate(_TESTS):
            dark = light == 0
            if repeat and hidden is not None:
                dark &= ~hidden(~dark)
            dark = np.flatnonzero(dark)
            for part in batches(len(dark)):
                rows = dark[part]
                with target(points_m[rows], normals[rows]) as irradiance:
                    light[rows] = irradiance(samples, seed + repeat).max(1)
            light[light < _GLOW] = 0.0
    return light


@contextmanager
def _only_lamps(scene: Scene, places_m: np.ndarray) -> Iterator[None]:
    """The scene lit only by one point lamp at each place, temporarily."""
    data = bpy.data.lights.new("light test", "POINT")
    data.energy = _POWER
    data.shadow_soft_size = 0.0
    lamps = [bpy.data.objects.new("light test", data) for _ in places_m]
    with only([], world=False, evenly=True):
        for lamp, place in zip(lamps, places_m, strict=True):
            lamp.location = place
            scene.collection.objects.link(lamp)
        try:
            yield
        finally:
            for lamp in lamps:
                bpy.data.objects.remove(lamp)
            bpy.data.lights.remove(data)
