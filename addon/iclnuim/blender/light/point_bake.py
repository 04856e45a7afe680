"""Light at arbitrary points of the open scene, by Cycles' baking.

A target object with one tiny white triangle per point, which no ray can hit, is baked into a list
of pixels. So the points are exactly the requested ones, whatever meshes, UV maps and materials the
scene has, and both sides of a sheet can be sampled.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import bpy
import numpy as np

from .. import compat
from ..compat import temporarily

#: Distance of points from their surface, so that a ray from the point cannot hit the surface
#: itself.
LIFT_M = 2e-4
#: Radius of a point's triangle: smaller than that distance, larger than float32 resolves 100 m from
#: the origin.
_TRIANGLE_M = 5e-5
#: Pixels in a row of the image that is baked into.
_ROW = 1024
#: Maximum number of points of a target: about 0.7 GB in Blender.
AT_ONCE = 1 << 20
#: Cycles' settings for all direct light: a fixed number of samples, no bounces.
_CYCLES = {
    "use_animated_seed": False,
    "use_adaptive_sampling": False,
    "sample_offset": 0,
    "time_limit": 0.0,
    "max_bounces": 0,
    "light_sampling_threshold": 0.0,
    "use_denoising": False,
}
_BAKE = {
    "use_pass_direct": True,
    "use_pass_indirect": True,
    "use_pass_color": False,
    "margin": 0,
    "use_clear": True,
    "target": "IMAGE_TEXTURES",
    "use_selected_to_active": False,
    "use_multires": False,
    "use_split_materials": False,
    "view_from": "ABOVE_SURFACE",
}


@contextmanager
def target(points_m: np.ndarray, normals: np.ndarray) -> Iterator[Callable[[int, int], np.ndarray]]:
    """Adds a target at points (n, 3) in metres with unit normals (n, 3) to the open scene, until
    the end of the `with` block.

    Yields a function `irradiance(samples, seed)`: (n, 3) direct light from lamps, world and
    emitting surfaces on a white surface at each point, as the radiance that it reflects. It raises
    WorkError if Cycles fails.
    """
    scene = bpy.context.scene
    count = len(points_m)
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
    mesh = bpy.data.meshes.new("light points")
    mesh.vertices.add(3 * n)
    mesh.vertices.foreach_set("co", corners.astype(np.float32).ravel())
    mesh.loops.add(3 * n)
    mesh.loops.foreach_set("vertex_index", np.arange(3 * n, dtype=np.int32))
    mesh.polygons.add(n)
    mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * n, 3, dtype=np.int32))
    mesh.uv_layers.new(name="pixel").data.foreach_set("uv", uv.astype(np.float32).ravel())
    mesh.update(calc_edges=True)
    return mesh
