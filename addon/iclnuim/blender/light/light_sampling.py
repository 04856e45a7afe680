"""Light at arbitrary points of the open scene, by Cycles' baking: irradiance of each light source,
and whether cameras can see the point.

A target object with one tiny white triangle per point, which no ray can hit, is baked into a list
of pixels. So the points are exactly the requested ones, whatever meshes, UV maps and materials the
scene has, and both sides of a sheet can be sampled.

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
from mathutils import Vector

from ...geometry.points import farthest_points
from ...lightmap.surfaces import Surfaces
from .. import compat
from ..compat import temporarily
from ..sky import gives_light, sampled_at_image_size
from ..surfaces import rendered_lamps

#: Distance of points from their surface, so that a ray from the point cannot hit the surface
#: itself.
LIFT_M = 2e-4
_TRIANGLE_M = 5e-5
_ROW = 1024
#: Maximum number of points of a target: about 0.7 GB in Blender.
AT_ONCE = 1 << 20
#: Maximum number of passes; if there are more lamps, they share passes.
_PASSES = 12
#: A lamp is small if its radius is below this; a sun, if its angle in radians is below this.
_SMALL_M, _SMALL_RAD = 0.15, 0.1
#: The number of samples is divided by this for a small lamp.
_SMALL_SHARE = 8
#: If there are more large lamps than this, they share the samples of this number of lamps: each
#: contributes a smaller part of the light.
_LARGE = 3
#: A place is in free space if less than this share of its rays ends at the back of a surface.
_BACKS = 0.1
#: Free places are used if at least this share of the rays of the most enclosed place hits surfaces:
#: they are inside rooms, if there are any. If less than half of the places qualify, the scene is
#: open and these few are niches: then the second, lower share is used.
_ENCLOSED, _IN_THE_OPEN = 0.9, 0.25
_RAYS = 48
_NEAREST_M, _FARTHEST_M = 0.1, 4.0
#: Samples of a point in the rounds of `seen`; the second is for points without light after the
#: first.
_TESTS = (4, 64)
#: Power of test lamps (W), and the radiance that separates their light from that of emitting
#: surfaces, which baking cannot exclude.
_POWER, _GLOW = 1e9, 1e4
#: Cycles' settings for all direct light: a fixed number of samples, no bounces.
_CYCLES = {
    "use_animated_seed": False, "use_adaptive_sampling": False, "sample_offset": 0, "time_limit": 0.0, "max_bounces": 0,
    "light_sampling_threshold": 0.0, "use_denoising": False,
}  # fmt: skip
_BAKE = {
    "use_pass_direct": True, "use_pass_indirect": True, "use_pass_color": False, "margin": 0, "use_clear": True,
    "target": "IMAGE_TEXTURES", "use_selected_to_active": False, "use_multires": False, "use_split_materials": False,
    "view_from": "ABOVE_SURFACE",
}  # fmt: skip


def direct(
    points_m: np.ndarray,
    normals: np.ndarray,
    samples: int,
    seed: int,
    materials: list[bpy.types.Material],
    sky: bool = True,
    together: bool = False,
) -> np.ndarray:
    """(2, n, 3) direct light from lamps and, with `sky`, from the sky, by two independent halves of
    the samples, without the emission of `materials`.

    together: all lamps share one pass, which is faster and noisier.
    """
    lamps, portals = _sources()
    passes = (
        [_Pass(lamps, False, max(1, samples // 2))]
        if together and lamps
        else _lamp_passes(lamps, samples // 2)
    )
    if sky and gives_light(bpy.context.scene.world):
        passes.append(_Pass(portals, True, max(1, samples // 2)))
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
    sky = sky and gives_light(bpy.context.scene.world)
    return _sampled(
        points_m, normals, [_Pass(_sources()[1] if sky else [], sky, max(1, samples // 2), seed)]
    )


@dataclass(frozen=True)
class _Pass:
    """Lamps, whether the world emits light, samples of each half, whether each lamp gets the same
    number of samples, and the seed.
    """

    lamps: list[bpy.types.Object]
    world: bool
    samples: int
    seed: int = 0
    evenly: bool = False


def _sampled(points_m: np.ndarray, normals: np.ndarray, passes: list[_Pass]) -> np.ndarray:
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


def _sources() -> tuple[list[bpy.types.Object], list[bpy.types.Object]]:
    """The lamps, and the portals, through which the sky is sampled.

    Lamps without light are left out, as Cycles gives them no samples.
    """
    lamps = rendered_lamps(bpy.context.scene)
    portals = [lamp for lamp in lamps if lamp.data.type == "AREA" and lamp.data.cycles.is_portal]
    shining = [lamp for lamp in lamps if lamp.data.energy != 0 and any(lamp.data.color)]
    return [lamp for lamp in shining if lamp not in portals], portals


def _lamp_passes(lamps: list[bpy.types.Object], samples: int) -> list[_Pass]:
    """The passes for all lamps, without seeds. samples: those of each half for a large lamp, if
    there are few.
    """
    together = [lamps[first::_PASSES] for first in range(min(_PASSES, len(lamps)))]
    crowds = [group for group in together if len(group) > 1]
    single = [group[0] for group in together if len(group) == 1]
    small = [lamp for lamp in single if _is_small(lamp.data)]
    large = [lamp for lamp in single if not _is_small(lamp.data)]
    share = max(1, -(-(len(large) + len(crowds)) // _LARGE))
    for_small, for_large = max(1, samples // _SMALL_SHARE), max(1, samples // share)
    sharing = {for_small: small}
    if for_large == 1:  # a single sample of a lamp is not stratified in any case
        sharing[1], large = [*sharing.get(1, []), *large], []
    evenly = [(some, each) for each, of in sharing.items() for some in _powers_of_two(of)]
    return [
        *(_Pass(some, False, each * len(some), evenly=True) for some, each in evenly),
        *(_Pass([lamp], False, for_large) for lamp in large),
        *(_Pass(crowd, False, for_large) for crowd in crowds),
    ]


def _powers_of_two(lamps: list[bpy.types.Object]) -> list[list[bpy.types.Object]]:
    """The lamps in lists whose lengths are powers of two, longest first."""
    lists = []
    while lamps:
        count = 1 << (len(lamps).bit_length() - 1)
        lists.append(lamps[:count])
        lamps = lamps[count:]
    return lists


def _is_small(lamp: bpy.types.Light) -> bool:
    if lamp.type == "SUN":
        return lamp.angle < _SMALL_RAD
    return lamp.type != "AREA" and lamp.shadow_soft_size < _SMALL_M


@contextmanager
def only(lamps: list[bpy.types.Object], world: bool, evenly: bool = False) -> Iterator[None]:
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
        stack.enter_context(
            sampled_at_image_size(scene.world) if world else temporarily(scene, world=None)
        )
        yield


@contextmanager
def without_glow(materials: list[bpy.types.Material]) -> Iterator[None]:
    """Disable the emission of the materials temporarily."""
    trees = [material.node_tree for material in materials if material.node_tree is not None]
    with ExitStack() as stack:
        for node in (node for tree in trees for node in compat.nodes_of(tree)):
            if node.type == "EMISSION":
                stack.enter_context(temporarily(node, mute=True))
            elif node.type == "BSDF_PRINCIPLED":
                strength = node.inputs["Emission Strength"]
                stack.enter_context(temporarily(strength, default_value=0.0))
                for link in strength.links:
                    stack.enter_context(temporarily(link, is_muted=True))
        yield


def viewpoints(
    depsgraph: bpy.types.Depsgraph, surfaces: Surfaces, count: int, seed: int
) -> np.ndarray:
    """(up to count, 3) places in metres distributed over the scene's free space: in rooms, not
    inside solids or behind walls.
    """
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(_RAYS, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    places = [_place_before(depsgraph, surfaces, rng) for _ in range(count * 24)]
    hits = np.array([_front_hits(depsgraph, p, directions) for p in places])
    enclosed = hits[hits > 0] >= _ENCLOSED * hits.max()
    share = _ENCLOSED if enclosed.sum() >= enclosed.size / 2 else _IN_THE_OPEN
    free = np.array(places)[(hits > 0) & (hits >= share * hits.max())]
    lamps = [
        lamp.matrix_world.translation
        for lamp in rendered_lamps(bpy.context.scene)
        if lamp.data.type != "SUN"
    ]
    if lamps and not any(_sees_one(depsgraph, place, lamps) for place in free):
        # the normals of the walls may point outward: then places with a view of a lamp are inside
        # the room
        seeing = [place for place in places if _sees_one(depsgraph, place, lamps)]
        free = np.concatenate([free, seeing or np.zeros((0, 3))])
    return free if len(free) <= count else farthest_points(free, count)


def _place_before(
    depsgraph: bpy.types.Depsgraph, surfaces: Surfaces, rng: np.random.Generator
) -> np.ndarray:
    """A random place on a ray from a random triangle, in front of it or behind it; each object has
    the same probability.
    """
    faces = np.searchsorted(
        surfaces.face_object, [k := rng.integers(surfaces.face_object[-1] + 1), k + 1]
    )
    rows = np.searchsorted(surfaces.triangle_face, faces)
    corners = surfaces.corners_m[surfaces.triangles[rng.integers(*rows)]]
    ray = rng.normal(size=3)
    ray /= np.linalg.norm(ray)
    start = rng.dirichlet(np.ones(3)) @ corners + 1e-3 * ray
    hit, location, *_ = depsgraph.scene.ray_cast(
        depsgraph, Vector(start), Vector(ray), distance=_FARTHEST_M
    )
    reach = np.linalg.norm(np.array(location) - start) if hit else _FARTHEST_M
    return start + rng.uniform(0.1, 0.9) * reach * ray


def _sees_one(depsgraph: bpy.types.Depsgraph, place: np.ndarray, lamps: list[Vector]) -> bool:
    """Whether at least one lamp is visible from the place, and no surface is close to the place."""
    scene, origin = depsgraph.scene, Vector(place)
    around = np.vstack([np.eye(3), -np.eye(3)])
    if any(
        scene.ray_cast(depsgraph, origin, Vector(direction), distance=_NEAREST_M)[0]
        for direction in around
    ):
        return False
    directions = [(lamp - origin) for lamp in lamps]
    return not all(
        scene.ray_cast(depsgraph, origin, direction, distance=direction.length)[0]
        for direction in directions
        if direction.length > 0
    )


def _front_hits(depsgraph: bpy.types.Depsgraph, place: np.ndarray, directions: np.ndarray) -> int:
    """The number of rays that end at the front of a surface; 0 for a place that is not in free
    space.
    """
    scene, origin = depsgraph.scene, Vector(place)
    backs = fronts = 0
    for direction in directions:
        hit, location, normal, *_ = scene.ray_cast(depsgraph, origin, Vector(direction))
        if hit and (location - origin).length < _NEAREST_M:
            return 0
        back = hit and normal.dot(Vector(direction)) > 0
        backs, fronts = backs + back, fronts + (hit and not back)
        if backs > _BACKS * _RAYS:
            return 0
    return fronts


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
def _only_lamps(scene: bpy.types.Scene, places_m: np.ndarray) -> Iterator[None]:
    """The scene lit only by one point lamp at each place, temporarily."""
    data = bpy.data.lights.new("light test", "POINT")
    data.energy, data.shadow_soft_size = _POWER, 0.0
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


@contextmanager
def target(points_m: np.ndarray, normals: np.ndarray) -> Iterator[Callable[[int, int], np.ndarray]]:
    """Adds a target at points (n, 3) in metres with unit normals (n, 3) to the open scene, until
    the end of the `with` block.

    Yields a function `irradiance(samples, seed)`: (n, 3) direct light from lamps, world and
    emitting surfaces on a white surface at each point, as the radiance that it reflects. It raises
    WorkError if Cycles fails.
    """
    scene, count = bpy.context.scene, len(points_m)
    rows = -(-count // _ROW)
    image = bpy.data.images.new("light points", _ROW, rows, float_buffer=True, is_data=True)
    material, _ = compat.matt_material("light points", (1.0, 1.0, 1.0, 1.0))
    texture = material.node_tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    material.node_tree.nodes.active = texture  # the one that Blender bakes into
    mesh = _target_mesh(points_m, normals, rows)
    mesh.materials.append(material)
    thing = bpy.data.objects.new("light map", mesh)
    # it stays visible to camera rays: baking sends none, but requires visibility to one kind of ray
    for ray in ("diffuse", "glossy", "transmission", "volume_scatter", "shadow"):
        setattr(thing, f"visible_{ray}", False)
    scene.collection.objects.link(thing)

    def irradiance(samples: int, seed: int) -> np.ndarray:
        with (
            temporarily(scene.cycles, samples=samples, seed=seed, **_CYCLES),
            temporarily(scene.render, engine="CYCLES", use_persistent_data=False),
            temporarily(scene.render.bake, **_BAKE),
        ):
            compat.bake(thing, type="DIFFUSE", pass_filter={"DIRECT", "INDIRECT"})
        pixels = np.empty(rows * _ROW * 4, np.float32)
        image.pixels.foreach_get(pixels)
        return pixels.reshape(-1, 4)[:count, :3]

    try:
        yield irradiance
    finally:
        bpy.data.batch_remove([thing, mesh, material, image])


def batches(count: int, at_once: int = AT_ONCE) -> list[slice]:
    """Slices of at most `at_once` points."""
    return [slice(first, min(first + at_once, count)) for first in range(0, count, at_once)]


def _target_mesh(points_m: np.ndarray, normals: np.ndarray, rows: int) -> bpy.types.Mesh:
    """One triangle per point, facing along its normal.

    Its texture triangle covers only the centre of the point's own pixel.
    """
    n = len(points_m)
    side = np.where(np.abs(normals[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    x = np.cross(side, normals)
    x /= np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-12)
    y = np.cross(normals, x)
    angle = np.array([0, 2, 4]) * np.pi / 3
    around = np.cos(angle)[:, None] * x[:, None] + np.sin(angle)[:, None] * y[:, None]
    corners = (points_m + LIFT_M * normals)[:, None] + _TRIANGLE_M * around
    pixel = np.stack([np.arange(n) % _ROW, np.arange(n) // _ROW], -1) + 0.5
    uv = (pixel[:, None] + 0.45 * np.stack([np.cos(angle), np.sin(angle)], -1)) / [_ROW, rows]
    mesh, count = bpy.data.meshes.new("light points"), 3 * n
    mesh.vertices.add(count)
    mesh.vertices.foreach_set("co", corners.astype(np.float32).ravel())
    mesh.loops.add(count)
    mesh.loops.foreach_set("vertex_index", np.arange(count, dtype=np.int32))
    mesh.polygons.add(n)
    mesh.polygons.foreach_set("loop_start", np.arange(0, count, 3, dtype=np.int32))
    mesh.uv_layers.new(name="pixel").data.foreach_set("uv", uv.astype(np.float32).ravel())
    mesh.update(calc_edges=True)
    return mesh
