"""A scene's surface as PLY (binary, with normals and instances) and as OBJ with MTL and textures. Our world: metres, z up, as everywhere."""

import re
from pathlib import Path

import numpy as np

from ..errors import WorkError
from . import ply
from .files import atomic_write_text
from .png import write_png
from .scene_model import Look, SceneModel

#: Corners are one vertex where place and normal agree to these digits.
_DIGITS_M, _DIGITS_NORMAL = 6, 4
_FACE = "f {}/{}/{} {}/{}/{} {}/{}/{}"


def write_ply(path: Path, model: SceneModel) -> None:
    """Binary little-endian: vertices x y z nx ny nz (float), one for each shading normal of a place; faces vertex_indices, instance (int).

    Raises WorkError where it cannot be written.
    """
    rows = np.concatenate(
        [model.corners_m.reshape(-1, 3).round(_DIGITS_M), model.normals.reshape(-1, 3).round(_DIGITS_NORMAL)], 1
    )
    unique, index = _unique(rows)
    faces, values = index.reshape(-1, 3), {"instance": model.instance}
    ply.write_ply(path, unique[:, :3], faces, normals=unique[:, 3:], face_values=values, comment="metres, z up")


def write_obj(path: Path, model: SceneModel) -> None:
    """NAME.obj, NAME.mtl and a folder NAME_textures of PNG; a group of faces for every object (o NAME) and material.

    Plain colours are textures too, of 2 x 2 pixels: some programs take Kd for linear light, others for sRGB, but all agree about images.
    Raises WorkError where they cannot be written.
    """
    path = Path(path)
    files = _file_names(model)
    folder = path.with_name(f"{path.stem}_textures")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise WorkError(f"{folder}: cannot make the folder: {error.strerror or error}") from None
    for look, name in zip(model.looks, files, strict=True):
        write_png(folder / f"{name}.png", _plain(look) if look.texture is None else look.texture)
    atomic_write_text(path.with_suffix(".mtl"), _mtl(files, folder.name))
    atomic_write_text(path, _obj(model, files, path.stem))


def _file_names(model: SceneModel) -> list[str]:
    """One word a material, no two alike."""
    names: list[str] = []
    for look in model.looks:
        name = re.sub(r"[^A-Za-z0-9_.-]+", "_", look.name) or "material"
        while name in names:
            name += "_"
        names.append(name)
    return names


def _plain(look: Look) -> np.ndarray:
    return np.full((2, 2, 3), np.rint(np.array(look.colour) * 255), np.uint8)


def _mtl(files: list[str], folder: str) -> str:
    form = "newmtl {0}\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {1}/{0}.png\n"
    return "\n".join(form.format(name, folder) for name in files)


def _obj(model: SceneModel, files: list[str], stem: str) -> str:
    places, v = _unique(model.corners_m.reshape(-1, 3).round(_DIGITS_M))
    uvs, vt = _unique(model.uv.reshape(-1, 2).round(_DIGITS_M))
    normals, vn = _unique(model.normals.reshape(-1, 3).round(_DIGITS_NORMAL))
    lines = ["# metres, right-handed, z up", f"mtllib {stem}.mtl"]
    for word, digits, rows in (("v", _DIGITS_M, places), ("vt", _DIGITS_M, uvs), ("vn", _DIGITS_NORMAL, normals)):
        form = f"{word}" + f" %.{digits}f" * rows.shape[1]
        lines += [form % tuple(row) for row in rows.tolist()]
    corners = np.stack([v, vt, vn], -1).reshape(-1, 9) + 1
    order = np.lexsort((np.arange(len(model)), model.material, model.instance))
    groups = np.stack([model.instance, model.material], 1)[order]
    for part in np.split(np.arange(len(order)), np.flatnonzero(np.any(np.diff(groups, axis=0), 1)) + 1):
        if not len(part):
            continue
        instance, material = (int(n) for n in groups[part[0]])
        lines += [f"o {model.names.get(instance, instance)}", f"usemtl {files[material]}"]
        lines += [_FACE.format(*row) for row in corners[order[part]].tolist()]
    return "\n".join(lines) + "\n"


def _unique(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distinct rows, and (n,) which of them each row is. -0 counts as 0."""
    unique, index = np.unique(rows + 0.0, axis=0, return_inverse=True)
    return unique, index.reshape(-1)
