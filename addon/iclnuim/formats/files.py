"""Atomic writing of files (a file is complete or absent), and reading of text with errors that give
file and line.
"""

import codecs
import csv
import errno
import hashlib
import io
import json
import math
import os
import platform
import shutil
import tempfile
import uuid
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from ..errors import InputError, StrPath, WorkError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

#: Identifies this host in temporary names: process numbers are not unique on a shared file system.
_HOST = hashlib.sha256(platform.node().encode()).hexdigest()[:6]

#: Maximum number of digits of a whole number in JSON: it is within the range of a float.
_LONGEST_INTEGER = 300

#: Names of open files, which can also be regular files.
_OPEN_FILES = ("/dev/stdout", "/dev/stderr", "/dev/fd/", "/proc/")


def atomic_write(path: StrPath, write: Callable[[Path], object]) -> None:
    """Call `write` with a temporary file in the folder of `path` (same ending), then rename it to
    `path`.

    If anything fails, `path` is unchanged. A symbolic link stays, and its target is written. A pipe
    or a device (/dev/stdout) receives the finished content. An OSError is raised as a WorkError
    with the path.
    """
    path = Path(path)
    if is_stream(path):
        _write_stream(path, write)
        return
    if path.is_symlink():
        path = Path(os.path.realpath(path))
    temporary = path.with_name(
        f".{path.stem}.{os.getpid()}-{_HOST}-{uuid.uuid4().hex[:8]}.tmp{path.suffix}"
    )
    try:
        write(temporary)
        os.replace(temporary, path)
    except OSError as error:
        raise not_written(path, error) from error
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def locked(path: Path, wait: bool = False) -> Iterator[None]:
    """Keep other processes out of a folder or file that exists, until the end of the block or of
    the process. It leaves no file. Without effect where the system or the file system has no such
    locks (Windows, some network file systems).

    Raises WorkError if another process has locked it, or, with `wait`, waits for that process.
    """
    if fcntl is None:
        yield
        return
    descriptor = os.open(path, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError:
        os.close(descriptor)
        raise WorkError(
            f"{path}: another process is writing here", hint="waiting for it, or another folder"
        ) from None
    except OSError:
        pass
    try:
        yield
    finally:
        with suppress(OSError):  # a forked process that has not ended has the same lock
            fcntl.flock(descriptor, fcntl.LOCK_UN)
        os.close(descriptor)


def real_path(path: StrPath) -> Path:
    """The path without symbolic links.

    Those of a loop stay, where Path.resolve() raises RuntimeError before Python 3.13.
    """
    return Path(os.path.realpath(path))


def is_stream(path: StrPath) -> bool:
    """Whether a path is a pipe, a device, or a name of an open file, which must not be replaced by
    a file.
    """
    path = Path(path)
    return (
        path.as_posix().startswith(_OPEN_FILES)
        or path.exists()
        and not path.is_file()
        and not path.is_dir()
    )


def _write_stream(path: Path, write: Callable[[Path], object]) -> None:
    try:
        with tempfile.TemporaryDirectory() as folder:
            whole = Path(folder) / f"content{path.suffix}"
            write(whole)
            with open(whole, "rb") as content, open(path, "ab") as stream:
                shutil.copyfileobj(content, stream)
    except OSError as error:
        raise not_written(path, error) from error


def not_written(path: StrPath, error: OSError) -> WorkError:
    """The error for a file that could not be written.

    The OSError of a full disk does not contain the file's name.
    """
    hint = None
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        hint = "freeing space there, then the same command again"
    return WorkError(f"{os.fspath(path)}: cannot write: {error.strerror or error}", hint=hint)


def make_folder(folder: Path, hint: str | None = None) -> None:
    """Make a folder and its parents. Raises WorkError if this fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise WorkError(
            f"{folder}: cannot make the folder: {error.strerror or error}", hint=hint
        ) from None


@contextmanager
def whole_folder(folder: Path) -> Iterator[Path]:
    """Yield a new folder with a temporary name.

    At the end it replaces `folder`; if anything fails, it is removed.
    """
    temporary = folder.with_name(f".{folder.name}.part")
    shutil.rmtree(temporary, ignore_errors=True)
    make_folder(temporary)
    try:
        yield temporary
        shutil.rmtree(folder, ignore_errors=True)
        temporary.rename(folder)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def process_is_running(process: int) -> bool:
    """Whether a process of this host is running: one that has ended is not, even if its parent has
    not noticed that yet. Always True on Windows, where os.kill would end it.
    """
    if os.name == "nt":
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    return not _is_zombie(process)


def _is_zombie(process: int) -> bool:
    """Whether a process has ended and waits for its parent; False where there is no /proc."""
    try:
        state = Path(f"/proc/{process}/stat").read_bytes().rpartition(b")")[2].split()[0]
    except OSError:
        return False
    return state in (b"Z", b"X")


def writer_has_ended(temporary: Path) -> bool:
    """Whether a temporary file of `atomic_write` was left by a process of this host that has ended.

    Those of other hosts may be in use.
    """
    try:
        process, host, _ = temporary.name.split(".")[-3].split("-")
        return host == _HOST and not process_is_running(int(process))
    except (IndexError, ValueError):
        return False


def atomic_write_bytes(path: StrPath, data: bytes) -> None:
    """Write the content of a file."""
    atomic_write(path, lambda temporary: temporary.write_bytes(data))


def atomic_write_text(path: StrPath, text: str) -> None:
    """Write text in UTF-8, with its line ends unchanged."""
    atomic_write_bytes(path, text.encode())


def csv_text(rows: Iterable[Iterable[object]]) -> str:
    """The text of CSV; None is an empty field."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def json_text(content: object, ascii: bool = False) -> str:
    """The text of JSON: indented, keys in the given order, NaN and infinity as null, which JSON
    does not have. ascii: other letters as escapes.
    """
    finite = _with_nulls(content)
    return json.dumps(finite, indent=2, ensure_ascii=ascii, allow_nan=False)


def _with_nulls(content: object) -> object:
    if isinstance(content, dict):
        return {key: _with_nulls(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_with_nulls(value) for value in content]
    if isinstance(content, float) and not math.isfinite(content):
        return None
    return content


def write_json(path: StrPath, content: dict) -> None:
    """Write the text of JSON, with a line end at the end."""
    atomic_write_text(path, json_text(content) + "\n")


def read_json(path: StrPath) -> dict:
    """Read a JSON object. Raises InputError with the line of the first error."""
    content = content_of_json(read_text(path), path=path)
    if not isinstance(content, dict):
        raise InputError("a JSON object", path=path, found=type(content).__name__)
    return content


def content_of_json(text: str, what: str = "JSON", path: StrPath | None = None) -> Any:
    """The content of JSON text. Raises InputError, with the line in `path` if that is given, also
    for numbers that are not finite or have hundreds of digits.
    """
    try:
        return json.loads(
            text, parse_int=_short_integer, parse_float=_finite, parse_constant=_finite
        )
    except json.JSONDecodeError as error:
        line = None if path is None else error.lineno
        raise InputError(what, path=path, line=line, found=f"other text ({error.msg})") from None
    except RecursionError:
        raise InputError(what, path=path, found="brackets nested too deeply") from None
    except ValueError as error:
        raise InputError(what, path=path, found=error) from None


def _short_integer(text: str) -> int:
    if len(text) > _LONGEST_INTEGER:
        raise ValueError(f"a number of {len(text)} digits")
    return int(text)


def _finite(text: str) -> float:
    if not math.isfinite(value := float(text)):
        raise ValueError(f"the number {text}, which is not finite")
    return value


def read_bytes(path: StrPath, what: str = "a file", most: int = -1) -> bytes:
    """The content of a file, or at most so many bytes. Raises InputError if it cannot be read."""
    try:
        with open(path, "rb") as file:
            return file.read(most)
    except (OSError, ValueError) as error:
        words = {"IsADirectoryError": "a folder", "FileNotFoundError": "no such file or folder"}
        found = words.get(type(error).__name__) or getattr(error, "strerror", None) or error
        raise InputError(what, path=path, found=found) from None


def is_file(path: StrPath) -> bool:
    """Whether the file exists; False for an invalid name."""
    try:
        return Path(path).is_file()
    except (OSError, ValueError):
        return False


def read_text(path: StrPath, what: str = "a text file") -> str:
    """Read text in UTF-8 or UTF-16.

    Raises InputError for a missing, unreadable, empty or binary file, a saved web page, and a
    pointer of Git LFS.
    """
    data = read_bytes(path, what)
    if not data.strip():
        raise InputError(what, path=path, found="an empty file")
    data = _utf8_of_utf16(data)
    if b"\0" in data:
        raise InputError(what, path=path, found="a binary file")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError(
            what, path=path, line=line, found="bytes that are not UTF-8 text"
        ) from None
    if text.lstrip()[:200].lower().startswith(("<!doctype", "<html", "<?xml")):
        raise InputError(
            what, path=path, line=1, found="a web page", hint="downloading the file itself again"
        )
    if text.startswith("version https://git-lfs"):
        found = "a pointer of Git LFS instead of the file"
        raise InputError(what, path=path, line=1, found=found, hint="git lfs pull")
    return text


def _utf8_of_utf16(data: bytes) -> bytes:
    """Text in UTF-16, with its mark or with a zero in every second of the first bytes, as UTF-8;
    other data unchanged.
    """
    start = data[:64]
    encoding = ""
    if start.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encoding = "utf-16"
    elif len(start) > 1 and not any(start[1::2]) and all(start[::2]):
        encoding = "utf-16-le"
    elif len(start) > 1 and not any(start[::2]) and all(start[1::2]):
        encoding = "utf-16-be"
    try:
        return data.decode(encoding).encode() if encoding else data
    except UnicodeError:
        return data


def data_lines(text: str) -> list[tuple[int, str]]:
    """(number from 1, content without comment) of each line that contains data."""
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    stripped = ((number, line.split("#", 1)[0].strip()) for number, line in enumerate(lines, 1))
    return [(number, line) for number, line in stripped if line]


def is_number(field: str) -> bool:
    """Whether numpy's loadtxt accepts the field as a number."""
    try:
        float(field)
    except ValueError:
        return False
    return field.isascii() and "_" not in field


def sha256(data: bytes) -> str:
    """The SHA-256 of the data as a hexadecimal string."""
    return hashlib.sha256(data).hexdigest()


def file_sha256(path: StrPath) -> str:
    """The SHA-256 of a file of any size. Raises InputError if it cannot be read."""
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError("a file", path=path, found=error.strerror or error) from None


#: Endings of pictures that can be drawn.
PICTURES = (".png", ".pdf", ".svg", ".jpg")


def check_picture(path: StrPath) -> None:
    """Raises InputError if the ending is not one of PICTURES, or the folder does not exist."""
    ending = os.path.splitext(path)[1].lower()
    if ending not in PICTURES:
        raise InputError(
            f"a picture's name ending in {', '.join(PICTURES)}",
            path=path,
            found=ending or "no ending",
        )
    check_file(path)


def check_file(path: StrPath) -> None:
    """Raises InputError if a file cannot be written because its folder does not exist or it is a
    folder itself, WorkError if the folder is read-only.
    """
    folder = os.path.dirname(os.fspath(path))
    if folder and not os.path.isdir(folder):
        raise InputError("a folder to write into", path=folder, found="no such folder")
    if os.path.isdir(path):
        raise InputError("a file to write", path=path, found="a folder")
    if not os.access(folder or ".", os.W_OK) and not is_stream(path):
        raise WorkError(f"{os.fspath(path)}: cannot write: the folder is read-only")
