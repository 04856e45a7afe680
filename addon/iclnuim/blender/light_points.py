"""Irradiance at any points of the open scene, by Cycles' own baking.

A target of one tiny white triangle a point, which no ray can meet, is baked into a list of pixels. So the points are exactly
the ones asked for, whatever meshes, UV maps and materials the scene has, and both sides of a sheet can be asked for.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout

import bpy
import numpy as np

from ..errors import WorkError

#: Points lie this far in front of their surface, so that a ray from one cannot meet the surface itself.
LIFT_M = 2e-4
_TRIANGLE_M = 5e-5
_ROW = 1024
#: As many points as one target takes: about 0.7 GB in Blender.
AT_ONCE = 1 << 20


@contextmanager
def kept(thing: object, **settings: object) -> Iterator[None]:
    """Settings of a Blender struct for a while; those that this version lacks are left out."""
    before = {name: getattr(thing, name) for name in settings if hasattr(thing, name)}
    try:
        for name in before:
            setattr(thing, name, settings[name])
        yield
    finally:
        for name, value in before.items():
            setattr(thing, name, value)


class Target:
    """Points (n, 3) in metres with unit normals (n, 3), in the open scene for as long as the `with` block lasts."""

    def __init__(self, points_m: np.ndarray, normals: np.ndarray) -> None:
        self.count = len(points_m)
        self.rows = -(-self.count // _ROW)
        self.image = bpy.data.images.new("light points", _ROW, self.rows, float_buffer=True, is_data=True)
        self.material = _white(self.image)
        self.mesh = _target_mesh(points_m, normals, self.rows)
        self.mesh.materials.append(self.material)
        self.object = bpy.data.objects.new("light points", self.mesh)
        for ray in ("diffuse", "glossy", "transmission", "volume_scatter", "shadow"):
            setattr(
                self.object, f"visible_{ray}", False
            )  # camera rays may see it: baking sends none, and needs one kind that does

    def __enter__(self) -> Target:
        bpy.context.scene.collection.objects.link(self.object)
        return self

    def __exit__(self, *_: object) -> None:
        bpy.data.objects.remove(self.object)
        bpy.data.meshes.remove(self.mesh)
        bpy.data.materials.remove(self.material)
        bpy.data.images.remove(self.image)

    def irradiance(self, samples: int, seed: int, max_bounces: int = 0) -> np.ndarray:
        """(n, 3) light on a white surface at each point, as the radiance that it sends back: what lamps, world and glowing
        surfaces give, and what comes by way of up to max_bounces others. Raises WorkError where Cycles fails.
        """
        scene = bpy.context.scene
        with (
            kept(
                scene.cycles,
                samples=samples,
                seed=seed,
                use_animated_seed=False,
                use_adaptive_sampling=False,
                sample_offset=0,
                time_limit=0.0,
                max_bounces=max_bounces,
                light_sampling_threshold=0.0,
                use_denoising=False,
            ),
            kept(scene.render, engine="CYCLES", use_persistent_data=False),
            kept(
                scene.render.bake,
                use_pass_direct=True,
                use_pass_indirect=True,
                use_pass_color=False,
                margin=0,
                use_clear=True,
                target="IMAGE_TEXTURES",
                use_selected_to_active=False,
                use_multires=False,
                use_split_materials=False,
                view_from="ABOVE_SURFACE",
            ),
        ):
            _run_bake(self.object)
        pixels = np.empty(self.rows * _ROW * 4, np.float32)
        self.image.pixels.foreach_get(pixels)
        return pixels.reshape(-1, 4)[: self.count, :3]


def batches(count: int) -> list[slice]:
    """Slices of at most AT_ONCE points."""
    return [slice(first, min(first + AT_ONCE, count)) for first in range(0, count, AT_ONCE)]


def _run_bake(target: bpy.types.Object) -> None:
    layer = bpy.context.view_layer
    layer.update()  # else an object that was just linked may not be among its objects yet
    for thing in layer.objects:
        thing.select_set(thing == target)
    layer.objects.active = target
    try:
        with redirect_stdout(io.StringIO()):  # where Blender says each time that the image is not saved
            result = bpy.ops.object.bake(type="DIFFUSE", pass_filter={"DIRECT", "INDIRECT"})
    except RuntimeError as error:
        raise WorkError(f"light map: Blender: {' '.join(str(error).split())}") from None
    if result != {"FINISHED"}:
        raise WorkError("light map: Blender stopped baking")


def _white(image: bpy.types.Image) -> bpy.types.Material:
    """White diffuse, with the image that Blender bakes into as its active node."""
    material = bpy.data.materials.new("light points")
    if material.node_tree is None:
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    output, diffuse, texture = (tree.nodes.new(f"ShaderNode{n}") for n in ("OutputMaterial", "BsdfDiffuse", "TexImage"))
    diffuse.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    texture.image = image
    tree.nodes.active = texture
    return material


def _target_mesh(points_m: np.ndarray, normals: np.ndarray, rows: int) -> bpy.types.Mesh:
    """One triangle a point, facing along its normal; its texture triangle covers the centre of the point's own pixel only."""
    n = len(points_m)
    side = np.where(np.abs(normals[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    x = np.cross(side, normals)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross(normals, x)
    turn = np.array([0, 2, 4]) * np.pi / 3
    around = np.cos(turn)[:, None] * x[:, None] + np.sin(turn)[:, None] * y[:, None]
    corners = (points_m + LIFT_M * normals)[:, None] + _TRIANGLE_M * around
    pixel = np.stack([np.arange(n) % _ROW, np.arange(n) // _ROW], -1) + 0.5
    uv = (pixel[:, None] + 0.45 * np.stack([np.cos(turn), np.sin(turn)], -1)) / [_ROW, rows]
    return _mesh(corners.reshape(-1, 3), uv.reshape(-1, 2))


def _mesh(vertices: np.ndarray, uv: np.ndarray) -> bpy.types.Mesh:
    mesh = bpy.data.meshes.new("light points")
    count = len(vertices)
    mesh.vertices.add(count)
    mesh.vertices.foreach_set("co", vertices.astype(np.float32).ravel())
    mesh.loops.add(count)
    mesh.loops.foreach_set("vertex_index", np.arange(count, dtype=np.int32))
    mesh.polygons.add(count // 3)
    mesh.polygons.foreach_set("loop_start", np.arange(0, count, 3, dtype=np.int32))
    mesh.uv_layers.new(name="pixel").data.foreach_set("uv", uv.astype(np.float32).ravel())
    mesh.update(calc_edges=True)
    return mesh
