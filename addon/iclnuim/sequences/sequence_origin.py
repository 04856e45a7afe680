"""What a sequence is made of and called, according to its recipe.json."""

from pathlib import Path

from ..formats.files import is_file, read_json


def rendered_job(folder: Path) -> dict:
    """The job of the run that a sequence was made from, according to its recipe.json; {} for images
    of other origin.

    Raises InputError if the recipe is not JSON.
    """
    path = Path(folder) / "recipe.json"
    found: object = read_json(path) if is_file(path) else {}
    for key in ("source", "run", "job"):
        found = found.get(key) if isinstance(found, dict) else None
    return found if isinstance(found, dict) else {}


def sequence_name(folder: Path) -> str:
    """The name of a sequence in results: for example `living_room/kt2/clean` if its recipe contains
    the sequence, else its last two folders.

    Raises InputError if the recipe is not JSON.
    """
    folder = Path(folder).resolve()
    sequence = rendered_job(folder).get("sequence")
    if isinstance(sequence, str) and sequence:
        return f"{sequence}/{folder.name}"
    return "/".join(folder.parts[-2:])
