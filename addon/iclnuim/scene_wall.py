"""What a process that opens a user's scene may read and write: the wall of wall.py, made of a job's
folders.
"""

import glob
import os
import re
import sys
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from . import shipped, wall
from .geometry.scene_axes import SceneReading
from .scene_files import search

#: Libraries, programs and fonts of the system, in all usual distributions.
_SYSTEM = ("/usr", "/lib", "/lib32", "/lib64", "/bin", "/nix/store", "/gnu/store", "/snap")
#: What Blender, Python and their libraries open elsewhere: the loader's and the user's names, the
#: time zone, the locale; numbers of processors and sizes of memory.
_SYSTEM_FILES = (
    "/etc/ld.so.cache", "/etc/ld.so.preload", "/etc/passwd", "/etc/nsswitch.conf",
    "/etc/localtime", "/etc/timezone", "/etc/locale.alias", "/etc/os-release",
    "/etc/ssl/openssl.cnf", "/etc/fonts",
    "/proc/cpuinfo", "/proc/meminfo", "/proc/stat", "/proc/version", "/proc/filesystems",
    "/proc/sys/vm/nr_hugepages", "/proc/sys/vm/overcommit_memory",
    "/proc/self/maps", "/proc/self/stat", "/proc/self/statm", "/proc/self/status",
    "/proc/self/cgroup", "/proc/self/mountinfo",
    "/sys/devices/system/cpu", "/sys/devices/system/node", "/sys/fs/cgroup",
    "/sys/kernel/mm/transparent_hugepage",
    "/dev/zero", "/dev/random", "/dev/urandom",
)  # fmt: skip
_DEVICE = "/dev/null"


@dataclass(frozen=True)
class SceneWall:
    """Files and folders that the process may read, those that it may also write, and folders of
    which it may only see the names.
    """

    readable: tuple[str, ...]
    writable: tuple[str, ...]
    listable: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, list[str]]:
        """What wall.py reads as {"wall": ..}."""
        return {name: list(paths) for name, paths in vars(self).items()}

    def put_up(self) -> bool:
        """Bind this thread. False where the kernel has no Landlock."""
        return wall.put_up(self.readable, self.writable, self.listable)


def around(
    scene: str,
    reading: SceneReading,
    program: str,
    readable: Iterable[Path] = (),
    writable: Iterable[Path] = (),
) -> SceneWall:
    """The wall of a process of `program` (Python or Blender) that opens `scene`, a built-in name or
    a file: beside the scene's file, what it names in its own folder, and the folders that the user
    allows, it reads what Blender and Python consist of and `readable`, and it writes only
    `writable`.
    """
    allowed = [*_SYSTEM, *_SYSTEM_FILES, *_installation(program), *map(str, readable)]
    listable = []
    if not shipped.is_scene(scene):
        file = Path(scene).expanduser().resolve()
        allowed += map(str, search.readable(file, reading))
        listable.append(str(file.parent))
    if reading.textures:
        allowed.append(str(Path(reading.textures).expanduser()))
    if reading.allow_outside:
        allowed = ["/"]
    return SceneWall(tuple(allowed), (_DEVICE, *map(str, writable)), tuple(listable))


def _installation(program: str) -> set[str]:
    """The folders of Python with its packages, of this package with its scenes, of the program, and
    of libraries that the user's environment names.
    """
    found = {sys.prefix, sys.base_prefix, sys.exec_prefix}
    # not the others of sys.path: the folder of the user's script may hold anything
    found |= {place for place in sys.path if place.endswith(("site-packages", "dist-packages"))}
    for variable in ("PYTHONPATH", "LD_LIBRARY_PATH"):
        found |= set(os.environ.get(variable, "").split(os.pathsep))
    found |= {str(Path(__file__).resolve().parent), os.path.dirname(os.path.realpath(program))}
    found |= {str(shipped.folder(name)) for name in ("blend", "trajectories")}
    found |= set(glob.glob("/etc/python3*"))  # Debian's settings of Python
    with suppress(OSError), open(program, "rb") as script:
        if script.read(2) == b"#!":  # a script that starts Blender
            names = re.findall(
                r"/[^\s\"']+/blender\b", script.read(4096).decode("utf-8", "replace")
            )
            found |= set(map(os.path.dirname, names))
    return {place for place in found if os.path.isabs(place)}
