"""Shows the open scene with a light map, in memory only: every surface is replaced by a copy with
the map's UVs and materials that show baked light.
"""

from dataclasses import dataclass, field

import bpy
import numpy as np
from bpy.types import ID, Image, Material, Mesh, Object, bpy_struct

from ...errors import WorkError
from ...lightmap.surfaces import BACK, FRONT
from .. import surfaces
from ..surfaces import Part, array_of, material_of_face
from .baked_material import BACK_UV, FRONT_UV, BakedLight, baked_copy

_OBJECT_SETTINGS = (
    "pass_index",
    "color",
    "visible_camera",
    "visible_diffuse",
    "visible_glossy",
    "visible_transmission",
    "visible_volume_scatter",
    "visible_shadow",
    "is_holdout",
    "is_shadow_catcher",
)
#: Settings that are those of the object or of Cycles, by Blender's version.
_SHADOW_SETTINGS = ("shadow_terminator_offset", "shadow_terminator_geometry_offset")


#: The copies made so far, by the original.
Copies = dict[tuple[Material | None, BakedLight], Material]


@dataclass(frozen=True, eq=False)
class MapLayout:
    """The positions of the corners (C,) of all parts in the map: uv (2, C, 2) for front and back,
    0..1; has (2, C): whether the side has texels.

    part_corners: the number of corners of each part.
    """

    uv: np.ndarray
    has: np.ndarray
    part_corners: tuple[int, ...]


@dataclass(eq=False)
class LitScene:
    """The datablocks that were added and the objects that were hidden, so that `revert` can undo
    this.
    """

    made: list[ID] = field(default_factory=list)
    hidden: list[tuple[Object, str, bool]] = field(default_factory=list)

    def hide(self, thing: Object, name: str) -> None:
        """Hide an object, which gets this name meanwhile."""
        self.hidden.append((thing, thing.name, thing.hide_render))
        thing.hide_render = True
        thing.name = name

    def revert(self) -> None:
        """Restore the scene."""
        bpy.data.batch_remove(self.made)
        for thing, name, hide in self.hidden:
            thing.name = name
            thing.hide_render = hide
        self.made = []
        self.hidden = []


def show(
    found: list[Part],
    layout: MapLayout,
    image: Image,
    gathering: bool = False,
    glow: bool = False,
    limit: float | None = None,
) -> LitScene:
    """Show the parts lit by `image`, to a camera or for gathering light from them; glow, limit: as
    in baked_material.BakedLight. The parts' meshes are used, not copied.

    Raises WorkError if the layout is for another scene.
    """
    corners = tuple(len(part.mesh.loops) for part in found)
    if corners != layout.part_corners:
        expected = f"the baked scene of {len(layout.part_corners)} parts"
        others = f"{len(found)} parts with other meshes"
        raise WorkError(f"light map: expected {expected}, found {others}")
    lit = LitScene()
    one_sided = BakedLight(image, False, gathering, glow, limit)
    both_sided = BakedLight(image, True, gathering, glow, limit)
    copies: Copies = {}
    start = 0
    for part, count in zip(found, corners, strict=True):
        if not any(part.origin == thing for thing, _, _ in lit.hidden):
            lit.hide(part.origin, f"{part.name}.unlit" if part.single else part.origin.name)
        here = slice(start, start + count)
        start += count
        _add_uvs(part.mesh, layout, here)
        baked = both_sided if layout.has[BACK, here].any() else one_sided
        _bake_materials(part, layout.has[:, here].any(0), baked, copies)
        thing = bpy.data.objects.new(part.name, part.mesh)
        _copy_settings(part.source, thing)
        lit.made.extend([thing, part.mesh, *surfaces.put(thing, part.matrix)])
        bpy.context.scene.collection.objects.link(thing)
    lit.made.extend(copies.values())
    return lit


def _bake_materials(part: Part, has: np.ndarray, baked: BakedLight, copies: Copies) -> None:
    """Replace the materials of faces that have a side in the map; has: of each corner."""
    sizes = array_of(part.mesh.polygons, "loop_total", 1, np.int32)
    for slot in set(np.unique(np.repeat(material_of_face(part), sizes)[has])):
        original = part.mesh.materials[slot] if slot >= 0 else None
        key = (original, baked)
        if key not in copies:
            copies[key] = baked_copy(original, baked)
        if slot >= 0:
            part.mesh.materials[slot] = copies[key]
        else:
            part.mesh.materials.append(copies[key])


def set_pixels(image: Image, light: np.ndarray) -> None:
    """Write new light (rows, columns, 3), row 0 at the bottom, into an image of the same size.
    Baking uses it; a render with persistent data would not.
    """
    pixels = np.ones((*light.shape[:2], 4), np.float32)
    pixels[..., :3] = light
    image.pixels.foreach_set(pixels.ravel())
    image.update()


def _add_uvs(mesh: Mesh, layout: MapLayout, corners: slice) -> None:
    """Add the UV map of the front, and that of the back if it has texels.

    A side without a chart is never visible and gets the position of the other side.
    """
    for side, name in ((FRONT, FRONT_UV), (BACK, BACK_UV)):
        has = layout.has[side, corners]
        if side == BACK and not has.any():
            return
        uv = np.where(has[:, None], layout.uv[side, corners], layout.uv[1 - side, corners])
        layer = mesh.uv_layers.new(name=name, do_init=False)
        if layer is None:
            full = f"the mesh {mesh.name} has no room for one more UV map; remove one"
            raise WorkError(f"light map: {full}")
        layer.data.foreach_set("uv", uv.astype(np.float32).ravel())


def _copy_settings(source: Object, target: Object) -> None:
    _copy_properties(source, target, (*_OBJECT_SETTINGS, *_SHADOW_SETTINGS))
    if hasattr(source, "cycles") and hasattr(target, "cycles"):
        _copy_properties(source.cycles, target.cycles, _SHADOW_SETTINGS)


def _copy_properties(source: bpy_struct, target: bpy_struct, names: tuple[str, ...]) -> None:
    for name in names:
        if hasattr(source, name) and hasattr(target, name):
            setattr(target, name, getattr(source, name))
