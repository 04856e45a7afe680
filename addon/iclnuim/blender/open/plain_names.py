"""Names of a user-provided scene that cannot be written into lists, tables and messages."""

import re
from itertools import chain

import bpy

#: Control characters and separators of lines; a sign that makes a formula of a field of a table.
_UNUSABLE = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff]|^=")


def plain(name: str) -> str:
    """The name with `_` for each character that cannot be in a line of a table."""
    return _UNUSABLE.sub("_", name)


def rename() -> list[str]:
    """Rename the blocks of the open session whose names are not UTF-8 or not plain. Returns a note
    if there are any.
    """
    data = bpy.data
    kinds = [entry.identifier for entry in data.bl_rna.properties if entry.type == "COLLECTION"]
    blocks = chain.from_iterable([*getattr(data, kind)] for kind in kinds)
    count = sum(map(_rename, blocks))
    return [f"{count} names with unusual characters: changed"] if count else []


def _rename(block: bpy.types.ID) -> bool:
    try:
        name = plain(block.name)
        if name == block.name:
            return False
    except UnicodeDecodeError:  # Blender keeps bytes that are not UTF-8
        name = "name not in UTF-8"
    if block.library is not None:
        return False
    block.name = name
    return True
