"""The open scene shown with a light map: every surface replaced by a copy with the map's UVs and baked materials, in memory only."""

from dataclasses import dataclass, field

import bpy
import numpy as np

from ..errors import WorkError
from ..lightmap.surfaces import BACK, FRONT
from . import baked_materials
from .surfaces import Part, array_of, material_of_face

_OBJECT_SETTINGS = (
    "pass_index", "color", "visible_camera", "visible_diffuse", "visible_glossy", "visible_transmission",
    "visible_volume_scatter", "visible_shadow", "is_holdout", "is_shadow_catcher",
)  # fmt: skip
_COLLECTIONS = {"Object": "objects", "Mesh": "meshes", "Material": "materials"}


@dataclass(frozen=True, eq=False)
class MapLayout:
    """Where the corners (C,) of all parts lie in the map: uv (2, C, 2) for front and back, 0..1; has (2, C) which sides do.

    part_corners: how many corners each part has.
    """

    uv: np.ndarray
    has: np.ndarray
    part_corners: tuple[int, ...]


@dataclass(eq=False)
class LitScene:
    """What was added and hidden, so that `revert` can undo it."""

    made: list[bpy.types.ID] = field(default_factory=list)
    hidden: list[tuple[bpy.types.Object, str, bool]] = field(default_factory=list)

    def revert(self) -> None:
        """The scene as it was before."""
        for block in self.made:
            getattr(bpy.data, _COLLECTIONS[block.bl_rna.identifier]).remove(block)
        for thing, name, hide in self.hidden:
            thing.name, thing.hide_render = name, hide
        self.made, self.hidden = [], []


def show(found: list[Part], layout: MapLayout, image: bpy.types.Image, gathering: bool = False) -> LitScene:
    """Show the parts lit by `image`, to a camera or as others gather light from them. Takes over the parts' meshes.

    Raises WorkError where the layout is for another scene."""
    corners = tuple(len(part.mesh.loops) for part in found)
    if corners != layout.part_corners:
        expected = f"a scene of {len(layout.part_corners)} parts as it was baked"
        raise WorkError(f"light map: expected {expected}, found {len(found)} of another shape")
    lit = LitScene()
    materials: dict[tuple, bpy.types.Material] = {}
    starts = np.cumsum((0, *corners))
    _keep_instanced_lamps(lit, {p.origin for p in found if not p.single})
    for part, start in zip(found, starts[:-1], strict=True):
        if not any(part.origin == thing for thing, _, _ in lit.hidden):
            lit.hidden.append((part.origin, part.origin.name, part.origin.hide_render))
            part.origin.hide_render = True
            part.origin.name = part.name + ".unlit" if part.single else part.origin.name
        corners_of_part = slice(start, start + len(part.mesh.loops))
        two_sided = _add_uvs(part.mesh, layout, corners_of_part)
        slots = np.repeat(material_of_face(part), array_of(part.mesh.polygons, "loop_total", 1, np.int32))
        for slot in set(np.unique(slots[layout.has[:, corners_of_part].any(0)])):  # those of which a side is in the map
            original = part.mesh.materials[slot] if slot >= 0 else None
            key = (original, two_sided)
            if key not in materials:
                materials[key] = baked_materials.baked_copy(original, image, two_sided, gathering)
            if slot >= 0:
                part.mesh.materials[slot] = materials[key]
            else:
                part.mesh.materials.append(materials[key])
        thing = bpy.data.objects.new(part.name, part.mesh)
        _copy_settings(part.source, thing)
        thing.matrix_world = part.matrix
        bpy.context.scene.collection.objects.link(thing)
        lit.made.extend([thing, part.mesh])
    lit.made.extend(materials.values())
    return lit


def image_from_pixels(light: np.ndarray) -> bpy.types.Image:
    """A new float image from (rows, columns, 3), row 0 at the bottom."""
    image = bpy.data.images.new("light map", light.shape[1], light.shape[0], float_buffer=True, is_data=True)
    set_pixels(image, light)
    return image


def set_pixels(image: bpy.types.Image, light: np.ndarray) -> None:
    """New light in an image of the same size. A render with persistent data would not see it; baking does."""
    pixels = np.ones((*light.shape[:2], 4), np.float32)
    pixels[..., :3] = light
    image.pixels.foreach_set(pixels.ravel())
    image.update()


def _add_uvs(mesh: bpy.types.Mesh, layout: MapLayout, corners: slice) -> bool:
    """Whether it has two sides. A side without a chart is never seen: it takes the other side's place."""
    two_sided = bool(layout.has[BACK, corners].any())
    for side, name in ((FRONT, baked_materials.FRONT_UV), (BACK, baked_materials.BACK_UV))[: 1 + two_sided]:
        has = layout.has[side, corners]
        uv = np.where(has[:, None], layout.uv[side, corners], layout.uv[1 - side, corners])
        layer = mesh.uv_layers.new(name=name, do_init=False)
        if layer is None:
            raise WorkError(f"light map: the mesh {mesh.name} has no room for one more UV map; remove one")
        layer.data.foreach_set("uv", uv.astype(np.float32).ravel())
    return two_sided


def _copy_settings(source: bpy.types.Object, target: bpy.types.Object) -> None:
    for name in _OBJECT_SETTINGS:
        if hasattr(source, name):
            setattr(target, name, getattr(source, name))
    for name in ("shadow_terminator_offset", "shadow_terminator_geometry_offset"):
        for old, new in ((source, target), (getattr(source, "cycles", None), getattr(target, "cycles", None))):
            if hasattr(old, name) and hasattr(new, name):
                setattr(new, name, getattr(old, name))


def _keep_instanced_lamps(lit: LitScene, instancers: set[bpy.types.Object]) -> None:
    """Hiding an instancer would put out the lamps it carries: give them objects of their own."""
    if not instancers:
        return
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        if instance.is_instance and instance.object.type == "LIGHT" and instance.parent.original in instancers:
            lamp = bpy.data.objects.new(instance.object.name, instance.object.original.data)
            lamp.matrix_world = instance.matrix_world.copy()
            bpy.context.scene.collection.objects.link(lamp)
            lit.made.append(lamp)
