"""What a .blend says of the Blender that saved it, read before it is opened: its version, and the
colour space in which its colours are numbers.
"""

import struct
from pathlib import Path

import bpy
import numpy as np

from ...errors import InputError
from ...scene_files.blend_file import BlendFile, text
from .. import compat

#: Linear Rec.709 to XYZ, one colour a row, as Blender stores it (IEC 61966-2-1, white D65).
_REC709 = ((0.4124, 0.2126, 0.0193), (0.3576, 0.7152, 0.1192), (0.1805, 0.0722, 0.9505))
#: The figures of the standard have four digits; the nearest other space, Rec.2020, differs by 0.2.
_SAME = 0.01


def check(path: Path) -> list[str]:
    """A note for a .blend that a newer Blender saved, which this one reads in part.

    Raises InputError for one with another working colour space: this Blender would take its numbers
    for other colours.
    """
    try:
        blend = BlendFile(path)
        space = _other_space(blend)
    except InputError:
        raise
    except Exception as error:  # as for any damaged file
        damage = f"damaged blocks: {error}"
        raise InputError("a scene that Blender can read", path=path, found=damage) from None
    if space is not None:
        hint = "setting Render > Color Management > Working Space in Blender, and saving the file"
        expected = "the working colour space Linear Rec.709"
        raise InputError(expected, path=path, found=space, hint=hint)
    own = bpy.app.version[:2]
    if blend.version <= own:
        return []
    newer, this = (f"{major}.{minor}" for major, minor in (blend.version, own))
    lost = f"Blender {this} may lose data of it, as Blender warns"
    return [f"the file was saved by the newer Blender {newer}: {lost}"]


def check_libraries(path: Path) -> None:
    """Raises InputError if the open file `path` links datablocks of a library with another working
    colour space, and this Blender does not convert them.
    """
    if compat.converts_libraries():
        return
    for library in bpy.data.libraries:
        file = Path(bpy.path.abspath(library.filepath))
        if file.is_file() and (space := _other_space(BlendFile(file))) is not None:
            hint = "Blender 5, which converts it, or saving the library with that working space"
            expected = f"libraries with the working colour space Linear Rec.709 ({file.name})"
            raise InputError(expected, path=path, found=space, hint=hint)


def _other_space(blend: BlendFile) -> str | None:
    """The name of the file's working colour space, from Blender 5.0 on; None for Rec.709."""
    for _, kind, data in blend.each({"FileGlobal"}):
        fields = blend.fields[kind]
        matrix = fields.get("colorspace_scene_linear_to_xyz")
        name = fields.get("colorspace_scene_linear_name")
        if matrix is None or name is None:
            return None
        values = np.array(struct.unpack_from(f"{blend.order}9f", data, matrix.offset))
        if values.any() and not np.allclose(values.reshape(3, 3), _REC709, atol=_SAME):
            return text(data[name.offset : name.offset + name.length]) or "another one"
    return None
