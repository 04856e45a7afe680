"""A hash of the code that a result depends on: it changes with what the code does, not with
comments, docstrings or layout.
"""

import ast
import functools
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType

from iclnuim import geometry, sensor
from iclnuim.benchmark import odometry
from iclnuim.formats.files import sha256

from .. import perturbations
from . import cell

_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef)


def code_sha256(files: Iterable[Path]) -> str:
    """The hash of Python files, by name and syntax tree."""
    return sha256(
        "\n".join(f"{file.name} {_meaning(file.read_bytes())}" for file in sorted(files)).encode()
    )


@functools.cache
def perturbing() -> str:
    """The hash of what perturbs frames, and computes the figures of a cell."""
    files = [Path(cell.__file__), *_files(perturbations), *_files(sensor), *_files(geometry)]
    return code_sha256(files)


@functools.cache
def tracking() -> str:
    """The hash of our odometers."""
    return code_sha256([*_files(odometry), *_files(geometry)])


def _files(package: ModuleType) -> list[Path]:
    return list(Path(package.__path__[0]).glob("*.py"))


def _meaning(source: bytes) -> str:
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, _DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            del node.body[0]
    return ast.dump(tree)
