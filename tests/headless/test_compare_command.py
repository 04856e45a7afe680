"""`iclnuim compare`: recipes of which a part has another type are refused in one line with their
file.
"""

import numpy as np
import pytest
from iclnuim.formats.files import write_json
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
