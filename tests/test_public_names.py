"""`import iclnuim` offers the names of docs/guide/python.md: they are found, typed and documented,
and cost nothing before they are used.
"""

import ast
import dataclasses
import inspect
import os
import subprocess
import sys

import iclnuim
import pytest

HEAVY = ("bpy", "numba", "scipy", "matplotlib", "numpy", "cv2", "open3d", "igl")


@pytest.mark.parametrize("name", iclnuim.__all__)
def test_every_public_name_is_found_where_the_package_says(name):
    """A name that moved: change its line among the imports in addon/iclnuim/__init__.py."""
    assert getattr(iclnuim, name) is not None


@pytest.mark.parametrize("name", [n for n in iclnuim.__all__ if n != "__version__"])
def test_every_public_class_and_function_is_documented(name):
    public = getattr(iclnuim, name)
    if not (inspect.isclass(public) or inspect.isfunction(public)):
        return
    generated = f"{public.__name__}("  # what dataclass writes where there is no docstring
    assert public.__doc__ and not (
        dataclasses.is_dataclass(public) and public.__doc__.startswith(generated)
    )


def test_editors_see_the_same_names():
    tree = ast.parse(inspect.getsource(iclnuim))
    block = next(
        n for n in tree.body if isinstance(n, ast.If) and ast.unparse(n.test) == "TYPE_CHECKING"
    )
    seen = {
        alias.asname or alias.name: (node.module, alias.name)
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert seen == iclnuim._PLACES and set(seen) == set(iclnuim.__all__) - {"__version__"}


def test_the_command_limits_the_threads_of_matrices_before_numpy_is_loaded():
    """OpenBLAS reads the variable once, when numpy loads it; a value of the user is kept."""
    program = (
        "import os, sys; from iclnuim import checkout; checkout.load('iclnuim.headless', 'a test');"
    )
    program += "print(os.environ['OPENBLAS_NUM_THREADS'], 'numpy' in sys.modules)"
    for given, expected in ((None, "1"), ("2", "2")):
        environment = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
        if given:
            environment["OPENBLAS_NUM_THREADS"] = given
        words = [sys.executable, "-c", program]
        done = subprocess.run(words, capture_output=True, text=True, check=True, env=environment)
        assert done.stdout.split() == [expected, "False"]


def test_importing_the_package_and_listing_its_names_loads_nothing_heavy():
    program = f"import sys, iclnuim; dir(iclnuim); print([m for m in {HEAVY} if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(
    ("blocked", "name", "said"),
    [
        ("iclnuim.benchmark.odometry", "odometer", "needs iclnuim.benchmark, which is not"),
        ("numba", "fuse_sequence", "needs the package numba; try pip install numba"),
    ],
)
def test_a_name_whose_module_is_missing_is_an_import_error_in_one_line(blocked, name, said):
    program = (
        "import sys\n"
        "class Missing:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        f"        if name == {blocked!r}: raise ModuleNotFoundError(f'No module named {{name!r}}', name=name)\n"
        "sys.meta_path.insert(0, Missing())\n"
        "import iclnuim\n"
        "try:\n"
        f"    iclnuim.{name}\n"
        "except ImportError as error:\n"
        "    print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert said in done.stdout and len(done.stdout.splitlines()) == 1


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no_such_name"):
        getattr(iclnuim, "no_such_name")  # noqa: B009
