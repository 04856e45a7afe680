"""What a .blend of Blender 5 says before it is opened: libraries whose datablocks are packed into it,
its working colour space, its version. The files are made byte by byte.
"""

import struct

import pytest
from iclnuim.scene_files import blend_names

#: Types with their sizes and members (type, name), as Blender describes them in its files.
TYPES = {
    "char": (1, ()),
    "float": (4, ()),
    "ID": (8, (("char", "name[8]"),)),
    "Library": (48, (("ID", "id"), ("char", "name[32]"), ("Library", "*archive_parent_library"))),
    "FileGlobal": (
        68,
        (
            ("char", "colorspace_scene_linear_name[32]"),
            ("float", "colorspace_scene_linear_to_xyz[9]"),
        ),
    ),
}
LIBRARY, GLOBAL = (list(TYPES).index(kind) - 2 for kind in ("Library", "FileGlobal"))


def dna():
    names = list(dict.fromkeys(name for _, members in TYPES.values() for _, name in members))
    types = list(TYPES)
    found = b"SDNANAME" + struct.pack("<i", len(names)) + "\0".join(names).encode() + b"\0"
    found += b"TYPE" + struct.pack("<i", len(types)) + "\0".join(types).encode() + b"\0"
    found += b"TLEN" + struct.pack(f"<{len(types)}H", *(size for size, _ in TYPES.values()))
    structs = [(k, members) for k, (_, members) in enumerate(TYPES.values()) if members]
    found += b"STRC" + struct.pack("<i", len(structs))
    for k, members in structs:
        numbers = [(types.index(kind), names.index(name)) for kind, name in members]
        found += struct.pack(f"<{2 + 2 * len(members)}H", k, len(members), *sum(numbers, ()))
    return found


def block(code, content, number=0, address=0):
    return struct.pack("<4siQqq", code, number, address, len(content), 1) + content


def library(address, name, parent=0):
    content = struct.pack("<8s32sQ", b"LIlib", name.encode(), parent)
    return block(b"LI", content, LIBRARY, address)


def saved(tmp_path, *blocks, version=502):
    file = tmp_path / "scene.blend"
    whole = b"".join((*blocks, block(b"DNA1", dna()), block(b"ENDB", b"")))
    file.write_bytes(b"BLENDER17-01v%04d" % version + whole)
    return file


def named(tmp_path, *blocks):
    file = saved(tmp_path, *blocks)
    return [name for _, what, name in blend_names.names(file) if what == "required"]


LINKED = block(b"ID", b"NTsmooth", address=7)
PACKED = block(b"NT", b"NTsmooth", address=8)


def test_a_library_of_which_all_is_packed_is_not_read(tmp_path):
    archive = library(2, "//../a.blend", parent=1)
    assert named(tmp_path, library(1, "//../a.blend"), archive, PACKED) == []


@pytest.mark.parametrize(
    "blocks",
    [
        (library(1, "//../a.blend"), PACKED),
        (library(1, "//../a.blend"), LINKED),
        (library(1, "//../a.blend"), LINKED, library(2, "//b.blend", parent=1), PACKED),
    ],
    ids=["no archive", "linked", "linked and packed"],
)
def test_a_library_from_which_anything_is_linked_is_named(tmp_path, blocks):
    assert named(tmp_path, *blocks) == ["//../a.blend"]


def test_an_archive_from_which_something_is_linked_is_named(tmp_path):
    blocks = library(1, "//../a.blend"), library(2, "//../b.blend", parent=1), LINKED
    assert named(tmp_path, *blocks) == ["//../b.blend"]


def working_space(name, matrix):
    """matrix: to XYZ, one colour a row, as Blender 5.2 stores it."""
    return block(b"GLOB", struct.pack("<32s9f", name.encode(), *matrix), GLOBAL)


REC709 = working_space(
    "Linear Rec.709",
    (0.412391, 0.212639, 0.0193308, 0.357585, 0.715169, 0.119195, 0.180481, 0.0721927, 0.950532),
)
REC2020 = working_space(
    "Linear Rec.2020",
    (0.636958, 0.2627, 0.0, 0.144617, 0.677998, 0.0280727, 0.168881, 0.0593017, 1.060985),
)
ACESCG = working_space(
    "ACEScg",
    (0.652238, 0.267672, -0.0053817, 0.128238, 0.674340, 0.0013691, 0.169983, 0.0579882, 1.0930701),
)


@pytest.mark.parametrize(("space", "name"), [(REC2020, "Linear Rec.2020"), (ACESCG, "ACEScg")])
def test_another_working_colour_space_is_refused_by_name(tmp_path, space, name):
    pytest.importorskip("bpy", reason="needs the bpy package")
    from iclnuim.blender.open import saved_by
    from iclnuim.errors import InputError

    with pytest.raises(InputError, match=f"Rec.709, found {name}; try .*Working Space"):
        saved_by.check(saved(tmp_path, space))


def test_a_file_of_a_newer_blender_has_a_note(tmp_path):
    bpy = pytest.importorskip("bpy", reason="needs the bpy package")
    from iclnuim.blender.open import saved_by

    major, minor = bpy.app.version[:2]
    own = 100 * major + minor
    assert saved_by.check(saved(tmp_path, REC709, version=own)) == []
    (note,) = saved_by.check(saved(tmp_path, REC709, version=own + 1))
    assert f"newer Blender {major}.{minor + 1}" in note


def test_a_library_in_another_working_colour_space_is_refused_where_it_is_not_converted(tmp_path):
    bpy = pytest.importorskip("bpy", reason="needs the bpy package")
    from iclnuim.blender import compat
    from iclnuim.blender.open import saved_by
    from iclnuim.errors import InputError

    library = tmp_path / "library.blend"
    bpy.ops.wm.read_factory_settings()
    bpy.ops.wm.save_as_mainfile(filepath=str(library))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(library), link=True) as (there, linked):
        linked.objects = there.objects[:1]
    saved_by.check_libraries(tmp_path / "own.blend")
    saved(tmp_path, ACESCG).rename(library)
    if compat.converts_libraries():
        saved_by.check_libraries(tmp_path / "own.blend")
        return
    with pytest.raises(InputError, match=r"own.blend: .* \(library.blend\), found ACEScg; try"):
        saved_by.check_libraries(tmp_path / "own.blend")
