"""A wall of the kernel around a process that opens a scene: whatever the scene says, the process
opens and writes nothing outside the listed files and folders (Landlock, Linux 5.13 and later; no
privilege is needed). Later kernels also refuse it TCP, UDP, and sockets without a file and signals
to processes outside.

    python -I -S wall.py OPTIONS.json COMMAND ...

puts up the wall of OPTIONS.json, {"wall": {"readable": [PATH ..], "writable": [PATH ..],
"listable": [PATH ..]}}, and becomes COMMAND. It imports nothing of this package, because it runs before everything else: the
wall binds the calling thread and what it starts.
"""

import ctypes
import json
import os
import platform
import struct
import sys
from collections.abc import Callable, Iterable

#: System calls of Landlock; the numbers are the same on all processors (Linux, syscall.tbl).
_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_PR_SET_NO_NEW_PRIVS = 38
_RULE_PATH_BENEATH = 1
#: Rights (include/uapi/linux/landlock.h): execute a file, read a file, list a folder.
_LIST = 1 << 3
_READ = 1 << 0 | 1 << 2 | _LIST
#: Write a file, remove and make what a folder contains.
_WRITE = 1 << 1 | sum(1 << bit for bit in range(4, 13))
#: Rights that later kernels know: move between folders (version 2), truncate (version 3).
_LATER = {2: 1 << 13, 3: 1 << 14}
#: Version 4, Linux 6.7: bind a TCP socket, connect one.
_TCP_SINCE, _TCP = 4, 1 << 0 | 1 << 1
#: Version 10, Linux 7.2: bind a UDP socket, connect or send from one.
_UDP_SINCE, _UDP = 10, 1 << 2 | 1 << 3
#: Version 6, Linux 6.12: connect to an abstract socket outside the wall, signal a process outside.
_SCOPES_SINCE, _SCOPES = 6, 1 << 0 | 1 << 1
#: Those of all that a file, which is no folder, can have: execute, write, read, truncate.
_OF_A_FILE = 1 << 0 | 1 << 1 | 1 << 2 | 1 << 14


def version() -> int:
    """The version of the kernel's Landlock; 0 where there is none."""
    if platform.system() != "Linux":
        return 0
    return max(0, _kernel()(_CREATE_RULESET, None, 0, 1))


def refused(known: int) -> list[str]:
    """What the wall of a kernel with Landlock of version `known` refuses outside."""
    kinds = (
        (1, "files"),
        (_TCP_SINCE, "TCP"),
        (_UDP_SINCE, "UDP"),
        (_SCOPES_SINCE, "abstract sockets, signals"),
    )
    return [what for since, what in kinds if since <= known]


def handled(known: int) -> tuple[int, int, int]:
    """The rights to files, ports and processes outside that a kernel with Landlock of version
    `known` refuses.
    """
    files = _READ | _WRITE | sum(right for since, right in _LATER.items() if since <= known)
    network = _TCP * (known >= _TCP_SINCE) | _UDP * (known >= _UDP_SINCE)
    return files, network, _SCOPES * (known >= _SCOPES_SINCE)


def put_up(readable: Iterable[str], writable: Iterable[str], listable: Iterable[str] = ()) -> bool:
    """Let this thread, and all that it starts from now on, only read `readable`, only read and
    write `writable`, and only see the names in `listable`: files, and folders with all that they
    contain. Paths that do not exist are left out. Where the kernel can, nothing is connected or signalled outside.

    Returns False, without effect, where the kernel has no Landlock. Raises OSError if it refuses.
    """
    known = version()
    if not known:
        return False
    call = _kernel()
    both, network, scopes = handled(known)
    # kernels take a longer struct than they know where the rest is zero
    rules = struct.pack("QQQ", both, network, scopes)
    ruleset = _checked(call(_CREATE_RULESET, rules, len(rules), 0))
    for path in writable:
        _allow(ruleset, path, both)
    for path in readable:
        _allow(ruleset, path, _READ)
    for path in filter(os.path.isdir, listable):
        _allow(ruleset, path, _LIST)
    _checked(ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0))
    _checked(call(_RESTRICT_SELF, ruleset, 0))
    os.close(ruleset)
    return True


def _allow(ruleset: int, path: str, rights: int) -> None:
    try:
        opened = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        if not os.path.isdir(path):
            rights &= _OF_A_FILE
        rule = struct.pack("=Qi", rights, opened)
        _checked(_kernel()(_ADD_RULE, ruleset, _RULE_PATH_BENEATH, rule, 0))
    finally:
        os.close(opened)


def _kernel() -> Callable[..., int]:
    return ctypes.CDLL(None, use_errno=True).syscall


def _checked(result: int) -> int:
    if result < 0:
        number = ctypes.get_errno()
        raise OSError(number, f"Landlock: {os.strerror(number)}")
    return result


def _become(arguments: list[str]) -> None:
    with open(arguments[0], encoding="utf-8") as options:
        paths = json.load(options)["wall"]
    put_up(paths["readable"], paths["writable"], paths["listable"])
    os.execvp(arguments[1], arguments[1:])


if __name__ == "__main__":
    _become(sys.argv[1:])
