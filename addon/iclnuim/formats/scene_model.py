"""A scene as a surface: triangles with shading normals, texture coordinates, materials and
instances. Functions select and subdivide triangles and write PLY (binary, with normals and
instances) or OBJ with MTL and textures. World: metres, z up.
"""

import re
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from . import ply
from .files import atomic_write_text, make_folder
from .png import write_png

#: Corners are merged to one vertex if position and normal are equal to these numbers of digits.
_DIGITS_M = 6
_DIGITS_NORMAL = 4
_FACE = "f {}/{}/{} {}/{}/{} {}/{}/{}"
_MATERIAL = "newmtl {name}\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {folder}/{name}.png\n"


@dataclass(frozen=True, eq=False)
class Appearance:
    """The appearance of a material: its name, its colour (3,) in sRGB 0..1, and its texture (h, w,
    3) uint8, row 0 at the top, or None.
    """

    name: str
    colour: tuple[float, float, float]
    texture: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class SceneModel:
    """m triangles. corners_m (m, 3, 3) in metres, world, counter-clockwise seen from the front;
    normals (m, 3, 3): unit shading normals of the corners; uv (m, 3, 2), v upwards; material (m,):
    index into looks; instance (m,): number in label images; names: instance -> name.
    """

    corners_m: np.ndarray
    normals: np.ndarray
    uv: np.ndarray
    material: np.ndarray
    instance: np.ndarray
    looks: tuple[Appearance, ...] = ()
    names: dict[int, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.corners_m)

    def area_m2(self) -> np.ndarray:
        """(m,) areas in square metres."""
        a, b, c = np.moveaxis(self.corners_m, 1, 0)
        return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2

    def chosen(self, rows: np.ndarray) -> "SceneModel":
        """A model of some of the triangles, selected by a mask (m,) or by indices."""
        return replace(self, **{name: getattr(self, name)[rows] for name in _ARRAYS})

    def cut(self, longest_m: float) -> "tuple[SceneModel, np.ndarray]":
        """The same surface subdivided into k triangles without an edge longer than `longest_m`, and
        the index (k,) of each one's original triangle.

        The longest edge is bisected repeatedly.
        """
        done = []
        rest = self
        origin = np.arange(len(self))
        origins = []
        while len(rest):
            edges = np.linalg.norm(rest.corners_m - np.roll(rest.corners_m, -1, axis=1), axis=2)
            longest = edges.argmax(1)
            small = edges.max(1) <= longest_m
            done.append(rest.chosen(small))
            origins.append(origin[small])
            origin = np.repeat(origin[~small], 2)
            rest = rest.chosen(~small)._bisected(longest[~small])
        joined: dict[str, Any] = {}
        for name in _ARRAYS:
            joined[name] = np.concatenate([getattr(part, name) for part in done or [self]])
        return replace(self, **joined), np.concatenate(origins or [origin])

    def _bisected(self, edge: np.ndarray) -> "SceneModel":
        """Split each triangle into two, at the middle of the edge that starts at corner `edge`
        (m,).
        """
        order = (edge[:, None] + np.arange(3)) % 3
        halves: dict[str, Any] = {}
        for name in _OF_CORNERS:
            ordered = np.take_along_axis(getattr(self, name), order[..., None], 1)
            a, b, c = np.moveaxis(ordered, 1, 0)
            middle = (a + b) / 2
            if name == "normals":
                middle = middle / np.maximum(np.linalg.norm(middle, axis=1, keepdims=True), 1e-12)
            pair = np.stack([np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)], 1)
            halves[name] = pair.reshape(-1, *pair.shape[2:])
        for name in ("material", "instance"):
            halves[name] = np.repeat(getattr(self, name), 2)
        return replace(self, **halves)


_OF_CORNERS = ("corners_m", "normals", "uv")
_ARRAYS = (*_OF_CORNERS, "material", "instance")


def write_ply(path: Path, model: SceneModel) -> None:
    """Write binary little-endian PLY: vertices x y z nx ny nz (float), one per position and shading
    normal; faces vertex_indices, instance (int).

    Raises WorkError if it cannot be written.
    """
    corners_m = model.corners_m.reshape(-1, 3)
    normals = model.normals.reshape(-1, 3)
    unique, index = _unique(np.hstack([corners_m.round(_DIGITS_M), normals.round(_DIGITS_NORMAL)]))
    faces = index.reshape(-1, 3)
    normals = unique[:, 3:]
    values = {"instance": model.instance}
    about = "metres, z up"
    ply.write_ply(path, unique[:, :3], faces, normals=normals, face_values=values, comment=about)


def write_obj(path: Path, model: SceneModel) -> None:
    """Write NAME.obj, NAME.mtl and a folder NAME_textures of PNG files, with a group of faces for
    every object (o NAME) and material.

    Plain colours are written as textures of 2 x 2 pixels: some programs interpret Kd as linear
    light, others as sRGB, but all read images in the same way. Raises WorkError if they cannot be
    written.
    """
    path = Path(path)
    files = _file_names(model)
    materials_file, folder = obj_parts(path)
    make_folder(folder)
    for look, name in zip(model.looks, files, strict=True):
        plain = np.full((2, 2, 3), np.rint(np.array(look.colour) * 255), np.uint8)
        write_png(folder / f"{name}.png", plain if look.texture is None else look.texture)
    materials = [_MATERIAL.format(name=name, folder=folder.name) for name in files]
    atomic_write_text(materials_file, "\n".join(materials))
    atomic_write_text(path, _obj(model, files, path.stem))


def obj_parts(path: Path) -> tuple[Path, Path]:
    """The file of the materials and the folder of the textures that write_obj writes next to an OBJ
    file.
    """
    return path.with_suffix(".mtl"), path.with_name(f"{path.stem}_textures")


def _file_names(model: SceneModel) -> list[str]:
    """A unique name for each material, usable in file names and without blanks."""
    names: list[str] = []
    for look in model.looks:
        name = re.sub(r"[^A-Za-z0-9_.-]+", "_", look.name) or "material"
        while name in names:
            name += "_"
        names.append(name)
    return names


def _obj(model: SceneModel, files: list[str], stem: str) -> str:
    places, v = _unique(model.corners_m.reshape(-1, 3).round(_DIGITS_M))
    uvs, vt = _unique(model.uv.reshape(-1, 2).round(_DIGITS_M))
    normals, vn = _unique(model.normals.reshape(-1, 3).round(_DIGITS_NORMAL))
    lines = ["# metres, right-handed, z up", f"mtllib {stem}.mtl"]
    for word, digits, rows in (
        ("v", _DIGITS_M, places),
        ("vt", _DIGITS_M, uvs),
        ("vn", _DIGITS_NORMAL, normals),
    ):
        form = f"{word}" + f" %.{digits}f" * rows.shape[1]
        lines += [form % tuple(row) for row in rows.tolist()]
    corners = np.stack([v, vt, vn], -1).reshape(-1, 9) + 1
    order = np.lexsort((np.arange(len(model)), model.material, model.instance))
    groups = np.stack([model.instance, model.material], 1)[order]
    starts = np.flatnonzero(np.any(np.diff(groups, axis=0), 1)) + 1
    for part in np.split(np.arange(len(order)), starts):
        if not len(part):
            continue
        instance, material = (int(n) for n in groups[part[0]])
        lines += [f"o {model.names.get(instance, instance)}", f"usemtl {files[material]}"]
        lines += [_FACE.format(*row) for row in corners[order[part]].tolist()]
    return "\n".join(lines) + "\n"


def _unique(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The distinct rows, and for each row (n,) its index among them. -0 is equal to 0."""
    unique, index = np.unique(rows + 0.0, axis=0, return_inverse=True)
    return unique, index.reshape(-1)
