"""The names of images in a sequence's folder: such as sort as time, or those of the published data
sets.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from ..formats.files import read_json
from .layout import SequenceFormat

RECIPE = "recipe.json"
SORTED = "sorted"
PUBLISHED = "published"
#: name -> what it means
NAME_FORMS = {
    SORTED: "names sort as time, as text too: stamps and numbers have a constant number of digits",
    PUBLISHED: "names as in the data sets of each format: rgb/0.png in icl-nuim, "
    "frames/color/0.jpg in scannet, no zeros before stamps in eth3d, euroc and rtabmap",
}
#: The form of a folder whose recipe has no form: published names, and, in these formats, the
#: requested depth units.
UNRECORDED = ""
_REQUESTED_UNITS = ("euroc", "nerf")


def form_of_folder(folder: Path, requested: str) -> str:
    """The form of the sequence that was started in a folder, if its recipe has none, else the
    requested one. Raises InputError for a recipe that is not JSON.
    """
    file = folder / RECIPE
    if file.is_file() and "names" not in read_json(file):
        return UNRECORDED
    return requested


def named(formats: Sequence[SequenceFormat], form: str) -> list[SequenceFormat]:
    """The formats with names of this form."""
    if form == SORTED:
        return list(formats)
    found = []
    for format in formats:
        if form == UNRECORDED and format.name in _REQUESTED_UNITS:
            format = replace(format, fixed_units=None)
        found.append(format.published)
    return found
