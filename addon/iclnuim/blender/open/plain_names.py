"""Names of a user-provided scene that cannot be written into lists, tables and messages."""

import re
from collections.abc import Iterator
from itertools import chain

import bpy
from bpy.types import ID, NodeTree, bpy_struct

#: Control characters and separators of lines; a sign that makes a formula of a field of a table.
_UNUSABLE = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff]|^=")
#: Instead of bytes that Blender keeps and Python cannot read.
_NOT_UTF_8 = "name not in UTF-8"


def plain(name: str) -> str:
    """The name with `_` for each character that cannot be in a line of a table."""
    return _UNUSABLE.sub("_", name)


def rename() -> list[str]:
    """Rename the blocks of the open session whose names are not UTF-8 or not plain, and replace
    other texts in them that are not UTF-8. Returns a note if there are any.
    """
    data = bpy.data
    kinds = [entry.identifier for entry in data.bl_rna.properties if entry.type == "COLLECTION"]
    blocks = chain.from_iterable([*getattr(data, kind)] for kind in kinds)
    own = [block for block in blocks if block.library is None]
    inside = chain.from_iterable(map(_inside, own))
    count = sum(map(_rename, own)) + sum(map(_make_readable, inside))
    return [f"{count} names with unusual characters: changed"] if count else []


def _rename(block: ID) -> bool:
    try:
        name = plain(block.name)
        if name == block.name:
            return False
    except UnicodeDecodeError:
        name = _NOT_UTF_8
    block.name = name
    return True


def _inside(block: ID) -> Iterator[bpy_struct]:
    """View layers, nodes, attributes and UV maps: what else in a block we read texts of."""
    yield from [*getattr(block, "view_layers", ()), *getattr(block, "attributes", ())]
    tree = block if isinstance(block, NodeTree) else getattr(block, "node_tree", None)
    if tree is not None:
        yield from tree.nodes


def _make_readable(thing: bpy_struct) -> bool:
    """Replace its texts that are not UTF-8: a UV map and a node that names it still agree."""
    unreadable = []
    for entry in thing.bl_rna.properties:
        try:
            if entry.type == "STRING" and not entry.is_readonly:
                getattr(thing, entry.identifier)
        except UnicodeDecodeError:
            unreadable.append(entry.identifier)
    for name in unreadable:
        setattr(thing, name, _NOT_UTF_8)
        thing.id_data.update_tag()
    return bool(unreadable)
