"""A hash of the code that a result depends on: of the functions, classes and constants that are
reached by name from entry points. It changes with what these do, not with comments, docstrings or
layout, nor with their names and the files they are in, nor with what is not reached.
"""

import ast
import re
from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from functools import cache
from importlib.util import find_spec
from itertools import chain
from pathlib import Path

from iclnuim.benchmark.odometry.registry import BASELINES, ODOMETERS, PACKAGES
from iclnuim.formats.files import sha256
from iclnuim.shipped import versions

#: Rooms whose code decides figures; files, options and texts do not.
_ROOMS = re.compile(r"iclnuim\.(benchmark|geometry|sensor|evaluation|raycast)\b")
_ODOMETRY = "iclnuim.benchmark.odometry"
#: Names of odometers: a new one does not change the others.
_REGISTRY = f"{_ODOMETRY}.registry"
_PLACES = re.compile("\u2039[^\u203a]*\u203a")
#: So often the names in a text are replaced by the hashes of what they name, which may name others.
_ROUNDS = 4
#: Settings of a parameter that are texts for people.
_TEXTS = ("label", "source", "help")
#: The method of an experiment that only shows its cells.
_TABLES = "tables"
_DOCUMENTED = (ast.ClassDef, ast.FunctionDef)
#: A function, class or constant by its module and name; a module has an empty name.
Name = tuple[str, str]
#: An entry point: a function or class, or `module:name` of one that is not imported yet.
Entry = str | Callable[..., object]


def method_code(name: str) -> str | None:
    """What identifies the code of a method: for our odometers the hash of the odometer and of the
    tracking; for third-party ones the version of their package; for systems None, as their program
    is hashed.
    """
    if name in ODOMETERS:
        entry = ODOMETERS[name]
        module = f"{_ODOMETRY}{entry.module}" if entry.module.startswith(".") else entry.module
        return code_of(f"{module}:{entry.class_name}", f"{_ODOMETRY}.track:Tracker")
    if name not in BASELINES:
        return None
    return package_version(PACKAGES[BASELINES[name][2].partition(".")[0]])


@cache
def package_version(package: str) -> str | None:
    """The installed version of a package, read once: every cell asks for it."""
    return versions(package)[package]


@cache
def code_of(*entries: Entry, without: tuple[Entry, ...] = ()) -> str:
    """The hash of entry points and of all definitions in _ROOMS that they reach by name; without
    some, and without what only these reach. Raises LookupError for an entry that is not there.
    """
    texts: dict[Name, str] = {}
    left = [_entry(entry) for entry in entries]
    seen = {*left, *map(_entry, without)}
    while left:
        name = left.pop()
        texts[name], names = _meaning(name)
        left += names - seen
        seen |= names
    hashes: dict[str, str] = {}
    for _ in range(_ROUNDS):
        hashes = {_place(name): _filled(text, hashes) for name, text in texts.items()}
    return sha256("\n".join(sorted(set(hashes.values()))).encode())


def _place(name: Name) -> str:
    """What stands in the text of a definition for another one."""
    return f"\u2039{':'.join(name)}\u203a"


def _filled(text: str, hashes: Mapping[str, str]) -> str:
    """The hash of a text with the hashes of what it names in place of their names."""
    return sha256(_PLACES.sub(lambda found: hashes.get(found[0], ""), text).encode())


def _entry(entry: Entry) -> Name:
    if not isinstance(entry, str):
        entry = f"{entry.__module__}:{entry.__qualname__}"
    module, _, name = entry.partition(":")
    found = _definition(module, name)
    if found is None:
        raise LookupError(f"{entry} is not defined")
    return found


@cache
def _meaning(name: Name) -> tuple[str, frozenset[Name]]:
    """What decides the result of a definition, as text, and the definitions that it names."""
    module = _module(name[0])
    reached = _Reached(module)
    texts = [reached.text_of(statement) for statement in module.definitions[name[1]]]
    return "\n".join(texts), frozenset(reached.names)


@dataclass(frozen=True)
class _Module:
    """definitions: name -> the statements at the top of the module that bind it."""

    name: str
    is_package: bool
    definitions: dict[str, list[ast.stmt]] = field(default_factory=dict)
    imports: dict[str, Name] = field(default_factory=dict)


@cache
def _module(name: str) -> _Module:
    """An empty one for a name that is no module in Python."""
    try:
        spec = find_spec(name)
    except ModuleNotFoundError:
        spec = None
    file = Path((spec and spec.origin) or "")
    found = _Module(name, file.name == "__init__.py")
    source = file.read_bytes() if file.suffix == ".py" else b""
    for statement in ast.parse(source).body:
        for bound in _bound(statement):
            found.definitions.setdefault(bound, []).append(statement)
        if not isinstance(statement, ast.If):  # of types alone
            found.imports.update(_imports(found, statement))
    return found


def _bound(statement: ast.stmt) -> Iterator[str]:
    """Names of functions, classes and constants that a statement binds."""
    if isinstance(statement, _DOCUMENTED):
        yield statement.name
    elif isinstance(statement, ast.Assign | ast.AnnAssign | ast.AugAssign):
        targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
        nodes = chain.from_iterable(map(ast.walk, targets))
        yield from (node.id for node in nodes if isinstance(node, ast.Name))


def _imports(module: _Module, statement: ast.AST) -> Iterator[tuple[str, Name]]:
    """Name -> what it is imported from, of all imports in a statement."""
    package = module.name if module.is_package else module.name.rpartition(".")[0]
    for node in ast.walk(statement):
        if isinstance(node, ast.ImportFrom):
            above = package.rsplit(".", node.level - 1)[0] if node.level else ""
            base = ".".join(filter(None, [above, node.module]))
            for alias in node.names:
                yield alias.asname or alias.name, (base, alias.name)


@cache
def _definition(module: str, name: str) -> Name | None:
    """Where a name of a module is defined; (module, "") of a module, None if it is in no room."""
    content = _module(module)
    if name in content.definitions:
        value = getattr(content.definitions[name][-1], "value", None)
        other = isinstance(value, ast.Name) and _definition(module, value.id)  # one with two names
        return other or (module, name)
    if name in content.imports:
        return _imported(*content.imports[name])
    return (f"{module}.{name}", "") if content.is_package else None


def _imported(module: str, name: str) -> Name | None:
    if module == _REGISTRY or not _ROOMS.match(f"{module}.{name}"):
        return None
    return _definition(module, name)


class _Reached(ast.NodeTransformer):
    """Leaves of a statement what decides its result, and collects the definitions that it names,
    which have a mark in place of their name.
    """

    def __init__(self, module: _Module) -> None:
        self.module = module
        self.imports = dict(module.imports)
        self.names: set[Name] = set()

    def text_of(self, statement: ast.stmt) -> str:
        self.imports.update(_imports(self.module, statement))
        copy = deepcopy(statement)
        if isinstance(copy, ast.ClassDef | ast.FunctionDef):
            copy.name = ""
        return ast.dump(self.visit(copy))

    def _target(self, node: ast.AST) -> Name | None:
        """What a name, or an attribute of a module, is; a module has an empty name."""
        if isinstance(node, ast.Name):
            if node.id in self.imports:
                return _imported(*self.imports[node.id])
            if node.id in self.module.definitions:
                return _definition(self.module.name, node.id)
            return None
        if isinstance(node, ast.Attribute) and (base := self._target(node.value)):
            return None if base[1] else _imported(base[0], node.attr)
        return None

    def visit_Name(self, node: ast.Name) -> ast.AST:
        if (target := self._target(node)) and target[1]:
            self.names.add(target)
            node.id = _place(target)
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        if (target := self._target(node)) and target[1]:
            self.names.add(target)
            return ast.Name(_place(target), node.ctx)
        return self.generic_visit(node)

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        return None

    def visit_Call(self, node: ast.Call) -> ast.AST:
        node.keywords = [one for one in node.keywords if one.arg not in _TEXTS]
        return self.generic_visit(node)

    def visit_ClassDef(self, node: ast.ClassDef | ast.FunctionDef) -> ast.AST:
        if ast.get_docstring(node, clean=False) is not None:
            del node.body[0]
        node.body = [one for one in node.body if getattr(one, "name", "") != _TABLES]
        return self.generic_visit(node)

    visit_FunctionDef = visit_ClassDef
