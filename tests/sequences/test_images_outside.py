"""Images that a sequence's lists name outside its folder are refused, unless the user allows them."""

import json

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.formats.png import write_png
from iclnuim.headless import cli
from iclnuim.sequences.stored_sequence import StoredSequence

POSE = np.eye(4).tolist()
LENS = {"fl_x": 60, "fl_y": 60, "cx": 31.5, "cy": 23.5, "w": 64, "h": 48}


def tum(folder, rgb, depth):
    (folder / "associations.txt").write_text(f"0 {rgb} 0 {depth}\n")
    (folder / "groundtruth.txt").write_text("0 0 0 0 0 0 0 1\n")


def lists(folder, rgb, depth):
    for kind, name in (("rgb", rgb), ("depth", depth)):
        (folder / f"{kind}.txt").write_text(f"0 {name}\n")


def euroc(folder, rgb, depth):
    for sensor, name in (("cam0", rgb), ("depth0", depth)):
        (folder / f"mav0/{sensor}/data").mkdir(parents=True)
        name = name if name.startswith("/") else f"../../../{name}"
        (folder / f"mav0/{sensor}/data.csv").write_text(f"#t,f\n0,{name}\n")


def nerf(folder, rgb, depth):
    frame = {"file_path": rgb, "depth_file_path": depth, "transform_matrix": POSE}
    (folder / "transforms.json").write_text(json.dumps({**LENS, "frames": [frame]}))


@pytest.fixture
def folder(tmp_path):
    for place in ("sequence/images", "outside"):
        (tmp_path / place).mkdir(parents=True)
        write_png(tmp_path / place / "rgb.png", np.full((48, 64, 3), 90, np.uint8))
        write_png(tmp_path / place / "depth.png", np.full((48, 64), 5000, np.uint16))
    return tmp_path / "sequence"


FORMS = pytest.mark.parametrize("form", [tum, lists, euroc, nerf])


@FORMS
@pytest.mark.parametrize("place", ["../outside", "{folder}/../outside", "images/../../outside"])
@pytest.mark.parametrize("kind", ["rgb", "depth"])
def test_an_image_outside_is_refused_in_a_line_that_names_it(folder, form, place, kind):
    names = {one: f"images/{one}.png" for one in ("rgb", "depth")}
    names[kind] = f"{place.format(folder=folder)}/{kind}.png"
    form(folder, **names)
    with pytest.raises(InputError, match=rf"found \.\./outside/{kind}\.png; try .*allow_outside"):
        _ = StoredSequence(folder).pairs
    assert len(StoredSequence(folder, allow_outside=True).pairs) == 1


@FORMS
def test_images_inside_and_links_of_the_user_are_read(folder, form):
    (folder / "linked").symlink_to(folder.parent / "outside")
    form(folder, "linked/rgb.png", "images/../images/depth.png")
    assert len(StoredSequence(folder).pairs) == 1


def test_dots_after_a_link_lead_out_of_the_folder(folder):
    (folder.parent / "far/deep").mkdir(parents=True)
    (folder / "linked").symlink_to(folder.parent / "far/deep")
    tum(folder, "linked/../../outside/rgb.png", "images/depth.png")
    with pytest.raises(InputError, match="outside"):
        _ = StoredSequence(folder).pairs


def test_convert_has_the_option(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder.parent)
    tum(folder, "../outside/rgb.png", "../outside/depth.png")
    words = ["convert", "sequence", "--camera", "64x48,60,60,31.5,23.5", "-o", "out"]
    assert cli.main(words) == 2
    assert "try --allow-outside" in capsys.readouterr().err
    assert cli.main([*words, "--allow-outside"]) == 0


def test_inspect_and_view_have_the_option(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder.parent)
    lens = {"width": 64, "height": 48, "fx": 60, "fy": 60, "cx": 31.5, "cy": 23.5}
    (folder / "camera.json").write_text(json.dumps(lens))
    tum(folder, "../outside/rgb.png", "../outside/depth.png")
    for words in (["inspect", "sequence"], ["view", "sequence", "--no-open", "-o", "a.html"]):
        assert cli.main(words) == 2
        shown = capsys.readouterr()
        assert "--allow-outside" in shown.out + shown.err
        assert cli.main([*words, "--allow-outside"]) == 0
