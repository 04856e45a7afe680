"""The recipe of a sequence, recipe.json: everything that determines the pixels, the versions of the
programs, and counts. The same recipe gives the same bytes.
"""

import platform
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..formats.files import is_file, read_json
from ..formats.libraries import first_library
from ..formats.png import COMPRESSORS
from ..shipped import source_commit
from ..version import __version__
from .format import UNRECORDED, SequenceFormat
from .frame_source import FrameSource
from .record import Record
from .run_folder import run_key
from .sequence_options import SequenceSettings

RECIPE = "recipe.json"
_SCHEMA_VERSION = 1
#: Keys that determine the files; the others may differ when a sequence is resumed.
_IDENTITY = (
    "schema_version",
    "source",
    "camera",
    "depth_noise",
    "rgb_noise",
    "imu_noise",
    "seed",
    "depth_units_per_metre",
    "names",
)
#: What a recipe without noise of an IMU means.
_NO_IMU_NOISE = {"model": "none"}
#: format_in_folder: the format in the folder itself, to which formats in subfolders were added
#: later.
_OTHERS = (
    "kind",
    "formats",
    "format_in_folder",
    "versions",
    "source_commit",
    "finished",
    "frames",
    "invalid_depth_pixels",
)


def new_recipe(
    source: FrameSource, settings: SequenceSettings, formats: Sequence[SequenceFormat]
) -> dict[str, Any]:
    """The recipe of a sequence that is not finished."""
    name, module = first_library("PNG", *COMPRESSORS)
    library = str(getattr(module, "ZLIB_RUNTIME_VERSION", None) or module.__version__)
    return {
        "schema_version": _SCHEMA_VERSION,
        "kind": "sequence",
        "source": source.origin,
        "camera": source.camera.to_dict(),
        **settings.to_dict(),
        "formats": [format.name for format in formats],
        "versions": {
            "iclnuim": __version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
            name: library,
        },
        "source_commit": source_commit(),
        "finished": False,
    }


def read_recipe(path: Path) -> dict[str, Any]:
    """Read a sequence's recipe.

    Raises InputError for another kind, a newer schema or unknown keys.
    """
    recipe = read_json(path)
    version = recipe.get("schema_version")
    if recipe.get("kind") != "sequence" or not isinstance(version, int):
        found = recipe.get("kind", "another file")
        raise InputError("the recipe of a sequence", path=path, found=found)
    if version > _SCHEMA_VERSION:
        raise InputError(f"a recipe of schema {_SCHEMA_VERSION} or older", path=path, found=version)
    unknown = sorted(recipe.keys() - {*_IDENTITY, *_OTHERS})
    if unknown:
        raise InputError("the keys of a sequence's recipe", path=path, found=", ".join(unknown))
    return recipe


def refuse_other_sequence(file: Path, begun: dict, requested: dict) -> None:
    """Raises InputError if the recipes differ.

    If the noise model differs, only its name is reported, not all of its settings.
    """
    there = _identity(begun)
    wanted = _identity(requested)
    if format_in_folder(begun) and format_in_folder(requested):
        # their files may have the same names
        there["format"] = format_in_folder(begun)
        wanted["format"] = format_in_folder(requested)
    for noise in ("depth_noise", "rgb_noise", "imu_noise"):
        model = f"{noise} model"
        if there.get(model) != wanted[model]:
            for key in [key for key in wanted if key.startswith(f"{noise} ") and key != model]:
                del wanted[key]
    Record("sequence", file, wanted, hint="another folder").refuse_other(
        {key: there.get(key) for key in wanted}
    )


def format_in_folder(recipe: dict) -> str:
    """The format whose files are in the sequence's folder itself; "" if each format has a
    subfolder.
    """
    formats = recipe.get("formats", ())
    return formats[0] if len(formats) == 1 else recipe.get("format_in_folder", "")


def _identity(recipe: dict) -> dict[str, Any]:
    """The values that determine the pixels, with each noise setting separately.

    A run is represented by its key.
    """
    identity = {"iclnuim": recipe.get("versions", {}).get("iclnuim")}
    for key in _IDENTITY:
        value = recipe.get(key, _NO_IMU_NOISE if key == "imu_noise" else None)
        if key.endswith("_noise") and isinstance(value, dict):
            identity |= {f"{key} {name}": each for name, each in value.items()}
        else:
            identity[key] = value
    run = recipe.get("source", {}).get("run")
    if isinstance(run, dict) and isinstance(run.get("job"), dict):
        identity["source"] = run_key(run)
    return identity


def form_of_folder(folder: Path, requested: str) -> str:
    """The form of the sequence that was started in a folder, if its recipe has none, else the
    requested one. Raises InputError for a recipe that is not JSON.
    """
    file = folder / RECIPE
    if file.is_file() and "names" not in read_json(file):
        return UNRECORDED
    return requested


def rendered_job(folder: Path) -> dict:
    """The job of the run that a sequence was made from, according to its recipe.json; {} for images
    of other origin.

    Raises InputError if the recipe is not JSON."""
    path = Path(folder) / RECIPE
    found: object = read_json(path) if is_file(path) else {}
    for key in ("source", "run", "job"):
        found = found.get(key) if isinstance(found, dict) else None
    return found if isinstance(found, dict) else {}


def sequence_name(folder: Path) -> str:
    """The name of a sequence in results: for example `living_room/kt2/clean` if its recipe contains
    the sequence, else its last two folders.

    Raises InputError if the recipe is not JSON."""
    folder = Path(folder).resolve()
    sequence = rendered_job(folder).get("sequence")
    if isinstance(sequence, str) and sequence:
        return f"{sequence}/{folder.name}"
    return "/".join(folder.parts[-2:])
