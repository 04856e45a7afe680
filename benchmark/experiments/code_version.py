"""A hash of the code that a result depends on: it changes with what the code does, not with
comments, docstrings or layout, nor with the names of modules.
"""

import ast
import re
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from iclnuim import geometry
from iclnuim.benchmark import odometry
from iclnuim.benchmark.odometry.registry import BASELINES, ODOMETERS, PACKAGES
from iclnuim.formats.files import sha256
from iclnuim.shipped import versions

#: Rooms whose code decides figures; files, options and texts do not.
_ROOMS = ("benchmark", "geometry", "sensor", "evaluation", "raycast")
_PATTERN = re.compile(rf"iclnuim\.({'|'.join(_ROOMS)})\b")
_ODOMETRY = "iclnuim.benchmark.odometry"
#: Names of odometers: a new one does not change the others.
_REGISTRY = f"{_ODOMETRY}.registry"
#: Package -> its folder, the inner one first.
_FOLDERS = {
    "iclnuim.benchmark": Path(odometry.__path__[0]).parent,
    "iclnuim": Path(geometry.__path__[0]).parent,
}
#: Settings of a parameter that are texts for people.
_TEXTS = ("label", "source", "help")
_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef)


def method_code(name: str) -> str | None:
    """What identifies the code of a method: for our odometers the hash of the odometer and of the
    tracking; for third-party ones the version of their package; for systems None,
    as their program is hashed.
    """
    if name in ODOMETERS:
        module = ODOMETERS[name].module
        full = f"{_ODOMETRY}{module}" if module.startswith(".") else module
        return code_of(full, f"{_ODOMETRY}.track")
    if name not in BASELINES:
        return None
    return package_version(PACKAGES[BASELINES[name][2].partition(".")[0]])


@cache
def package_version(package: str) -> str | None:
    """The installed version of a package, read once: every cell asks for it."""
    return versions(package)[package]


@cache
def code_of(*modules: str, without: tuple[str, ...] = ()) -> str:
    """The hash of modules and of all modules in _ROOMS that they import; without some, and without
    what only these import.
    """
    found: dict[str, str] = {}
    left = list(modules)
    while left:
        name = left.pop()
        if name not in (_REGISTRY, *without, *found) and (file := _file_of(name)):
            found[name], imported = _read(name, file)
            left += imported
    return sha256("\n".join(sorted(found.values())).encode())


def _file_of(module: str) -> Path | None:
    """The file of a module; None for another name."""
    for package, folder in _FOLDERS.items():
        if module.startswith(f"{package}."):
            path = folder.joinpath(*module.removeprefix(f"{package}.").split("."))
            files = (path.with_suffix(".py"), path / "__init__.py")
            return next((file for file in files if file.is_file()), None)
    spec = find_spec(module)
    return Path(spec.origin) if spec and spec.origin else None


@cache
def _read(name: str, file: Path) -> tuple[str, list[str]]:
    """The hash of a module, and what it imports from _ROOMS."""
    source = file.read_bytes()
    package = name if file.name == "__init__.py" else name.rpartition(".")[0]
    imported = [one for one in _imports(package, source) if _PATTERN.match(one)]
    return sha256(meaning(source).encode()), imported


def meaning(source: bytes) -> str:
    """The syntax tree of a source as text, without docstrings, the places that it imports from, and
    the texts of settings.
    """
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, _DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            del node.body[0]
        elif isinstance(node, ast.ImportFrom):
            node.module = None
            node.level = 0
        elif isinstance(node, ast.Call):
            node.keywords = list(filter(_decides, node.keywords))
    return ast.dump(tree)


def _decides(keyword: ast.keyword) -> bool:
    return keyword.arg not in _TEXTS


def _imports(package: str, source: bytes) -> Iterator[str]:
    """Names of what a module of a package imports: modules, and things in them."""
    above = package.split(".")
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            parents = above[: len(above) - node.level + 1] if node.level else []
            base = ".".join([*parents, *filter(None, [node.module])])
            yield base
            yield from (f"{base}.{alias.name}" for alias in node.names)
