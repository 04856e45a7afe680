"""The archive for publication: a sequence's files, checksums, licence, preview, recipe.

The same files give the same bytes.
"""

import gzip
import io
import tarfile
import zlib
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path

from ..errors import InputError
from ..formats.files import atomic_write, read_bytes, sha256
from ..formats.image_names import is_visible
from ..shipped import SCENE_NAMES
from .journal import JOURNAL, read_entries
from .recipe import read_recipe, rendered_job
from .stored_sequence import StoredSequence

CHECKSUMS = "SHA256SUMS"
LICENCE = "LICENSE.txt"
ABOUT = "README.txt"
_IMAGES = (".png", ".jpg", ".npy")
_AGAIN = "the command that made the sequence, again"
#: The licence of sequences of the shipped rooms.
_OURS = "CC-BY-4.0"
#: Licences for data sets, by SPDX name.
LICENCES = {
    "CC-BY-4.0": (
        "Creative Commons Attribution 4.0 International",
        "https://creativecommons.org/licenses/by/4.0/",
    ),
    "CC-BY-SA-4.0": (
        "Creative Commons Attribution-ShareAlike 4.0 International",
        "https://creativecommons.org/licenses/by-sa/4.0/",
    ),
    "CC0-1.0": ("CC0 1.0 Universal", "https://creativecommons.org/publicdomain/zero/1.0/"),
}


def pack(
    folder: Path,
    archive: Path,
    licence: str = "",
    author: str = "",
    extra: Mapping[str, bytes] | None = None,
    on_file: Callable[[str], None] = lambda name: None,
) -> int:
    """Write `archive` (.tar.gz) with the files of `folder`, in a top folder of its name, and
    `extra` files by name. Returns the number of files. licence: as of packed_licence().

    SHA256SUMS can be checked with `sha256sum -c`. Raises InputError for a folder without a finished
    recipe, with images that are missing or not those that were made, or without a licence;
    WorkError if the archive cannot be written.
    """
    folder = Path(folder)
    licence = packed_licence(folder, licence)
    top = folder.resolve().name
    extra = {**(extra or {}), LICENCE: licence_text(top, licence, author), ABOUT: _about(folder)}
    names = sorted({*packed_names(folder), *extra} - {CHECKSUMS})

    def write(temporary: Path) -> None:
        sums = []
        images = MadeImages(folder)
        with (
            open(temporary, "wb") as raw,
            gzip.GzipFile("", "wb", compresslevel=1, fileobj=raw, mtime=0) as packed,
            tarfile.open(fileobj=packed, mode="w", format=tarfile.PAX_FORMAT) as tar,
        ):
            for name in names:
                data = extra[name] if name in extra else read_bytes(folder / name)
                digest = sha256(data)
                sums.append(f"{digest}  {name}\n")
                if name not in extra:
                    images.check(name, digest)
                add_file(tar, f"{top}/{name}", data)
                on_file(name)
            images.check_all()
            add_file(tar, f"{top}/{CHECKSUMS}", "".join(sums).encode())

    atomic_write(archive, write)
    return len(names) + 1


def licence_text(name: str, licence: str, author: str) -> bytes:
    """The content of the file LICENCE."""
    by = f" by {author}" if author else ""
    terms = f"{licence} (the licence as given)."
    if licence in LICENCES:
        title, address = LICENCES[licence]
        terms = f"{title} ({licence}).\n{address}"
    return f"The data set {name}{by} is under {terms}\n".encode()


def is_exact(folder: Path) -> bool:
    """Whether depth and poses are those of a render."""
    return bool(rendered_job(folder) and StoredSequence(folder).truth)


def _about(folder: Path) -> bytes:
    what = "with exact ground truth, made with" if is_exact(folder) else "written by"
    return _ABOUT.format(what=what).encode()


class MadeImages:
    """The images of a sequence by their hashes in its journal, and those found so far.

    Without a journal nothing is checked.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.found = Counter[str]()
        self.made = []
        for number, entry in sorted(read_entries(folder).items()):
            for kind, digest in entry.digests.items():
                if digest:
                    self.made.append((number, kind, digest))
        self.digests = {digest for _, _, digest in self.made}

    def check(self, name: str, digest: str) -> None:
        """Raises InputError for an image that was not made with the sequence, or has changed
        since.
        """
        self.found[digest] += 1
        if self.made and "/" in name and name.endswith(_IMAGES) and digest not in self.digests:
            expected = "the images that were made with the sequence"
            raise InputError(expected, path=self.folder / name, found="another image", hint=_AGAIN)

    def check_all(self) -> None:
        """Raises InputError if an image was not found.

        Frames may share images; then the last of them counts as missing.
        """
        for number, kind, digest in self.made:
            self.found[digest] -= 1
            if self.found[digest] < 0:
                found = f"none of frame {number} ({kind}) as it was made"
                expected = "all images of the sequence"
                raise InputError(expected, path=self.folder, found=found, hint=_AGAIN)


def packed_names(folder: Path) -> list[str]:
    """The files of a folder that `pack` includes: not the journal, hidden files or temporary
    files.
    """
    files = (path for path in Path(folder).rglob("*") if path.is_file())
    packed = (path for path in files if is_visible(path) and path.name != JOURNAL)
    return sorted(path.relative_to(folder).as_posix() for path in packed)


def packed_licence(folder: Path, licence: str = "") -> str:
    """The licence of the archive: `licence`, a name among LICENCES or any other, or CC BY 4.0 for
    a sequence of a shipped room.

    Raises InputError for a folder without a finished recipe, a link to a file outside, which would
    be published, no licence for other images, or one of several lines.
    """
    if not (folder / "recipe.json").is_file():
        hint = "the output folder of `iclnuim make`, `dataset`, `noise` or `convert`"
        raise InputError("a sequence", path=folder, found="no recipe.json", hint=hint)
    recipe = read_recipe(folder / "recipe.json")
    if not recipe.get("finished"):
        hint = "the command that began it, again"
        raise InputError("a finished sequence", path=folder / "recipe.json", hint=hint)
    for path in folder.rglob("*"):
        if path.is_symlink() and not path.resolve().is_relative_to(folder.resolve()):
            expected = "files in the folder itself"
            hint = "the file in place of the link, or without it"
            raise InputError(expected, path=path, found="a link to a file outside", hint=hint)
    if not licence and rendered_job(folder).get("scene") in SCENE_NAMES:
        return _OURS
    if not licence.strip() or not licence.isprintable():
        expected = f"a licence for these images: {', '.join(LICENCES)} or any other name"
        raise InputError(expected, setting="licence", found=licence or "none")
    return licence


def is_archive(path: Path) -> bool:
    """Whether a file is an archive that `pack` wrote."""
    try:
        with tarfile.open(path, "r:gz") as tar:
            first = tar.next()
            return first is not None and first.name.endswith(f"/{LICENCE}") and first.mtime == 0
    except (OSError, EOFError, tarfile.TarError, zlib.error):
        return False


def add_file(tar: tarfile.TarFile, name: str, data: bytes) -> None:
    """Add a file without owner and date, so that the same files give the same archive."""
    info = tarfile.TarInfo(name)
    info.size = len(data)
    info.mode = 0o644
    tar.addfile(info, io.BytesIO(data))


_ABOUT = """An RGB-D sequence, {what} ICL-NUIM rebuilt (iclnuim).

recipe.json says how: settings, seed, versions. The same recipe gives the same files.
Check the files: sha256sum -c SHA256SUMS
"""
