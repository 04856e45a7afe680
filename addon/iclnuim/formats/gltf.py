"""Meshes of glTF files, read by Open3D, which would follow every name in them: it gets a copy
without pictures, whose buffers are those in the file's own folder.
"""

import base64
import json
import tempfile
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from ..errors import InputError, WorkError
from .files import content_of_json, is_file, read_bytes, real_path

_MESH = "a glTF file from which Open3D reads a mesh"
_PICTURES = ("images", "textures", "samplers", "materials")
_BINARY = "data:application/octet-stream;base64,"


def read_gltf(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """points (n, 3), triangles (m, 3). Raises InputError; WorkError without Open3D."""
    try:
        import open3d
    except ImportError:
        raise WorkError(
            f"{path}: {path.suffix} is read by open3d; try: pip install open3d-cpu, or a .ply"
        ) from None
    content, binary = _content(path)
    try:
        for name in _PICTURES:
            content.pop(name, None)
        for mesh in content.get("meshes", []):
            for primitive in mesh["primitives"]:
                primitive.pop("material", None)
        for buffer in content.get("buffers", []):
            own = binary[: buffer["byteLength"]]  # chunks are padded
            buffer["uri"] = _embedded(path, buffer.get("uri"), own)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(_MESH, path=path, found=f"damaged JSON: {error}") from None
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "mesh.gltf"
        copy.write_text(json.dumps(content), "utf-8")
        with open3d.utility.VerbosityContextManager(open3d.utility.VerbosityLevel.Error):
            mesh = open3d.io.read_triangle_mesh(copy)
    if not len(mesh.vertices):
        raise InputError(_MESH, path=path, found="none", hint="a .ply")
    return np.asarray(mesh.vertices), np.asarray(mesh.triangles).reshape(-1, 3).astype(np.int64)


def _content(path: Path) -> tuple[dict[str, Any], bytes]:
    """The JSON of a .gltf or .glb, and the binary chunk of a .glb."""
    data = read_bytes(path, _MESH)
    binary = b""
    if data.startswith(b"glTF"):
        end = 20 + int.from_bytes(data[12:16], "little")
        binary = data[end + 8 : end + 8 + int.from_bytes(data[end : end + 4], "little")]
        data = data[20:end]
    content = content_of_json(data.decode("utf-8", "replace"), _MESH, path)
    if not isinstance(content, dict):
        raise InputError(_MESH, path=path, found="other JSON")
    return content, binary


def _embedded(path: Path, uri: str | None, binary: bytes) -> str:
    """A buffer as data in the JSON. Raises InputError for one outside the file's folder."""
    if uri is None:
        return _BINARY + base64.b64encode(binary).decode()
    if uri.startswith("data:") and ";base64," in uri:
        return uri
    own = real_path(path.parent)
    file = real_path(own / (uri if is_file(own / uri) else unquote(uri)))
    is_inside = file.is_relative_to(own)
    if not is_inside or any(part.startswith(".") for part in file.relative_to(own).parts):
        raise InputError("buffers in the file's own folder", path=path, found=uri)
    return _BINARY + base64.b64encode(read_bytes(file, "a buffer of glTF")).decode()
