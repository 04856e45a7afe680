"""Fetching of a packed sequence from a folder or a web server: every file of its SHA256SUMS, verified,
resumed after an interruption, and never replaced by another one.

A file that is being fetched is NAME.part, which the next attempt continues; it gets its name when
its SHA-256 is that of the list.
"""

import hashlib
import http.client
import re
import tarfile
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import BinaryIO, Protocol

from ..errors import InputError, WorkError
from ..formats.files import file_sha256, locked, make_folder, not_written, read_text
from .packing import CHECKSUMS
from .shards import MAX_SHARD_BYTES

_LINE = re.compile(r"([0-9a-f]{64})  (\S.*)")
_PART = ".part"
#: A list of more is none of ours: it has a line for each file beside at most some thousand shards.
_MAX_LIST_BYTES = 1 << 24
#: Attempts in a row that bring no byte, and the pause before each, in seconds.
_ATTEMPTS = 5
_PAUSE_S = 0.5
_TIMEOUT_S = 60.0
_CHUNK = 1 << 16
_AGAIN = "the same command again, which continues"


class FetchSource(Protocol):
    """Where files are fetched from."""

    def open(self, name: str, start: int) -> AbstractContextManager["Opened"]:
        """The file's content from byte `start` on, or from its beginning."""


@dataclass
class Opened:
    """Content from byte `start` on; size: bytes of the whole file, None if it is not known."""

    content: BinaryIO | http.client.HTTPResponse
    start: int
    size: int | None

    def __enter__(self) -> "Opened":
        return self

    def __exit__(self, *error: object) -> None:
        self.content.close()


@dataclass(frozen=True)
class FolderSource:
    """A folder on this machine."""

    folder: Path

    def open(self, name: str, start: int) -> Opened:
        path = self.folder / name
        try:
            content = open(path, "rb")  # noqa: SIM115
        except OSError as error:
            raise InputError(
                "a file of the packed sequence", path=path, found=error.strerror
            ) from None
        content.seek(start)
        return Opened(content, start, path.stat().st_size)


@dataclass(frozen=True)
class WebSource:
    """A folder of a web server."""

    url: str

    def open(self, name: str, start: int) -> Opened:
        address = f"{self.url.rstrip('/')}/{urllib.parse.quote(name)}"
        headers = {"Range": f"bytes={start}-"} if start else {}
        request = urllib.request.Request(address, headers=headers)
        try:
            response = urllib.request.urlopen(request, timeout=_TIMEOUT_S)
        except urllib.error.HTTPError as error:
            if error.code == 416:  # no more bytes than there are here already
                return self.open(name, 0)
            if error.code >= 500:
                raise OSError(f"HTTP {error.code}") from None
            found = f"HTTP {error.code}, {error.reason}"
            raise InputError("a file of a packed sequence", path=address, found=found) from None
        except ValueError as error:
            raise InputError("an address of http or https", path=address, found=error) from None
        begin, size = _range_of(response)
        if begin not in (0, start):
            response.close()
            found = f"bytes from {begin}"
            raise InputError(f"bytes from {start}", path=address, found=found)
        return Opened(response, begin, size)


def _range_of(response: http.client.HTTPResponse) -> tuple[int, int | None]:
    """The first byte of a response, and the size of the whole file, None if it is not known."""
    if response.status == 206:
        text = response.headers.get("Content-Range", "")
        found = re.fullmatch(r"bytes (\d+)-\d+/(\d+|\*)", text.strip())
        if not found:
            return -1, None
        return int(found[1]), None if found[2] == "*" else int(found[2])
    length = response.headers.get("Content-Length", "")
    return 0, int(length) if length.isdecimal() else None


@dataclass(frozen=True)
class Fetched:
    """Names of the files that were fetched, and of those that were there."""

    fetched: tuple[str, ...]
    found: tuple[str, ...]


def source_of(text: str) -> FetchSource:
    """The folder or the web server of this name. Raises InputError."""
    scheme = urllib.parse.urlsplit(text).scheme
    if scheme in ("http", "https"):
        return WebSource(text)
    if scheme and len(scheme) > 1 and not Path(text).exists():
        raise InputError("a folder, or an address of http or https", path=text, found=scheme)
    if not Path(text).is_dir():
        raise InputError("a folder or an address of a packed sequence", path=text, found="neither")
    return FolderSource(Path(text))


def fetch(
    source: FetchSource,
    out: Path,
    digest: str = "",
    on_file: Callable[[str, int, int], object] = lambda name, done, total: None,
) -> Fetched:
    """Fetch a packed sequence into the folder `out`. digest: the SHA-256 of its SHA256SUMS, as
    `iclnuim pack --shards` prints it. on_file(name, done, total) is called after each file.

    Raises InputError for a source without SHA256SUMS, another digest, a file that is not the one of
    the list, and an `out` with another file of that name; WorkError if the source stops giving
    bytes, or a file cannot be written.
    """
    make_folder(out)
    with locked(out):
        sums = _sums(source, out, digest)
        fetched = []
        found = []
        for done, (name, wanted) in enumerate(sums.items(), 1):
            path = out / name
            if path.is_file():
                _check(path, wanted)
                found.append(name)
            else:
                _fetch_file(source, path, name, wanted)
                fetched.append(name)
            on_file(name, done, len(sums))
        return Fetched(tuple(fetched), tuple(found))


def unpack(out: Path, on_shard: Callable[[str], object] = lambda name: None) -> int:
    """Unpack the shards in a folder beside themselves; returns the number of files. Files that are
    there with the same content stay.

    Raises InputError for a member that is not a plain file with a plain name, or a file with
    another content.
    """
    count = 0
    for shard in sorted(out.glob("*.tar")):
        try:
            with tarfile.open(shard) as tar:
                for member in tar:
                    _unpack_member(tar, member, shard)
                    count += 1
        except tarfile.TarError as error:
            raise InputError("a tar file", path=shard, found=error) from None
        on_shard(shard.name)
    return count


def _unpack_member(tar: tarfile.TarFile, member: tarfile.TarInfo, shard: Path) -> None:
    content = tar.extractfile(member) if member.isfile() else None
    if content is None or not _is_plain(member.name):
        raise InputError("plain files", path=shard, found=member.name)
    data = content.read()
    path = shard.with_name(member.name)
    if path.is_file():
        _check(path, hashlib.sha256(data).hexdigest())
        return
    part = path.with_name(path.name + _PART)
    try:
        part.write_bytes(data)
        part.replace(path)
    except OSError as error:
        raise not_written(path, error) from error


def _is_plain(name: str) -> bool:
    """Whether a name stays in its folder, on any system."""
    path = PurePosixPath(name)
    return len(path.parts) == 1 and name not in ("", ".", "..") and not set(name) & set('\\:*?"<>|')


def _check(path: Path, wanted: str) -> None:
    digest = file_sha256(path)
    if digest != wanted:
        expected = f"the file with SHA-256 {wanted[:12]}..."
        hint = "removing it, if it is not needed"
        raise InputError(expected, path=path, found=f"{digest[:12]}...", hint=hint)


def _sums(source: FetchSource, out: Path, digest: str) -> dict[str, str]:
    """The SHA-256 of every file by its name; the list is kept in `out`."""
    path = out / CHECKSUMS
    part = path.with_name(CHECKSUMS + _PART)
    part.unlink(missing_ok=True)  # another version of the list may have been begun
    _receive(source, part, CHECKSUMS, _MAX_LIST_BYTES)
    try:
        found = file_sha256(part)
        if digest and found != digest.lower():
            raise InputError(f"{CHECKSUMS} with SHA-256 {digest}", path=path, found=found)
        if path.is_file():
            _check(path, found)
        sums = _parsed(part)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
    return sums


def _parsed(path: Path) -> dict[str, str]:
    sums: dict[str, str] = {}
    for number, line in enumerate(read_text(path).splitlines(), 1):
        found = _LINE.fullmatch(line)
        if found is None or not _is_plain(found[2]) or found[2] in (CHECKSUMS, *sums):
            expected = "lines of SHA-256 and the name of a file in the same folder"
            raise InputError(expected, path=CHECKSUMS, line=number, found=line)
        sums[found[2]] = found[1]
    if not sums:
        raise InputError("a list of files", path=CHECKSUMS, found="an empty one")
    return sums


def _fetch_file(source: FetchSource, path: Path, name: str, wanted: str) -> None:
    """Fetch one file; if what an earlier attempt left belongs to another version, from its start."""
    part = path.with_name(name + _PART)
    resumed = part.is_file() and part.stat().st_size > 0
    for attempt in range(2 if resumed else 1):
        if attempt:
            part.unlink()
        _receive(source, part, name, MAX_SHARD_BYTES)
        digest = file_sha256(part)
        if digest == wanted:
            try:
                part.replace(path)
            except OSError as error:
                raise not_written(path, error) from error
            return
    part.unlink()
    expected = f"the file with SHA-256 {wanted[:12]}..., as in {CHECKSUMS}"
    raise InputError(expected, path=name, found=f"{digest[:12]}...: its bytes are others")


def _receive(source: FetchSource, part: Path, name: str, most: int) -> None:
    """Write the whole file to `part`, continuing where it ends."""
    without_bytes = 0
    last = "no bytes"
    while without_bytes < _ATTEMPTS:
        start = part.stat().st_size if part.is_file() else 0
        if without_bytes:
            time.sleep(_PAUSE_S * without_bytes)
        size = None
        try:
            with source.open(name, start) as opened:
                size = opened.size
                if size is not None and size > most:
                    raise InputError(f"a file of at most {most} bytes", path=name, found=size)
                _append(opened, part, name, most)
                if size is None or part.stat().st_size >= size:
                    return
        except (OSError, http.client.HTTPException) as error:
            last = str(getattr(error, "reason", None) or error) or type(error).__name__
        now = part.stat().st_size if part.is_file() else 0
        without_bytes = 0 if now > start else without_bytes + 1
    raise WorkError(f"{name}: no bytes in {_ATTEMPTS} attempts: {last}", hint=_AGAIN)


def _append(opened: Opened, part: Path, name: str, most: int) -> None:
    """Append what comes to `part`, or write it anew if it comes from the beginning."""
    try:
        file = open(part, "r+b" if part.exists() else "w+b")  # noqa: SIM115
    except OSError as error:
        raise not_written(part, error) from error
    with file:
        file.seek(opened.start)
        file.truncate()
        while data := opened.content.read(_CHUNK):
            if file.tell() + len(data) > most:
                raise InputError(f"a file of at most {most} bytes", path=name, found="more")
            try:
                file.write(data)
            except OSError as error:
                raise not_written(part, error) from error
