"""Names that a scene gives: lines of tables and messages stay lines."""

import csv

import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")
from iclnuim.blender.open import plain_names  # noqa: E402
from iclnuim.channels import CHANNELS  # noqa: E402
from iclnuim.dataset.ground_truth import FurtherImages  # noqa: E402
from iclnuim.formats.files import write_json  # noqa: E402


def test_names_of_a_scene_are_one_line_each():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    for name in ("lamp\nv 1 2 3", "=HYPERLINK()", "Stuhl, groß"):
        bpy.data.objects.new(name, None)
    assert plain_names.rename() == ["2 names with unusual characters: changed"]
    assert {o.name for o in bpy.data.objects} == {"lamp_v 1 2 3", "_HYPERLINK()", "Stuhl, groß"}
    assert plain_names.rename() == []


def test_classes_are_four_fields_whatever_their_names(tmp_path):
    kinds = [{"id": 1, "name": 'wall, "red"', "nyu40_id": 1, "nyu40": "wall"}]
    write_json(tmp_path / "objects.json", {"objects": [], "classes": kinds})
    FurtherImages(tmp_path, tuple(CHANNELS.values())).write_tables(tmp_path)
    with open(tmp_path / "classes.csv", newline="") as file:
        assert list(csv.reader(file))[1] == ["1", 'wall, "red"', "1", "wall"]
