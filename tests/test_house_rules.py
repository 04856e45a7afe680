"""The rules of the house: imports point one way, heavy packages are imported late, no global randomness, nothing is left out of the wheel."""

import ast
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

#: room -> rooms it may import from, besides itself; errors.py, job.py, shipped.py and postprocess.py are rooms of one file
MAY_IMPORT = {
    "errors": set(),
    "scenes": set(),
    "scene_classes": set(),
    "settings": {"errors"},
    "checkout": {"errors"},
    "__main__": {"checkout"},
    "shipped": {"errors", "scenes"},
    "geometry": {"errors", "settings"},
    "formats": {"errors", "geometry"},
    "sensor": {"errors", "settings", "geometry"},
    "evaluation": {"errors", "settings", "geometry"},
    "job": {"errors", "settings", "shipped", "geometry", "formats", "sensor"},
    "dataset": {"errors", "settings", "job", "shipped", "geometry", "formats", "sensor", "evaluation", ""},
    "postprocess": {"errors", "settings", "geometry", "formats", "sensor", "evaluation", "dataset"},
    "lightmap": {"errors", "geometry"},
    "blender": {
        "errors",
        "settings",
        "job",
        "shipped",
        "geometry",
        "formats",
        "sensor",
        "evaluation",
        "dataset",
        "scenes",
        "scene_classes",
        "lightmap",
        "",
    },
    "report": {"errors", "settings", "geometry", "formats", "evaluation", "dataset", ""},
    "raycast": {"errors", "geometry", "formats", "dataset", ""},
    "odometry": {"errors", "settings", "geometry", "formats", "evaluation", "dataset", "report", "fusion", ""},
    "fusion": {
        "errors",
        "geometry",
        "formats",
        "evaluation",
        "dataset",
        "report",
        "odometry",
        "blender",
        "shipped",
        "",
    },
    "ui": {
        "errors",
        "settings",
        "job",
        "shipped",
        "geometry",
        "formats",
        "sensor",
        "evaluation",
        "dataset",
        "scenes",
        "blender",
        "postprocess",
        "",
    },
}
#: What the numpy-only rooms may import from outside.
PURE = {"geometry": {"numpy"}, "lightmap": {"numpy"}, "sensor": {"numpy"}, "evaluation": {"numpy"}}


def modules(repository):
    package = repository / "addon/iclnuim"
    return [p for p in sorted(package.rglob("*.py")) if p != package / "__init__.py"]


def room_of(path, package):
    return path.relative_to(package).parts[0].removesuffix(".py")


def own_imports(path, package):
    """Rooms imported by relative imports; '' is the package itself."""
    depth_of_file = len(path.relative_to(package).parts)
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level == depth_of_file:
            yield from (
                [node.module.split(".")[0]]
                if node.module
                else [alias.name for alias in node.names if not alias.name.startswith("__")]
            )
        if isinstance(node, ast.ImportFrom) and node.level > depth_of_file:
            yield "outside the package"


def test_imports_point_one_way(repository):
    package = repository / "addon/iclnuim"
    wrong = []
    for path in modules(repository):
        room = room_of(path, package)
        wrong += [
            f"{path.relative_to(package)} imports {other}"
            for other in own_imports(path, package)
            if other != room and other not in MAY_IMPORT[room]
        ]
    assert wrong == []


def test_the_library_never_imports_the_headless_side(repository):
    assert [
        p
        for p in modules(repository)
        if "iclnuim.headless" in p.read_text() and p.name not in ("__main__.py", "checkout.py")
    ] == []


@pytest.mark.parametrize("room", PURE)
def test_pure_rooms_import_numpy_only(repository, room):
    wrong = []
    for path in (repository / "addon/iclnuim" / room).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = (
                [a.name for a in node.names]
                if isinstance(node, ast.Import)
                else [node.module]
                if isinstance(node, ast.ImportFrom) and not node.level
                else []
            )
            wrong += [
                f"{path.name}: {n}" for n in names if n.split(".")[0] not in PURE[room] | set(sys.stdlib_module_names)
            ]
    assert wrong == []


def test_no_global_random_state(repository):
    allowed = {"Generator", "default_rng", "SeedSequence", "PCG64", "BitGenerator"}
    wrong = []
    for folder in ("addon", "headless"):
        for path in (repository / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.Import) and any(a.name == "random" for a in node.names):
                    wrong.append(f"{path}: the random module")
                if (
                    isinstance(node, ast.Attribute)
                    and isinstance(node.value, ast.Attribute)
                    and node.value.attr == "random"
                    and node.attr not in allowed
                ):
                    wrong.append(f"{path}:{node.lineno}: random.{node.attr}")
    assert wrong == []


def test_import_is_quick_and_light():
    program = "import sys, iclnuim; print([m for m in ('bpy', 'scipy', 'matplotlib', 'cv2', 'open3d', 'numpy') if m in sys.modules])"
    assert (
        subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True).stdout.strip()
        == "[]"
    )


def test_only_the_console_and_the_command_line_print(repository):
    printing = {"console.py", "cli.py"}
    wrong = []
    for folder in ("addon", "headless"):
        for path in (repository / folder).rglob("*.py"):
            calls = [
                n
                for n in ast.walk(ast.parse(path.read_text()))
                if isinstance(n, ast.Call) and isinstance(n.func, ast.Name) and n.func.id == "print"
            ]
            if calls and path.name not in printing:
                wrong.append(str(path.relative_to(repository)))
    assert wrong == []


def test_every_package_folder_is_in_the_wheel(repository):
    settings = tomllib.loads((repository / "pyproject.toml").read_text())["tool"]["setuptools"]
    places = {name.replace(".", "/"): folder for name, folder in settings["package-dir"].items()}
    listed = set()
    for package in settings["packages"]:
        name = package.replace(".", "/")
        root = max((p for p in places if name == p or name.startswith(p + "/")), key=len)
        listed.add(places[root] + name[len(root) :])
    folders = {
        str(p.parent.relative_to(repository))
        for top in ("addon/iclnuim", "headless")
        for p in (repository / top).rglob("*.py")
    }
    assert folders - listed == set()


def test_every_file_says_what_it_is_for(repository):
    paths = [p for top in ("addon", "headless", "tests") for p in (repository / top).rglob("*.py")]
    assert [str(p) for p in paths if ast.get_docstring(ast.parse(Path(p).read_text())) is None] == []
