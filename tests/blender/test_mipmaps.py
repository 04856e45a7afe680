"""Mipmaps against formulas: levels of textures, density of textures on faces, and frames of a plane
with a fine pattern.
"""

import json

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")

from iclnuim.blender.light import mipmap_attributes, mipmap_images, mipmaps  # noqa: E402
from iclnuim.formats.exr import read_exr  # noqa: E402
from iclnuim.geometry.camera import PinholeCamera  # noqa: E402

TEXELS = 64
#: Distance of the plane from the camera, and width of a pixel there with fx = fy = 64.
DISTANCE_M = 2.0
PIXEL_M = 2.0 / 64


def new_image(pixels, colour_space="sRGB", **settings):
    """An image with the values of the rows (h, w, 3), the lowest row first."""
    height, width = pixels.shape[:2]
    image = bpy.data.images.new("pattern", width, height, **settings)
    image.colorspace_settings.name = colour_space
    image.pixels.foreach_set(
        np.dstack([pixels, np.ones((height, width))]).astype(np.float32).ravel()
    )
    return image


def checks(period=1, size=TEXELS):
    rows, columns = np.indices((size, size)) // period
    return np.repeat(((rows + columns) % 2)[..., None], 3, -1).astype(float)


def textured(image, shader="Emission", **settings):
    """A material with an image as its colour, read through the UV map.

    Returns the material and its Image Texture node.
    """
    material = bpy.data.materials.new("material")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    texture = tree.nodes.new("ShaderNodeTexImage")
    shine = tree.nodes.new(f"ShaderNode{shader}")
    out = tree.nodes.new("ShaderNodeOutputMaterial")
    texture.image = image
    for key, value in settings.items():
        setattr(texture, key, value)
    tree.links.new(texture.outputs["Color"], shine.inputs["Color"])
    tree.links.new(shine.outputs[0], out.inputs["Surface"])
    return material, texture


def plane(material, repeats, size_m=8.0, y_m=DISTANCE_M):
    """A square facing -y, whose texture is repeated along both sides."""
    h = size_m / 2
    mesh = bpy.data.meshes.new("plane")
    mesh.from_pydata([(-h, y_m, -h), (h, y_m, -h), (h, y_m, h), (-h, y_m, h)], [], [(0, 1, 2, 3)])
    layer = mesh.uv_layers.new(name="own")
    layer.data.foreach_set("uv", np.array([0, 0, 1, 0, 1, 1, 0, 1], np.float32) * repeats)
    mesh.materials.append(material)
    thing = bpy.data.objects.new("plane", mesh)
    bpy.context.scene.collection.objects.link(thing)
    return thing


@pytest.fixture
def empty():
    bpy.ops.wm.read_factory_settings(use_empty=True)


def pixels_of(image):
    return np.array(image.pixels[:], np.float32).reshape(image.size[1], image.size[0], 4)


def levels_in_memory(image, extension):
    return mipmap_images.in_memory(image, mipmap_images.levels_of(image, extension))


def levels_of(image, size):
    """The levels of a texture of size x size texels, without their margins."""
    pixels = pixels_of(image)
    before = mipmap_images.margins(size)[0]
    found = []
    for k in range(mipmap_images.LEVELS):
        margin = before // 2**k
        side = size // 2**k
        start = image.size[0] // 2 // 2**k
        found.append(pixels[margin : margin + side, start + margin : start + margin + side, :3])
    return found


def test_levels_are_means_of_light_and_the_first_is_the_texture(empty):
    image = new_image(checks())
    levels = levels_of(levels_in_memory(image, "REPEAT"), TEXELS)
    assert [v.shape[0] for v in levels] == [64, 32, 16, 8, 4, 2]
    assert np.array_equal(levels[0], checks())
    half = 1.055 * 0.5 ** (1 / 2.4) - 0.055  # the sRGB value of half of white's light
    for level in levels[1:]:
        assert level == pytest.approx(half, abs=1 / 255)


def test_a_repeated_texture_continues_in_its_margins_and_a_single_one_ends_there(empty):
    ramp = np.broadcast_to(np.linspace(0, 1, TEXELS)[None, :, None], (TEXELS, TEXELS, 3))
    before, after = mipmap_images.margins(TEXELS)
    for extension, outside in (("REPEAT", (ramp[0, -1, 0], ramp[0, 0, 0])), ("EXTEND", (0.0, 1.0))):
        pixels = pixels_of(levels_in_memory(new_image(ramp), extension))
        row = pixels[before, pixels.shape[1] // 2 :, 0]
        left = row[before - 1]
        right = row[before + TEXELS]
        assert (left, right) == pytest.approx(outside, abs=1 / 255)
    assert mipmap_images.margins(682) == (32, 54) and (32 + 682 + 54) % 32 == 0


def test_linear_images_are_averaged_as_they_are(empty):
    image = new_image(checks() * 6.0, "Linear Rec.709", float_buffer=True)
    made = levels_in_memory(image, "REPEAT")
    assert made.is_float and made.colorspace_settings.name == "Linear Rec.709"
    for level in levels_of(made, TEXELS)[1:]:
        assert level == pytest.approx(3.0, rel=1e-5)


def test_a_band_is_filtered_like_the_whole():
    level = np.random.default_rng(0).random((96, 40, 3)).astype(np.float32)
    kernel = np.array([1, 3, 3, 1]) / 8
    padded = np.pad(level, ((1, 1), (1, 1), (0, 0)), mode="edge")
    expected = np.zeros((48, 20, 3))
    for i, a in enumerate(kernel):
        for j, b in enumerate(kernel):
            expected += a * b * padded[i : i + 96 : 2, j : j + 40 : 2]
    assert mipmap_images.halved(level) == pytest.approx(expected, abs=1e-6)


def test_density_is_that_of_faces_in_the_world(empty):
    thing = plane(textured(new_image(checks()))[0], repeats=3.0, size_m=2.0)
    assert mipmap_attributes.density(thing, thing.data.uv_layers[0]) == pytest.approx([1.5])
    thing.scale = (2.0, 2.0, 0.5)  # area times 1
    bpy.context.view_layer.update()
    assert mipmap_attributes.density(thing, thing.data.uv_layers[0]) == pytest.approx([1.5])
    thing.scale = (2.0, 2.0, 2.0)
    bpy.context.view_layer.update()
    assert mipmap_attributes.density(thing, thing.data.uv_layers[0]) == pytest.approx([0.75])


def with_mapping(material, texture):
    tree = material.node_tree
    mapping = tree.nodes.new("ShaderNodeMapping")
    uv = tree.nodes.new("ShaderNodeTexCoord")
    mapping.inputs["Scale"].default_value = (4.0, 1.0, 1.0)
    tree.links.new(uv.outputs["UV"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs[0], texture.inputs["Vector"])


def with_generated_coordinates(material, texture):
    uv = material.node_tree.nodes.new("ShaderNodeTexCoord")
    material.node_tree.links.new(uv.outputs["Generated"], texture.inputs["Vector"])


def with_alpha(material, texture):
    tree = material.node_tree
    mix = tree.nodes.new("ShaderNodeMixShader")
    out = next(n for n in tree.nodes if n.type == "OUTPUT_MATERIAL")
    tree.links.new(texture.outputs["Alpha"], mix.inputs[0])
    tree.links.new(mix.outputs[0], out.inputs["Surface"])


def with_displacement(material, texture):
    out = next(n for n in material.node_tree.nodes if n.type == "OUTPUT_MATERIAL")
    material.node_tree.links.new(texture.outputs["Color"], out.inputs["Displacement"])


def with_raw_data(material, texture):
    texture.image.colorspace_settings.name = "Non-Color"


def with_own_mapping(material, texture):
    texture.texture_mapping.scale = (2.0, 1.0, 1.0)


def with_large_image(material, texture):
    texture.image.scale(4097, 4096)


@pytest.mark.parametrize(
    ("change", "scale"),
    [
        (None, 1.0),
        (with_mapping, 2.0),
        *((f, None) for f in (with_generated_coordinates, with_alpha, with_displacement)),
        *((f, None) for f in (with_raw_data, with_own_mapping, with_large_image)),
    ],
)
def test_textures_that_are_filtered(empty, change, scale):
    material, texture = textured(new_image(checks()))
    if change is not None:
        change(material, texture)
    assert [t.scale for t in mipmaps.textures_of(material)] == ([] if scale is None else [scale])


def test_a_texture_in_a_group_of_two_materials_is_filtered_once(empty, tmp_path):
    group = bpy.data.node_groups.new("shared", "ShaderNodeTree")
    texture = group.nodes.new("ShaderNodeTexImage")
    output = group.nodes.new("NodeGroupOutput")
    group.interface.new_socket("Colour", in_out="OUTPUT", socket_type="NodeSocketColor")
    texture.image = image = new_image(checks())
    group.links.new(texture.outputs["Color"], output.inputs[0])
    for _ in range(2):
        material, _ = textured(None)
        tree = material.node_tree
        nodes = {node.type: node for node in tree.nodes}
        instance = tree.nodes.new("ShaderNodeGroup")
        instance.node_tree = group
        tree.links.new(instance.outputs[0], nodes["EMISSION"].inputs["Color"])
        plane(material, repeats=3.0)
    filtered = mipmaps.filter_textures(PinholeCamera(), tmp_path)
    names = [made.name for made in filtered.images]
    assert names == [f"{image.name} mipmaps", "footprint noise"]
    assert texture.image.name == f"{image.name} mipmaps"
    assert all("mipmap footprint 64 x 64 REPEAT " in mesh.attributes for mesh in bpy.data.meshes)


def test_a_mesh_without_faces_has_no_density(empty):
    thing = plane(textured(new_image(checks()))[0], repeats=1.0)
    thing.data.clear_geometry()
    assert mipmap_attributes.density(thing, thing.data.uv_layers.new(name="own")).shape == (0,)


@pytest.mark.parametrize(
    "settings", [{"interpolation": "Closest"}, {"extension": "CLIP"}, {"projection": "BOX"}]
)
def test_textures_that_are_read_in_another_way_are_left(empty, settings):
    assert mipmaps.textures_of(textured(new_image(checks()), **settings)[0]) == []


@pytest.fixture(scope="module")
def patterned(tmp_path_factory):
    """Scenes of a plane two metres in front of the camera, by the number of texels within a pixel
    and the shader, and the camera's path.
    """
    folder = tmp_path_factory.mktemp("patterned")
    files = {}
    for texels, shader in (*((texels, "Emission") for texels in (0.25, 7.3)), (7.3, "BsdfDiffuse")):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        image = new_image(checks(1 if texels > 1 else 8))
        image.pack()
        plane(textured(image, shader)[0], repeats=8.0 / PIXEL_M * texels / TEXELS)
        sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
        # shines along +y
        sun.rotation_euler = (np.pi / 2, 0.0, 0.0)
        sun.data.energy = np.pi
        bpy.context.scene.collection.objects.link(sun)
        files[texels, shader] = folder / f"{shader}-{texels}.blend"
        bpy.ops.wm.save_as_mainfile(filepath=str(files[texels, shader]))
    path = folder / "still.txt"
    path.write_text("1.0 0 0 0 -0.70710678118 0 0 0.70710678118\n")  # looks along +y
    return files, path


def frame(render_here, out, patterned, texels, shader="Emission", **settings):
    files, path = patterned
    camera = "64x64,64,64,31.7,31.3"
    render_here(
        out, "0", scene=files[texels, shader], trajectory=path, camera=camera, samples=1, **settings
    )
    channels = read_exr(out / "exr/000000.exr")
    return np.stack([channels[c] for c in "RGB"], -1).astype(float), channels["Z"]


def test_a_distant_pattern_is_its_mean_and_a_close_one_is_unchanged(
    render_here, patterned, tmp_path
):
    for texels in (7.3, 0.25):
        place = tmp_path / f"{texels}"
        plain, plain_z = frame(render_here, place / "plain", patterned, texels, mipmaps=False)
        filtered, z = frame(render_here, place / "filtered", patterned, texels, mipmaps=True)
        assert np.array_equal(z, plain_z) and plain_z == pytest.approx(DISTANCE_M, abs=1e-4)
        if texels > 1:
            assert plain.std() > 0.1  # any of the texels within the pixel
            assert filtered == pytest.approx(0.5, abs=0.02)
        else:
            assert plain.std() > 0.1 and filtered == pytest.approx(plain, abs=2e-3)


def test_from_one_level_to_the_next_more_and_more_cells_of_the_surface_change(
    render_here, patterned, tmp_path
):
    """Cells 32 texels wide read level 0 if their footprint times noise between 0.71 and 1.41 is
    less than 2 texels: half of them at 2 / 1.06.
    """
    coarser = []
    for texels in (1.1, 1.76, 3.25):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        image = new_image(checks(size=512))
        image.pack()
        plane(textured(image)[0], repeats=8.0 * 128 * texels / 512)  # 128 pixels cover a metre
        folder = tmp_path / f"{texels}"
        folder.mkdir()
        bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))
        camera = "256x256,256,256,127.7,127.3"
        render_here(
            folder / "run",
            "0",
            scene=folder / "scene.blend",
            trajectory=patterned[1],
            camera=camera,
            samples=1,
        )
        seen = read_exr(folder / "run/exr/000000.exr")["R"].astype(float)
        coarser.append((abs(seen - 0.5) < 0.003).mean())  # level 1 is grey
    # rays are longer than the distance of the plane, by 7 % in the mean
    assert coarser == pytest.approx([0.0, 0.5, 1.0], abs=0.1)


def frames_of_tiles(
    render_here, folder, patterned, repeats, offset, extension, mapping_in_the_shader
):
    """A frame of a plane whose texture is turned, repeated and moved, with positions in the texture
    as attributes or computed by nodes.
    """
    bpy.ops.wm.read_factory_settings(use_empty=True)
    values = np.random.default_rng(3).random((48, TEXELS, 3))  # not square
    image = new_image(values)
    image.pack()
    material, texture = textured(image, extension=extension)
    thing = plane(material, repeats=1.0)
    turn = np.array([[0.8, 0.6], [-0.6, 0.8]])
    uv = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2 @ turn * repeats + offset
    thing.data.uv_layers[0].data.foreach_set("uv", uv.astype(np.float32).ravel())
    if mapping_in_the_shader:
        thing.modifiers.new("a modifier without effect", "EDGE_SPLIT").use_edge_angle = False
    file = folder / "scene.blend"
    folder.mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(file))
    render_here(
        folder / "run",
        "0",
        scene=file,
        trajectory=patterned[1],
        camera="64x64,64,64,31.7,31.3",
        samples=1,
    )
    whole = []
    for n in bpy.data.materials["material"].node_tree.nodes:
        if n.type == "VECT_MATH":
            whole.append(n.operation)
    channels = read_exr(folder / "run/exr/000000.exr")
    return np.stack([channels[c] for c in "RGB"], -1).astype(float), whole


@pytest.mark.parametrize(
    ("repeats", "offset", "extension", "nodes"),
    [
        (0.7, (0.5, 0.5), "REPEAT", ["MULTIPLY"]),
        (0.7, (-6.5, 3.5), "REPEAT", ["MULTIPLY"]),
        (5.0, (0.3, -0.2), "REPEAT", ["WRAP", "MULTIPLY"]),
        (12.0, (0.3, -0.2), "REPEAT", ["WRAP", "MULTIPLY"]),
        (0.7, (0.5, 0.5), "EXTEND", ["MULTIPLY"]),
    ],
)
def test_positions_are_the_same_as_attributes_and_by_nodes(
    render_here, tmp_path, patterned, repeats, offset, extension, nodes
):
    (frame, used), (expected, used_else) = (
        frames_of_tiles(
            render_here, tmp_path / str(by_nodes), patterned, repeats, offset, extension, by_nodes
        )
        for by_nodes in (False, True)
    )
    assert used == nodes and len(used_else) > 2
    assert expected.std() > 0.02
    assert frame == pytest.approx(expected, abs=2e-3)


def test_a_face_beyond_the_borders_of_a_texture_without_repetition_is_placed_by_nodes(
    render_here, tmp_path, patterned
):
    frame, used = frames_of_tiles(
        render_here, tmp_path / "out", patterned, 3.0, (0.5, 0.5), "EXTEND", False
    )
    assert "MINIMUM" in used and frame.std() > 0.03


def test_baked_light_shows_the_filtered_textures_too(render_here, patterned, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    baked = {"light": "baked", "map_size": 64, "map_samples": 2}
    plain, filtered = (
        frame(
            render_here,
            tmp_path / f"{mipmaps}",
            patterned,
            7.3,
            "BsdfDiffuse",
            mipmaps=mipmaps,
            **baked,
        )[0]
        for mipmaps in (False, True)
    )
    assert plain.std() > 0.1
    assert filtered == pytest.approx(0.5, abs=0.03)


def test_a_run_goes_on_with_its_own_filter_of_textures_alone(render_here, patterned, tmp_path):
    from iclnuim.errors import InputError
    from iclnuim.job import read_recipe

    out = tmp_path / "run"
    frame(render_here, out, patterned, 0.25, mipmaps=False)
    recipe = json.loads((out / "sequence.json").read_text())
    with pytest.raises(
        InputError, match="found frames without mipmaps; try turning mipmaps off to go on"
    ):
        frame(render_here, out, patterned, 0.25)
    recipe["job"]["mipmaps"] = True
    del recipe["texture_filter"]
    (out / "sequence.json").write_text(json.dumps(recipe))
    with pytest.raises(
        InputError, match="found frames with mipmaps of an older version; try another out"
    ):
        frame(render_here, out, patterned, 0.25)
    written = tmp_path / "by_hand.json"
    written.write_text(json.dumps({"scene": "living_room", "trajectory": "living_room/kt2"}))
    assert read_recipe(written).mipmaps is True
