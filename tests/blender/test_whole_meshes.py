"""Meshes of other programs as scenes: Blender's importers read them whole, or they are refused."""

import sys
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")
sys.path.insert(0, str(Path(__file__).parents[1] / "formats"))
import mesh_files as made  # noqa: E402
from iclnuim.blender.open import importers  # noqa: E402
from iclnuim.errors import InputError  # noqa: E402
from iclnuim.native_output import native_output_in  # noqa: E402


def area_as_imported(path):
    for mesh in list(bpy.data.meshes):
        bpy.data.meshes.remove(mesh)
    with native_output_in(path.with_suffix(".log")):
        importers.load(path)
    return sum(face.area for mesh in bpy.data.meshes for face in mesh.polygons)


@pytest.mark.parametrize(
    ("kind", "name"), [(kind, name) for kind in ("obj", "ply") for name in made.FILES[kind]]
)
def test_a_box_is_imported_whole_or_refused(tmp_path, kind, name):
    path = tmp_path / f"box.{kind}"
    path.write_bytes(made.content(kind, name))
    try:
        area = area_as_imported(path)
    except InputError as error:
        assert "Blender can read" in str(error) and str(path) in str(error)
    else:
        assert area == pytest.approx(24, rel=1e-5)


def test_faces_beyond_the_vertices_are_refused_with_their_line(tmp_path):
    path = tmp_path / "box.obj"
    path.write_text(made.V + made.F + "f 1 2 99\n")
    with pytest.raises(InputError, match=r":21: expected faces of vertices 1\.\.8, found 99"):
        area_as_imported(path)


def test_faces_that_stand_twice_or_are_not_valid_may_be_missing(tmp_path):
    path = tmp_path / "box.obj"
    path.write_text(made.V + made.F + made.F + "f 1 1 2\n")
    assert area_as_imported(path) in (pytest.approx(24), pytest.approx(48))


@pytest.mark.parametrize(("imported", "is_whole"), [(20, True), (19, True), (17, False)])
def test_a_tenth_of_the_faces_may_be_missing(tmp_path, imported, is_whole):
    triangles = np.arange(60).reshape(20, 3)
    try:
        importers._check_whole(tmp_path / "box.obj", triangles, imported)
    except InputError as error:
        assert not is_whole and f"20 triangles that Blender can read, found {imported}" in str(
            error
        )
    else:
        assert is_whole
