"""Libraries of a .blend of Blender 5 whose datablocks are packed into it, in files made byte by byte."""

import struct

import pytest
from iclnuim.scene_files import blend_names

#: Types with their sizes and members (type, name), as Blender describes them in its files.
TYPES = {
    "char": (1, ()),
    "ID": (8, (("char", "name[8]"),)),
    "Library": (48, (("ID", "id"), ("char", "name[32]"), ("Library", "*archive_parent_library"))),
}
LIBRARY = list(TYPES).index("Library") - 1  # among the structs, which `char` is not


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


def named(tmp_path, *blocks):
    file = tmp_path / "scene.blend"
    whole = b"".join((*blocks, block(b"DNA1", dna()), block(b"ENDB", b"")))
    file.write_bytes(b"BLENDER17-01v0502" + whole)
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
