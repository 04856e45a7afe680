"""`iclnuim compare`: every file is compared, images by their channel; recipes of which a part has
another type are refused in one line with their file.
"""

import json

import numpy as np
import pytest
from iclnuim.formats.files import write_json
from iclnuim.formats.images import write_array, write_jpeg
from iclnuim.formats.png import write_png


@pytest.mark.parametrize(
    ("name", "recipe", "message"),
    [
        ("recipe.json", {"source": []}, "expected a JSON object as source, found []"),
        ("recipe.json", {"source": {"run": 3}}, "expected a JSON object as run, found 3"),
        ("sequence.json", {"machine": None}, "expected a JSON object as machine, found null"),
        (
            "sequence.json",
            {"machine": {"features": None}},
            "expected a list as features, found null",
        ),
        (
            "sequence.json",
            {"machine": {"features": "avx"}},
            'expected a list as features, found "avx"',
        ),
    ],
)
def test_a_part_of_another_type_is_refused(name, recipe, message, tmp_path, command_here):
    write_json(tmp_path / name, recipe)
    code, _, error = command_here("compare", tmp_path, tmp_path)
    assert (code, error) == (2, f"iclnuim compare: {tmp_path / name}: {message}\n")


def test_images_that_come_from_no_run_are_compared(tmp_path, command_here):
    (tmp_path / "depth").mkdir()
    write_png(tmp_path / "depth/0.png", np.ones((480, 640), np.uint16))
    write_json(tmp_path / "recipe.json", {"source": {"images": "x"}})
    assert command_here("compare", tmp_path, tmp_path)[0] == 0


def image_with(kind, share, difference):
    """An image of a kind of which this share of the pixels differs by `difference` from the image
    with share 0.
    """
    shape = (200, 100, 3) if kind in ("rgb", "normal") else (200, 100)
    steps = {"rgb": 1.0, "depth": 5000.0, "normal": 32767.0}[kind]
    image = np.full(shape, 100 if kind == "rgb" else 20000)
    image[: round(200 * share)] += round(difference * steps)
    return image.astype(np.uint8 if kind == "rgb" else np.uint16)


@pytest.mark.parametrize(
    ("kind", "share", "difference", "code"),
    [
        ("rgb", 0.015, 3.0, 0),
        ("rgb", 0.015, 4.0, 3),
        ("depth", 0.015, 0.0008, 0),
        ("depth", 0.015, 0.0014, 3),
        ("normal", 0.015, 0.008, 0),
        ("normal", 0.015, 0.014, 3),
        ("rgb", 0.01, 50.0, 0),
    ],
)
def test_renders_of_two_processors_differ_by_rounding_and_at_edges_only(
    kind, share, difference, code, tmp_path, command_here
):
    """Rounding: 3 of 255, 1 mm, a hundredth of a unit normal. Edges: one pixel in a hundred."""
    for name, share_there in (("a", 0.0), ("b", share)):
        (tmp_path / name / kind).mkdir(parents=True)
        write_png(tmp_path / name / kind / "0.png", image_with(kind, share_there, difference))
        write_json(tmp_path / name / "recipe.json", {"source": {"images": "x"}})
        camera = {"width": 100, "height": 200, "fx": 90.0, "fy": 90.0, "cx": 49.5, "cy": 99.5}
        write_json(tmp_path / name / "camera.json", camera)
    assert command_here("compare", "--tolerance", tmp_path / "a", tmp_path / "b")[0] == code


GREY = np.full((48, 64, 3), 100, np.uint8)
METRES = np.full((48, 64), 2.0)


def told_of(two, command_here, *options):
    """Exit code and what `compare --json` says of two folders."""
    for folder in two:
        write_json(folder / "recipe.json", {"source": {"images": folder.name}})
    code, out, _ = command_here("compare", *options, *two, "--json")
    return code, json.loads(out)


@pytest.fixture
def two(tmp_path):
    """Two folders with the same colour image."""
    folders = (tmp_path / "a", tmp_path / "b")
    for folder in folders:
        (folder / "rgb").mkdir(parents=True)
        write_png(folder / "rgb/0.png", GREY)
    return folders


@pytest.mark.parametrize(
    ("name", "write", "image", "near", "far"),
    [
        ("depth_left/0_depth.npy", write_array, METRES, METRES + 0.0008, METRES + 0.0014),
        ("depth_left/0_depth.npy", write_array, METRES, METRES + 0.0008, METRES + np.nan),
        ("frames/color/0.jpg", write_jpeg, GREY, GREY + 2, GREY + 9),
    ],
)
def test_arrays_and_jpegs_are_compared_too(two, command_here, name, write, image, near, far):
    for folder in two:
        (folder / name).parent.mkdir(parents=True)
        write(folder / name, image)
    assert told_of(two, command_here)[0] == 0
    write(two[1] / name, near.astype(image.dtype))
    code, told = told_of(two, command_here)
    assert code == 3 and list(told["different"]) == [name]
    assert told_of(two, command_here, "--tolerance")[0] == 0
    write(two[1] / name, far.astype(image.dtype))
    code, told = told_of(two, command_here, "--tolerance")
    assert code == 3 and list(told["different"]) == [name]


@pytest.mark.parametrize("options", [(), ("--tolerance",)])
@pytest.mark.parametrize("name", ["groundtruth.txt", "mav0/cam0/data.csv", "labels/0.npy"])
def test_a_file_that_is_no_image_is_compared_byte_for_byte(two, command_here, name, options):
    for folder in two:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"1 2 3")
        (folder / "frames.jsonl").write_text(folder.name)  # the hashes of the images
    assert told_of(two, command_here, *options)[0] == 0
    (two[1] / name).write_bytes(b"1 2 4")
    code, told = told_of(two, command_here, *options)
    assert code == 3 and told["different"] == {name: []}
    (two[1] / name).unlink()
    code, told = told_of(two, command_here, *options)
    assert code == 3 and told["only_in_one"] == [name]


@pytest.mark.parametrize(
    ("name", "channel"),
    [
        ("depth_0/0.png", "depth"),
        ("sensors/depth0/data/0.png", "depth"),
        ("results/depth000000.png", "depth"),
        ("camera/0.png", "depth"),
        ("class_0/0.png", "class"),
        ("results/instance000000.png", "instance"),
        ("semantic_class/semantic_class_0.png", "class"),
        ("semantic_instance/semantic_instance_0.png", "instance"),
    ],
)
def test_the_channel_of_an_image_is_known_in_every_layout(two, command_here, name, channel):
    """4 mm, or another label, is beyond the tolerance; of colour, 20 of 255 would be meant."""
    for value, folder in zip((10000, 10020), two, strict=True):
        (folder / name).parent.mkdir(parents=True)
        write_png(folder / name, np.full((480, 640), value, np.uint16))
    told = told_of(two, command_here, "--tolerance")[1]
    assert told["different"] == {name: [channel]}
