"""The built-in scenes and trajectories, their folders (in the installed package, or at the top
level of the checkout), and the cache folder.

The code that builds the scenes is in blend/builder/ of the repository.
"""

import os
import platform
import subprocess
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from itertools import product
from pathlib import Path

from .errors import InputError, StrPath

_PACKAGE = Path(__file__).resolve().parent
#: Environment variable that gives a worker behind its wall, where git reads nothing, the commit.
COMMIT = "ICLNUIM_SOURCE_COMMIT"
_AGAIN = "installing iclnuim again"


@dataclass(frozen=True)
class SceneEntry:
    """A scene shipped as blend/NAME.blend, with its trajectories in trajectories/NAME/; `title` and
    `description` are shown to users. in_paper: one of the paper's two rooms.
    """

    name: str
    title: str
    description: str
    in_paper: bool = False


SCENES = {
    "living_room": SceneEntry(
        "living_room", "Living room", "4.94 x 5.02 x 2.50 m, after the paper's (section III)", True
    ),
    "office": SceneEntry(
        "office", "Office", "5.0 x 7.4 x 2.40 m, after the paper's (section III)", True
    ),
}

#: name -> description; the paper's rooms have all of them
TRAJECTORIES: dict[str, str] = {
    "kt0": "1510 frames (paper, Table I); passes a bare wall",
    "kt1": "967 frames (paper, Table I)",
    "kt2": "882 frames (paper, Table I)",
    "kt3": "1242 frames (paper, Table I); closes a small loop",
}
#: full name -> description; made to be difficult, not among the paper's eight sequences
HARD_SEQUENCES: dict[str, str] = {
    "living_room/window": "882 frames; a balcony window fills up to 43 % of the picture, "
    "and the floor mirrors it",
}
SCENE_NAMES = tuple(SCENES)
TRAJECTORY_NAMES = tuple(TRAJECTORIES)


def folder(name: str) -> Path:
    """The path of the folder `blend` or `trajectories`.

    Raises InputError if it is neither in the package nor in the checkout.
    """
    for place in (_PACKAGE / name, _PACKAGE.parents[1] / name):
        if place.is_dir():
            return place
    expected = f"a folder {name}/ in the package or the checkout"
    raise InputError(expected, path=_PACKAGE, hint=_AGAIN)


def is_scene(name: str) -> bool:
    return name in SCENES


def scene_file(name: str) -> Path:
    """The .blend of a shipped scene. Raises InputError if it is missing."""
    path = folder("blend") / f"{name}.blend"
    if not path.is_file():
        raise InputError("the shipped scene", path=path, found="no such file", hint=_AGAIN)
    return path


def has_light(scene: str) -> bool:
    """Whether a built-in scene has a light map in blend/light/NAME."""
    return (folder("blend") / "light" / scene).is_dir()


def cache_folder() -> Path:
    """The cache folder: ICLNUIM_CACHE, or iclnuim in XDG_CACHE_HOME, or ~/.cache/iclnuim."""
    if own := os.environ.get("ICLNUIM_CACHE"):
        return Path(own).expanduser()
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache").expanduser() / "iclnuim"


def paper_sequences() -> list[str]:
    """The names of the eight sequences of the paper's Table I."""
    return ["/".join(names) for names in product(paper_scenes(), TRAJECTORY_NAMES)]


def paper_scenes() -> list[str]:
    """The names of the paper's two rooms."""
    return [name for name, scene in SCENES.items() if scene.in_paper]


def further_sequences() -> list[str]:
    """The names of the sequences of scenes that the paper does not have."""
    found = []
    for name, scene in SCENES.items():
        if not scene.in_paper:
            files = sorted((folder("trajectories") / name).glob("*.txt"))
            found += [f"{name}/{file.stem}" for file in files]
    return found


def sequence_names() -> list[str]:
    """The names of all sequences that can be rendered, such as `living_room/kt0`; the paper's eight
    first.
    """
    names = [*paper_sequences(), *HARD_SEQUENCES]
    there = [name for name in names if (folder("trajectories") / f"{name}.txt").is_file()]
    return [*there, *further_sequences()]


def full_name(sequence: str) -> str:
    """`kt2` -> `living_room/kt2`.

    Raises InputError with the list of sequences for an unknown name.
    """
    name = sequence if "/" in sequence else f"living_room/{sequence}"
    if name not in (known := sequence_names()):
        hint = "a recipe file, or {scene} and {trajectory}"
        raise InputError(f"a sequence: {', '.join(known)}", found=sequence, hint=hint)
    return name


def file_or_trajectory(text: StrPath) -> StrPath:
    """A file or a folder as it is; if there is none, the file of the built-in trajectory of that
    name, such as `office/kt0`, or `kt2` of the living room.
    """
    if not os.path.exists(text):
        for name in (text, f"living_room/{text}"):
            if name in sequence_names():
                return trajectory_file(str(name))
    return text


def trajectory_file(name: str) -> Path:
    """The TUM file of a sequence, such as `living_room/kt2`."""
    return folder("trajectories") / f"{full_name(name)}.txt"


def versions(*packages: str) -> dict[str, str | None]:
    """The versions of Python and of installed packages, for a recipe; None for a package that is
    not installed.
    """
    found: dict[str, str | None] = {"python": platform.python_version()}
    for name in packages:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = None
    return found


def source_commit() -> str | None:
    """The commit of the checkout that contains this file, with `+` if files were changed; None if
    the package is installed.
    """
    if (given := os.environ.get(COMMIT)) is not None:
        return given or None
    if not (_PACKAGE.parents[1] / ".git").exists():
        return None
    git = ["git", "describe", "--always", "--dirty=+", "--abbrev=40", "--exclude=*"]
    try:
        done = subprocess.run(
            git, cwd=_PACKAGE, capture_output=True, text=True, timeout=10, check=True
        )
        return done.stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None
