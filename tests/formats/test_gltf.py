"""Meshes of glTF: as Open3D reads them, without a file outside."""

import base64
import json
import struct

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.formats.gltf import read_gltf

open3d = pytest.importorskip("open3d", reason="reads glTF")

POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
DATA = POINTS.tobytes() + struct.pack("<3H", 0, 1, 2)


def content(**buffer):
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "translation": [0, 0, 2]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"uri": "../outside.png"}],
        "buffers": [{"byteLength": len(DATA), **buffer}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 36},
            {"buffer": 0, "byteOffset": 36, "byteLength": 6},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
             "min": [0, 0, 0], "max": [1, 1, 0]},
            {"bufferView": 1, "componentType": 5123, "count": 3, "type": "SCALAR"},
        ],
    }  # fmt: skip


def written(folder, **buffer):
    path = folder / "mesh.gltf"
    path.write_text(json.dumps(content(**buffer)))
    return path


def glb(folder):
    text = json.dumps(content()).encode()
    text += b" " * (-len(text) % 4)
    data = DATA + b"\0" * (-len(DATA) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(data), b"BIN\0") + data
    path = folder / "mesh.glb"
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    return path


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "own/sub").mkdir(parents=True)
    for name in ("own/a b.bin", "own/sub/a.bin", "outside.bin"):
        (tmp_path / name).write_bytes(DATA)
    (tmp_path / "own/link.bin").symlink_to(tmp_path / "outside.bin")
    return tmp_path / "own"


def test_a_mesh_is_read_from_a_file_beside_it_from_text_and_from_one_file(folder):
    plain = open3d.io.read_triangle_mesh(str(written(folder, uri="sub/a.bin")))
    inline = "data:application/octet-stream;base64," + base64.b64encode(DATA).decode()
    files = [written(folder, uri="sub/a.bin"), glb(folder)]
    for file in files:
        points, triangles = read_gltf(file)
        assert triangles.tolist() == [[0, 1, 2]]
        assert np.array_equal(points, np.asarray(plain.vertices))
    for uri in ("a%20b.bin", "sub/../a b.bin", inline):
        assert np.array_equal(read_gltf(written(folder, uri=uri))[0], points)


@pytest.mark.parametrize(
    "uri",
    [
        "../outside.bin",
        "a%00.bin",
        "%2e%2e/outside.bin",
        "{outside}",
        "link.bin",
        "data:,/../a.bin",
    ],
)
def test_a_buffer_outside_is_refused_in_a_line(folder, uri):
    uri = uri.format(outside=folder.parent / "outside.bin")
    with pytest.raises(InputError, match=r"(mesh.gltf|a.bin): expected [^\n]+$"):
        read_gltf(written(folder, uri=uri))


@pytest.mark.parametrize("text", ["", "[]", '{"buffers": 3}', '{"meshes": [{}]}', "glTF"])
def test_damaged_files_are_one_line(folder, text):
    (folder / "mesh.gltf").write_text(text)
    with pytest.raises(InputError, match=r"mesh\.gltf"):
        read_gltf(folder / "mesh.gltf")
