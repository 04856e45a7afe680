"""Fluid domains of a .blend, found before the file is opened: a domain writes files, and may end
the process, when it is evaluated.
"""

from pathlib import Path

from ...errors import InputError
from ...scene_files.blend_file import BlendFile, text
from .. import compat
from . import scene_paths

#: Type of a fluid modifier, and the flag of a domain whose data are baked.
_DOMAIN = 1
_BAKED_DATA = 2


def refuse_fluids(path: Path) -> None:
    """Raises InputError if a .blend, or a library of it, has a fluid domain without a finished
    cache; in the bpy package, whose fluids do not work, if it has any.
    """
    expected, found = "baked fluids", "a fluid domain not baked"
    hint = "baking the fluid in Blender and saving the file, or deleting its domain"
    if compat.is_package():
        expected, found = "no fluids", "a fluid domain, which ends the bpy package"
        hint = "`blender -b -P headless/render.py` after the fluid is baked, or deleting its domain"
    for file in (path, *scene_paths.libraries(path)):
        try:
            is_left = _has_domain(BlendFile(file), None if compat.is_package() else file.parent)
        except InputError:
            raise
        except Exception as error:  # as for any damaged file
            damage = f"damaged blocks: {error}"
            raise InputError("a scene that Blender can read", path=file, found=damage) from None
        if is_left:
            raise InputError(expected, path=file, found=found, hint=hint)


def _has_domain(file: BlendFile, caches: Path | None) -> bool:
    """Whether there is a domain; with the folder of its `caches`, one without a finished cache."""
    domains = set()
    for _, kind, data in file.each({"FluidModifierData"}):
        fields = file.fields[kind]
        if data[fields["type"].offset] & _DOMAIN:
            domains.add(file.pointer(data, fields["*domain"].offset))
    for block, kind, data in file.each({"FluidDomainSettings"}):
        fields = file.fields[kind]
        name = fields["cache_directory"]
        place = text(data[name.offset : name.offset + name.length]).removeprefix("//")
        is_baked = bool(data[fields["cache_flag"].offset] & _BAKED_DATA)
        if block.address in domains and not (is_baked and caches and (caches / place).is_dir()):
            return True
    return False
