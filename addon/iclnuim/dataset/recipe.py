"""recipe.json of a sequence: what decided its pixels, what made it, what was counted. Same recipe, same bytes."""

import json
import platform
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from .. import __version__
from ..errors import InputError
from ..formats.files import make_folder, read_json, sha256, write_json
from ..formats.libraries import first_library
from ..formats.png import BACKENDS
from ..geometry.camera import PinholeCamera
from ..shipped import source_commit

SCHEMA_VERSION = 1
#: Keys that decide the pixels; the others may differ between two starts.
IDENTITY = ("schema_version", "source", "camera", "depth_noise", "rgb_noise", "seed", "depth_units_per_metre")
KEYS = ("kind", *IDENTITY, "dialects", "versions", "source_commit", "finished", "frames", "invalid_depth_pixels")


def begin(out: Path, origin: dict, camera: PinholeCamera, settings: dict, formats: list[str]) -> dict:
    """Make `out` with the recipe of a sequence not yet finished, or resume the one begun there.

    Raises InputError where a file is in the way, where other files lie there, or a sequence of another recipe.
    """
    name, module = first_library("PNG", *BACKENDS)
    library = str(getattr(module, "__version__", None) or getattr(module, "VERSION_STRING", ""))
    versions = {"iclnuim": __version__, "python": platform.python_version(), "numpy": np.__version__, name: library}
    recipe = {
        "schema_version": SCHEMA_VERSION,
        "kind": "sequence",
        "source": origin,
        "camera": camera.to_dict(),
        **settings,
        "dialects": formats,
        "versions": versions,
        "source_commit": source_commit(),
        "finished": False,
    }
    file = out / "recipe.json"
    if file.is_file():
        _refuse_other_sequence(file, read_recipe(file), recipe)
    elif out.exists() and (not out.is_dir() or any(not p.name.startswith(".") for p in out.iterdir())):
        found = "other files" if out.is_dir() else "a file"
        raise InputError("an empty folder, or a sequence begun there", path=out, found=found, hint="another folder")
    make_folder(out)
    write_json(file, recipe)
    return recipe


def finish(folders: tuple[Path, ...], recipe: dict, numbers: tuple[int, ...], invalid: dict[str, int]) -> None:
    """The recipe with its counts, beside the sequence in every format."""
    frames = {"count": len(numbers), "first": numbers[0], "last": numbers[-1]}
    counted = {**recipe, "finished": True, "frames": frames, "invalid_depth_pixels": invalid}
    for folder in folders:
        write_json(folder / "recipe.json", counted)


def read_recipe(path: Path) -> dict:
    """A sequence's recipe. Raises InputError for another kind, a newer schema or unknown keys."""
    recipe = read_json(path)
    version = recipe.get("schema_version")
    if recipe.get("kind") != "sequence" or not isinstance(version, int):
        raise InputError("the recipe of a sequence", path=path, found=recipe.get("kind", "another file"))
    if version > SCHEMA_VERSION:
        raise InputError(f"a recipe of schema {SCHEMA_VERSION} or older", path=path, found=version)
    unknown = sorted(set(recipe) - set(KEYS))
    if unknown:
        raise InputError("the keys of a sequence's recipe", path=path, found=", ".join(unknown))
    return recipe


def refuse_other(what: str, place: Path, there: Mapping, asked: Mapping, hint: str) -> None:
    """Raises InputError, naming every value that differs, where `what` was begun at `place` from other values than those asked for."""
    different = []
    for key in sorted({*there, *asked}):
        if there.get(key) != asked.get(key):
            text = f"{key} {there.get(key)} there, {asked.get(key)} asked"
            brief = len(text) < 100 and not key.endswith("_sha256")
            different.append(text if brief else f"another {key.removesuffix('_sha256')}")
    if different:
        raise InputError(f"the {what} that was begun there", path=place, found="; ".join(different), hint=hint)


def run_identity(recipe: dict) -> dict:
    """What decides the pixels of a run. Names and places of scene and trajectory do not: their hashes stand for them."""
    job = recipe["job"] if isinstance(recipe.get("job"), dict) else {}
    job = {key: value for key, value in job.items() if key not in ("sequence", "scene", "trajectory")}
    return {**job, **{key: recipe.get(key) for key in ("trajectory_sha256", "scene_sha256", "blender")}}


def run_key(recipe: dict) -> str:
    """16 hex digits that stand for everything that decides the pixels of a run."""
    return sha256(json.dumps(run_identity(recipe), sort_keys=True).encode())[:16]


def _refuse_other_sequence(file: Path, old: dict, new: dict) -> None:
    """Of another noise model only the name is reported, not all of its settings."""
    there, asked = _identity(old), _identity(new)
    models = [key for key in asked if key.endswith("_noise model") and there.get(key) != asked[key]]
    settings = tuple(key.removesuffix("model") for key in models)
    reported = [key for key in asked if key in models or not key.startswith(settings)]
    old, new = ({key: values.get(key) for key in reported} for values in (there, asked))
    refuse_other("sequence", file, old, new, "another folder")


def _identity(recipe: dict) -> dict:
    """What decides the pixels, noise settings one by one. Of a run's own recipe that is its key alone."""
    identity = {"iclnuim": recipe.get("versions", {}).get("iclnuim")}
    for key in IDENTITY:
        value = recipe.get(key)
        noise = value if key.endswith("_noise") and isinstance(value, dict) else None
        identity |= {key: value} if noise is None else {f"{key} {name}": each for name, each in noise.items()}
    run = recipe.get("source", {}).get("run")
    if isinstance(run, dict) and isinstance(run.get("job"), dict):
        identity["source"] = run_key(run)
    return identity
