"""Images that are missing in a user's scene: never magenta, never black, and named."""

import sys
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")
sys.path.insert(0, str(Path(__file__).parent))
import own_scene_files as made  # noqa: E402
from iclnuim.blender.open import missing_images, scene  # noqa: E402
from iclnuim.blender.open.picture_memory import DecodedPictures  # noqa: E402

GREY = (0.5, 0.5, 0.5)


def opened(folder, change):
    """A box seen by a camera, whose material or world `change` spoils; its mean colour, and the
    notes of opening it.
    """
    here = made.fresh(bpy)
    block = made.material(bpy, "paint", colour=GREY, Roughness=1.0)
    block.diffuse_color = (*GREY, 1)
    made.box(bpy, "box", (-1, -1, -1), (1, 1, 1), block)
    here.world = bpy.data.worlds.new("sky")
    here.world.use_nodes = True
    here.world.node_tree.nodes["Background"].inputs["Color"].default_value = (1, 1, 1, 1)
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.location = (0, 0, 4)
    here.collection.objects.link(camera)
    here.camera = camera
    change(folder, block.node_tree, here)
    file = folder / "room.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(file))
    notes = scene.open_scene(str(file))
    here = bpy.context.scene
    here.render.engine = "CYCLES"
    here.cycles.samples = 4
    here.render.resolution_x = here.render.resolution_y = 8
    here.view_settings.view_transform = "Raw"
    here.render.image_settings.file_format = "OPEN_EXR"
    here.render.filepath = str(folder / "seen.exr")
    here.frame_set(0)
    bpy.ops.render.render(write_still=True)
    seen = bpy.data.images.load(str(folder / "seen.exr"))
    pixels = np.empty(8 * 8 * 4, np.float32)
    seen.pixels.foreach_get(pixels)
    return pixels.reshape(-1, 4)[:, :3].reshape(8, 8, 3)[3:5, 3:5].mean((0, 1)), notes


def shown(tree, image, into="Base Color"):
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    tree.links.new(node.outputs["Color"], tree.nodes["Principled BSDF"].inputs[into])
    return node


def image_of(source, path):
    image = bpy.data.images.new("picture", 4, 4)
    image.source = source
    image.filepath = path
    return image


def lost_file(folder, tree, here):
    shown(tree, image_of("FILE", "//lost.png"))


def no_image(folder, tree, here):
    shown(tree, None).label = "lost.png"


def lost_sequence(folder, tree, here):
    (folder / "other.png").write_bytes(b"")
    shown(tree, image_of("SEQUENCE", "//lost_0001.png")).image_user.frame_duration = 3


def sequence_without_its_first(folder, tree, here):
    for number in (1, 2):
        made.picture(bpy, folder / f"lost_{number:04}.png")
    shown(tree, image_of("SEQUENCE", "//lost_0001.png")).image_user.frame_duration = 2


def lost_tile(folder, tree, here):
    image = image_of("TILED", "//lost.<UDIM>.png")
    image.tiles.new(1002)
    made.picture(bpy, folder / "lost.1001.png")
    shown(tree, image)


def in_a_group(folder, tree, here):
    group = bpy.data.node_groups.new("group", "ShaderNodeTree")
    group.interface.new_socket("Colour", in_out="OUTPUT", socket_type="NodeSocketColor")
    node = group.nodes.new("ShaderNodeTexImage")
    node.image = image_of("FILE", "//lost.png")
    group.links.new(node.outputs["Color"], group.nodes.new("NodeGroupOutput").inputs[0])
    user = tree.nodes.new("ShaderNodeGroup")
    user.node_tree = group
    tree.links.new(user.outputs[0], tree.nodes["Principled BSDF"].inputs["Base Color"])


def through_a_curve(folder, tree, here):
    node = shown(tree, image_of("FILE", "//lost.png"))
    invert = tree.nodes.new("ShaderNodeInvert")
    tree.links.new(node.outputs["Color"], invert.inputs["Color"])
    tree.links.new(invert.outputs[0], tree.nodes["Principled BSDF"].inputs["Base Color"])


def nothing(folder, tree, here):
    pass


@pytest.mark.parametrize(
    "change",
    [lost_file, no_image, lost_sequence, sequence_without_its_first, lost_tile, in_a_group,
     through_a_curve],
)  # fmt: skip
def test_a_missing_image_gives_way_to_the_plain_colour_and_is_named(tmp_path, change):
    colour, notes = opened(tmp_path, change)
    assert any("missing or broken (lost" in note for note in notes), notes
    plain, _ = opened(tmp_path, nothing)
    assert plain == pytest.approx([0.5] * 3, abs=0.1)
    assert colour.max() < 1.2 * colour.min()  # grey: neither magenta nor another colour
    assert colour.min() > 0.6 * plain.min()


def test_an_image_that_is_there_stays(tmp_path):
    def whole(folder, tree, here):
        for number in range(3):
            made.picture(bpy, folder / f"own_{number:04}.png")
        made.picture(bpy, folder / "own.1001.png")
        node = shown(tree, image_of("SEQUENCE", "//own_0000.png"))
        node.image_user.frame_duration = 2
        shown(tree, image_of("TILED", "//own.<UDIM>.png"), "Emission Color")

    _, notes = opened(tmp_path, whole)
    assert not any("missing" in note for note in notes), notes
    images = [n.image for n in bpy.data.materials["paint"].node_tree.nodes if n.type == "TEX_IMAGE"]
    assert [image.source for image in images] == ["SEQUENCE", "TILED"]


def test_a_missing_image_of_the_sky_leaves_its_colour_and_counts_as_no_light(tmp_path):
    def lost_sky(folder, tree, here):
        room = made.box(bpy, "room", (-3, -3, -3), (3, 3, 5), bpy.data.materials["paint"])
        room.data.flip_normals()
        sky = here.world.node_tree
        node = sky.nodes.new("ShaderNodeTexEnvironment")
        node.image = image_of("FILE", "//lost.exr")
        sky.links.new(node.outputs["Color"], sky.nodes["Background"].inputs["Color"])

    colour, notes = opened(tmp_path, lost_sky)
    assert any("lost.exr" in note for note in notes), notes
    assert any("sky is missing" in note and "lamps" in note for note in notes), notes
    assert not bpy.context.scene.world.node_tree.nodes["Background"].inputs["Color"].is_linked
    assert colour.min() > 0.05 and colour.max() < 1.2 * colour.min()


def test_pictures_that_take_much_memory_are_counted_and_freed(tmp_path):
    made.fresh(bpy)
    images = []
    for number in range(4):
        written = made.picture(bpy, tmp_path / f"{number}.png", size=16)
        images.append(bpy.data.images.load(written.filepath))
    decoded = DecodedPictures(much=2 * 16 * 16 * 4)
    for image in images:
        assert image.size[0] == 16
        decoded.add(image)
    assert decoded.notes() == ["4 pictures take 0.0 GB of memory in each process that renders"]
    assert [image.has_data for image in images] == [True, True, False, False]
    few = DecodedPictures()
    few.add(images[0])
    assert few.notes() == [] and images[0].has_data


def test_a_group_of_two_materials_has_the_plain_colour_of_each(tmp_path):
    made.fresh(bpy)
    colours = {"red": (0.8, 0.1, 0.1, 1.0), "blue": (0.1, 0.1, 0.8, 1.0)}
    for name, colour in colours.items():
        material = made.material(bpy, name)
        material.diffuse_color = colour
        made.box(bpy, name, (-1, -1, -1), (1, 1, 1), material)
        if name == "red":
            in_a_group(tmp_path, material.node_tree, None)
        else:  # the same group, within another one
            outer = bpy.data.node_groups.new("outer", "ShaderNodeTree")
            inner = outer.nodes.new("ShaderNodeGroup")
            inner.node_tree = bpy.data.node_groups["group"]
            outer.interface.new_socket("Colour", in_out="OUTPUT", socket_type="NodeSocketColor")
            outer.links.new(inner.outputs[0], outer.nodes.new("NodeGroupOutput").inputs[0])
            material.node_tree.nodes.new("ShaderNodeGroup").node_tree = outer
    missing_images.replace_missing(bpy.context.scene)

    def group_of(tree):
        return next(node.node_tree for node in tree.nodes if node.type == "GROUP")

    groups = {name: group_of(bpy.data.materials[name].node_tree) for name in colours}
    groups["blue"] = group_of(groups["blue"])
    for name, group in groups.items():
        output = next(node for node in group.nodes if node.type == "GROUP_OUTPUT")
        assert tuple(output.inputs[0].default_value) == pytest.approx(colours[name])
