"""Mipmaps on disk: the same pixels as in memory, made once, the oldest removed; and the memory of
all together.
"""

import os
import time

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")

from iclnuim.blender.light import mipmap_images, mipmap_memory, mipmaps  # noqa: E402
from iclnuim.blender.light.mipmap_files import MipmapFiles, write_bmp  # noqa: E402
from iclnuim.blender.light.mipmap_pictures import Pictures  # noqa: E402
from iclnuim.geometry.camera import PinholeCamera  # noqa: E402

HOUR_S = 3600.0


@pytest.fixture
def picture(tmp_path):
    """A packed picture of 8 bits, saved as PNG and read again."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    image = bpy.data.images.new("noise", 96, 64)
    pixels = np.random.default_rng(0).random(96 * 64 * 4, np.float32)
    pixels[3::4] = 1.0
    image.pixels.foreach_set(pixels)
    image.filepath_raw = str(tmp_path / "noise.png")
    image.file_format = "PNG"
    image.save()
    read = bpy.data.images.load(str(tmp_path / "noise.png"))
    read.pack()
    return read


def with_levels(image, folder, halvings=0):
    pictures = Pictures(MipmapFiles(folder, 3))
    assert pictures.size(image, "REPEAT") == (96, 64)
    return pictures.with_levels(image, "REPEAT", halvings), pictures.files


def texels(image):
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    rows = image.size[1]
    return np.round(pixels.reshape(rows, -1, 4)[..., :3] * 255).astype(np.uint8)


@pytest.mark.parametrize("halvings", [0, 1])
def test_levels_from_a_file_are_those_in_memory(picture, tmp_path, halvings):
    levels = mipmap_images.levels_of(picture, "REPEAT", halvings)
    expected = texels(mipmap_images.in_memory(picture, levels))
    for _ in range(2):  # made, and found
        made, files = with_levels(picture, tmp_path / "cache", halvings)
        assert files == [next((tmp_path / "cache").iterdir())]
        assert made.source == "FILE" and made.colorspace_settings.name == "sRGB"
        assert np.array_equal(texels(made), expected)


def test_a_picture_with_levels_in_the_cache_is_not_decoded(picture, tmp_path):
    with_levels(picture, tmp_path / "cache")
    picture.buffers_free()
    with_levels(picture, tmp_path / "cache")
    assert not picture.has_data


def test_another_picture_border_or_colour_space_has_other_levels(picture, tmp_path):
    files = MipmapFiles(tmp_path, 3)
    keys = [files.key(picture, "REPEAT"), files.key(picture, "EXTEND")]
    picture.colorspace_settings.name = "Linear Rec.709"
    keys.append(files.key(picture, "REPEAT"))
    keys.append(MipmapFiles(tmp_path, 4).key(picture, "REPEAT"))
    assert len(set(keys)) == 4
    picture.pixels[0] = 0.5
    picture.update()
    assert files.key(picture, "REPEAT") == ""


def test_another_reader_reads_the_bitmap(tmp_path):
    cv2 = pytest.importorskip("cv2")
    pixels = np.random.default_rng(1).integers(0, 256, (32, 64, 3), np.uint8)
    write_bmp(tmp_path / "a.bmp", pixels)
    assert np.array_equal(cv2.imread(str(tmp_path / "a.bmp"))[::-1, :, ::-1], pixels)


def test_the_files_unused_for_longest_go_and_those_in_use_stay(tmp_path):
    levels = np.zeros(mipmap_images.levels_shape(32, 32) + (3,), np.uint8)
    files = MipmapFiles(tmp_path, 3, limit=4 * levels.size)
    assert all(files.store(f"{k:032x}", (32, 32), 0, levels) for k in range(3))
    paths = sorted(tmp_path.iterdir())
    for hours, path in zip((2, 3, 0), paths, strict=True):
        os.utime(path, (time.time() - hours * HOUR_S,) * 2)
    assert files.store(f"{3:032x}", (32, 32), 0, levels)
    assert paths[1] not in list(tmp_path.iterdir()) and paths[0].exists()
    assert files.store(f"{4:032x}", (32, 32), 0, levels)  # the other one that is not in use
    assert not files.store(f"{5:032x}", (32, 32), 0, levels)
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) <= 4 * levels.size


def test_where_the_cache_cannot_be_written_levels_are_in_memory(picture, tmp_path):
    (tmp_path / "cache").write_text("no folder")
    made, files = with_levels(picture, tmp_path / "cache")
    assert files == [] and made.source == "GENERATED"


def test_a_truncated_file_is_made_again(picture, tmp_path):
    with_levels(picture, tmp_path / "cache")
    file = next((tmp_path / "cache").iterdir())
    whole = file.read_bytes()
    file.write_bytes(whole[:1000])
    with_levels(picture, tmp_path / "cache")
    assert file.read_bytes() == whole


def test_all_levels_together_have_a_limit_and_the_largest_pictures_are_halved():
    limit = mipmap_memory.MAX_BYTES
    few = {k: (4096, 4096, mipmap_memory.BYTE) for k in range(10)}
    assert set(mipmap_memory.halvings(few).values()) == {0}
    many = {k: (4096, 4096, mipmap_memory.BYTE) for k in range(200)} | {"small": (64, 64, 4)}
    found = mipmap_memory.halvings(many)
    sizes = [
        4 * np.prod(mipmap_images.levels_shape(many[k][0] >> n, many[k][1] >> n))
        for k, n in found.items()
    ]
    assert 0.6 * limit < sum(sizes) <= limit
    assert found.keys() == many.keys() and found["small"] == 0
    assert max(found.values()) - min(n for k, n in found.items() if k != "small") <= 1
    odd = {k: (4095, 4095, mipmap_memory.BYTE) for k in range(200)}
    assert len(mipmap_memory.halvings(odd)) == 14  # whole or without mipmaps


def test_pictures_that_are_halved_are_named(picture, tmp_path, monkeypatch):
    material = bpy.data.materials.new("m")
    material.use_nodes = True
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = picture
    shader = material.node_tree.nodes["Principled BSDF"]
    material.node_tree.links.new(node.outputs["Color"], shader.inputs["Base Color"])
    monkeypatch.setattr(mipmaps, "halvings", lambda found: dict.fromkeys(found, 1))
    filtered = mipmaps.filter_textures(PinholeCamera(), tmp_path / "cache")
    assert [note.split(":")[0] for note in filtered.notes] == [
        f"pictures ({picture.name}) are halved for mipmaps"
    ]
    assert tuple(node.image.size) == mipmap_images.levels_shape(48, 32)[::-1]
