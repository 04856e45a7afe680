"""The archive for publication: a sequence's files, checksums, licence, preview, recipe. The same files give the same bytes."""

import gzip
import io
import tarfile
from collections.abc import Callable, Mapping
from pathlib import Path

from ..errors import InputError
from ..formats.files import atomic_write, read_bytes, sha256
from .sequence import read_recipe

CHECKSUMS, LICENCE, ABOUT = "SHA256SUMS", "LICENSE.txt", "README.txt"
#: Licences for data sets, by SPDX name.
LICENCES = {
    "CC-BY-4.0": ("Creative Commons Attribution 4.0 International", "https://creativecommons.org/licenses/by/4.0/"),
    "CC-BY-SA-4.0": (
        "Creative Commons Attribution-ShareAlike 4.0 International",
        "https://creativecommons.org/licenses/by-sa/4.0/",
    ),
    "CC0-1.0": ("CC0 1.0 Universal", "https://creativecommons.org/publicdomain/zero/1.0/"),
}


def pack(
    folder: Path,
    archive: Path,
    licence: str = "CC-BY-4.0",
    author: str = "",
    extra: Mapping[str, bytes] | None = None,
    on_file: Callable[[str], None] = lambda name: None,
) -> int:
    """Write `archive` (.tar.gz) with the files of `folder`, in a top folder of its name, and `extra` files by name. Returns the number of files.

    SHA256SUMS can be checked with `sha256sum -c`. Raises InputError for a folder without a finished recipe or for
    an unknown licence, WorkError if the archive cannot be written.
    """
    folder = Path(folder)
    check_packable(folder, licence)
    top, (title, address), by = folder.resolve().name, LICENCES[licence], f" by {author}" if author else ""
    terms = f"The data set {top}{by} is under {title} ({licence}).\n{address}\n"
    extra = {**(extra or {}), LICENCE: terms.encode(), ABOUT: _ABOUT.encode()}
    names = sorted({*packed_names(folder), *extra} - {CHECKSUMS})
    sums: list[str] = []

    def write(temporary: Path) -> None:
        with (
            open(temporary, "wb") as raw,
            gzip.GzipFile("", "wb", compresslevel=1, fileobj=raw, mtime=0) as packed,
            tarfile.open(fileobj=packed, mode="w", format=tarfile.PAX_FORMAT) as tar,
        ):
            for name in names:
                data = extra[name] if name in extra else read_bytes(folder / name)
                sums.append(f"{sha256(data)}  {name}\n")
                _add(tar, f"{top}/{name}", data)
                on_file(name)
            _add(tar, f"{top}/{CHECKSUMS}", "".join(sums).encode())

    atomic_write(archive, write)
    return len(names) + 1


def packed_names(folder: Path) -> list[str]:
    """The files of a folder that `pack` includes: not the journal, hidden files or temporary files."""
    files = (p for p in Path(folder).rglob("*") if p.is_file() and p.name[0] != "." and p.name != "frames.jsonl")
    return sorted(p.relative_to(folder).as_posix() for p in files)


def check_packable(folder: Path, licence: str) -> None:
    """Raises InputError for a folder without a finished recipe or for an unknown licence."""
    recipe = read_recipe(folder / "recipe.json")
    if not recipe.get("finished"):
        raise InputError("a finished sequence", path=folder / "recipe.json", hint="the command that began it, again")
    if licence not in LICENCES:
        raise InputError(f"a licence among {', '.join(LICENCES)}", found=licence)


def _add(tar: tarfile.TarFile, name: str, data: bytes) -> None:
    """Add a file without owner and date, so that the same files give the same archive."""
    info = tarfile.TarInfo(name)
    info.size, info.mode = len(data), 0o644
    tar.addfile(info, io.BytesIO(data))


_ABOUT = """An RGB-D sequence with exact ground truth, made with ICL-NUIM rebuilt (iclnuim).

recipe.json says how: settings, seed, versions. The same recipe gives the same files.
Check the files: sha256sum -c SHA256SUMS
"""
