"""The rules of the house: imports point one way and not in circles, heavy packages are imported
late, no global state, nothing is left out of the wheel.
"""

import ast
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
#: import name -> folder; the longer names first
TREES = {
    "iclnuim.blend.builder": "blend/builder",
    "iclnuim.tools": "tools",
    "iclnuim.headless": "headless",
    "iclnuim.benchmark": "benchmark",
    "iclnuim": "addon/iclnuim",
}
CORE = "errors settings shown geometry formats native_output"
#: room -> rooms it may import from, besides itself. A room is a folder or a file of the library;
#: `api` is iclnuim itself.
MAY_IMPORT = {
    "errors": "",
    "settings": "errors",
    "checkout": "errors",
    "version": "",
    "console": "formats",
    "shown": "",
    "worker_events": "errors",
    "worker_client": "errors geometry formats shipped wall scene_wall worker_events",
    "wall": "",
    "scene_files": "errors geometry",
    "scene_wall": "geometry shipped wall scene_files",
    "__main__": "errors checkout headless headless.cli benchmark",
    "shipped": "errors",
    "geometry": "errors settings shown",
    "native_output": "",
    "formats": "errors shown geometry native_output",
    "sensor": "errors settings geometry",
    "evaluation": "errors settings shown geometry",
    "trajectory_files": f"{CORE} shipped evaluation",
    "doubt": f"{CORE} sensor trajectory_files evaluation",
    "channels": "formats",
    "render_ways": "errors",
    "job": f"{CORE} channels shipped sensor render_ways",
    "sequences": f"{CORE} version console channels job shipped sensor evaluation trajectory_files doubt",
    "labels": f"{CORE} console channels doubt sequences report",
    "depth": f"{CORE} console channels sequences labels evaluation report",
    "postprocess": f"{CORE} console sensor evaluation doubt trajectory_files sequences report",
    "render": f"{CORE} console job trajectory_files sequences worker_client worker_events",
    "lightmap": "errors geometry",
    "blender": f"{CORE} lightmap",
    "blender.open": f"{CORE} shipped job scene_files blender",
    "blender.light": f"{CORE} version shipped job sensor lightmap blender",
    "blender.render": f"{CORE} version channels job render_ways worker_events shipped sensor sequences labels "
    "trajectory_files blender blender.open blender.light",
    "blender.child": f"{CORE} job worker_events sequences blender blender.render",
    "report": f"{CORE} console sensor evaluation doubt trajectory_files sequences",
    "raycast": f"{CORE} console channels sequences",
    "ui": f"{CORE} job worker_client worker_events shipped sensor evaluation trajectory_files sequences report "
    "raycast scene_files blender blender.open blender.light blender.render",
}
LIBRARY = " ".join(set(MAY_IMPORT) - {"ui", "__main__"})
BENCHMARK = [
    f"benchmark.{room}"
    for room in ("odometry", "fusion", "perturbations", "systems", "experiments")
]
ENGINE = f"{LIBRARY} benchmark " + " ".join(BENCHMARK)
#: The folders of experiments: none imports another but those that show the runs of systems.
RECIPES = {
    "benchmark.experiments.recipes": ENGINE,
    "benchmark.experiments.recipes.system": ENGINE,
    "benchmark.experiments.recipes.curve": ENGINE,
    "benchmark.experiments.recipes.stress": f"{ENGINE} benchmark.experiments.recipes.system",
    "benchmark.experiments.recipes.inertial": f"{ENGINE} benchmark.experiments.recipes.system",
    "benchmark.experiments.recipes.paper": f"{ENGINE} benchmark.experiments.recipes.system",
}
BENCHMARK += RECIPES
MAY_IMPORT |= RECIPES
MAY_IMPORT |= {
    "benchmark": "",
    "benchmark.compiled": "",
    "benchmark.odometry": f"{LIBRARY} benchmark.compiled",
    "benchmark.fusion": f"{CORE} console sensor evaluation doubt trajectory_files sequences labels report raycast "
    "benchmark.compiled benchmark.odometry",
    "benchmark.perturbations": f"{LIBRARY} benchmark.odometry",
    "benchmark.systems": f"{LIBRARY} benchmark.odometry",
    "benchmark.experiments": ENGINE,
    "api": " ".join([LIBRARY, "ui", *BENCHMARK]),
    "headless": f"{LIBRARY} __main__",
    "headless.completion": "shipped benchmark.odometry",
    "headless.farm": f"{LIBRARY} headless",
    "headless.method_options": " ".join([LIBRARY, "headless", *BENCHMARK]),
    "headless.commands": "api __main__ "
    + " ".join([LIBRARY, "headless headless.farm headless.method_options", *BENCHMARK]),
    "headless.cli": f"{LIBRARY} headless headless.completion headless.commands",
    "tools": " ".join(
        [LIBRARY, "headless headless.farm headless.method_options builder", *BENCHMARK]
    ),
    "builder": LIBRARY,
}
#: What only a checkout has: loaded by name where it is there.
FROM_A_CHECKOUT = {"tools", "builder"}
MAY_LOAD_A_CHECKOUT = {
    "headless.commands.benchmark_cells",
    "headless.commands.bench",
    "headless.commands.scene",
}
#: room -> packages from outside that it may import when it is loaded, and those that it may import
#: in a function, where they are needed; the other rooms of library and farm import numpy alone. An
#: encoder of images is the first of several that is there (formats/libraries.py).
OUTSIDE = {
    "formats": ("numpy", "open3d rosbags"),
    "trajectory_files": ("numpy", "rosbags"),
    "labels": ("numpy matplotlib", ""),
    "depth": ("numpy matplotlib", ""),
    "blender": ("numpy bpy bmesh mathutils", "_cycles io_scene_gltf2"),
    "scene_files": ("numpy", "pxr zstandard"),
    "ui": ("numpy bpy mathutils", "gpu gpu_extras"),
    "report": ("numpy matplotlib", "rerun"),
    "shown": ("numpy", "matplotlib"),
    "geometry": ("numpy", "pandas"),
    "console": ("", "IPython"),
    "sequences": ("numpy", "rosbags torch lpips"),
    "raycast": ("numpy", "embreex igl"),
    "headless.completion": ("", "argcomplete"),
    "headless.farm": ("numpy", "submitit"),
    "headless.commands": ("numpy", "bpy matplotlib cv2"),
}
NUMPY = ("numpy", "")


@cache
def modules() -> dict[str, Path]:
    """Every module by its import name."""
    found = {}
    for package, folder in TREES.items():
        for path in sorted((REPOSITORY / folder).rglob("*.py")):
            parts = path.relative_to(REPOSITORY / folder).with_suffix("").parts
            found[".".join([package, *(parts[:-1] if parts[-1] == "__init__" else parts)])] = path
    return found


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


@cache
def nodes(path: Path) -> tuple[ast.AST, ...]:
    return tuple(ast.walk(tree(path)))


def short(name: str) -> str:
    return name.removeprefix("iclnuim.")


def room_of(name: str) -> str:
    if name == "iclnuim":
        return "api"
    parts = name.split(".")[1:]
    if parts[0] == "blend":
        return "builder"
    inside = [".".join(parts[:count]) for count in range(len(parts), 0, -1)]
    return next((room for room in inside if room in MAY_IMPORT), parts[0])


def resolved(name: str, package: str, level: int) -> str:
    """A relative import's full name."""
    above = package.split(".")[: len(package.split(".")) - level + 1] if level else []
    return ".".join([*above, name] if name else above)


@cache
def imported(name: str) -> frozenset[str]:
    return frozenset(import_names(name))


def import_names(name: str) -> Iterator[str]:
    """Own modules that the module `name` imports: at the top and in functions, relative and
    absolute, by statement and by call.
    """
    path = modules()[name]
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    for node in nodes(path):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in modules())
        elif isinstance(node, ast.ImportFrom):
            base = resolved(node.module or "", package, node.level)
            full = {alias.name: f"{base}.{alias.name}" for alias in node.names}
            yield from (
                f if f in modules() else base
                for f in full.values()
                if f in modules() or base in modules()
            )
        elif isinstance(node, ast.Call) and node.args:
            yield from called(node, package)


def is_import(node: ast.Call) -> bool:
    """Whether a call imports the module that its first argument names."""
    function = node.func
    name = function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")
    return bool(node.args) and name in ("import_module", "__import__", "load")


def start_of_text(node: ast.AST) -> str | None:
    """The text of a constant, or the constant start of a text that is put together."""
    if isinstance(node, ast.JoinedStr):
        node = node.values[0]
    while isinstance(node, ast.BinOp):
        node = node.left
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    return None


def called(node: ast.Call, package: str) -> Iterator[str]:
    """What importlib.import_module, __import__ and checkout.load import, as far as the text of
    their first argument tells.
    """
    text = start_of_text(node.args[0]) if is_import(node) else None
    if text is None:
        return
    whole = isinstance(node.args[0], ast.Constant)
    start = text.lstrip(".")
    start = resolved(start, package, len(text) - len(start))
    if start == package and not whole:
        return  # a package's choice among its own modules
    yield from (
        other for other in modules() if other == start or (not whole and other.startswith(start))
    )


def test_imports_are_found_however_they_are_written(monkeypatch, tmp_path):
    lines = [
        "from ..geometry import se3",
        "import iclnuim.headless.cli",
        "def f():\n    from iclnuim.ui import panels",
        "importlib.import_module('iclnuim.tools.loaders')",
        "importlib.import_module(f'..commands.{name}', __package__)",
        "__import__('iclnuim.job')",
        "importlib.import_module('iclnuim.benchmark.' + name)",
    ]
    path = tmp_path / "written.py"
    path.write_text("\n".join(lines))
    monkeypatch.setitem(modules(), "iclnuim.headless.farm.written", path)
    monkeypatch.setitem(modules(), "iclnuim.headless.geometry.se3", path)
    found = imported("iclnuim.headless.farm.written")
    expected = {
        "headless.geometry.se3",
        "headless.cli",
        "ui.panels",
        "tools.loaders",
        "job",
        "headless.commands.make",
        "benchmark.fusion.mesh",
    }
    assert expected <= set(map(short, found))


def test_a_class_has_a_name_of_its_own():
    """With or without an underscore, over all of the product: a search finds one meaning."""
    found: dict[str, list[str]] = {}
    for name, path in modules().items():
        if room_of(name) not in ("tools", "builder"):
            for node in nodes(path):
                if isinstance(node, ast.ClassDef):
                    found.setdefault(node.name.lstrip("_"), []).append(f"{short(name)}.{node.name}")
    assert {name: places for name, places in found.items() if len(places) > 1} == {}


def test_imports_point_one_way():
    wrong = []
    for name in modules():
        room = room_of(name)
        allowed = {room, *MAY_IMPORT[room].split()} | (
            FROM_A_CHECKOUT if short(name) in MAY_LOAD_A_CHECKOUT else set()
        )
        wrong += [
            f"{short(name)} imports {short(m)}" for m in imported(name) if room_of(m) not in allowed
        ]
    assert wrong == []


def test_modules_import_each_other_in_no_circle():
    """iclnuim itself is left out: it names what the library offers, and imports it when it is used."""
    graph = {
        short(n): set(map(short, imported(n) - {"iclnuim", n})) for n in modules() if n != "iclnuim"
    }
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail("circle: " + " -> ".join(error.args[1]))


def packages_of(node: ast.AST) -> Iterator[str]:
    """Packages that a statement imports, or a call whose first argument is their name."""
    if isinstance(node, ast.Import):
        yield from (alias.name.split(".")[0] for alias in node.names)
    elif isinstance(node, ast.ImportFrom) and not node.level:
        yield (node.module or "").split(".")[0]
    elif isinstance(node, ast.Call) and is_import(node):
        text = start_of_text(node.args[0])
        if text is not None:
            yield text.split(".")[0]


def outside_imports(path: Path) -> Iterator[str]:
    for node in nodes(path):
        yield from packages_of(node)


def imported_at_load(path: Path) -> set[str]:
    """Packages from outside that a module imports at its top, not only for annotations."""
    statements = [n for n in tree(path).body if isinstance(n, ast.Import | ast.ImportFrom)]
    return {name for statement in statements for name in packages_of(statement)}


@pytest.mark.parametrize("room", sorted({room_of(name) for name in modules()}))
def test_library_and_farm_import_few_packages_and_heavy_ones_late(room):
    if room.startswith("benchmark") or room in ("tools", "builder"):
        return
    at_load, late = map(str.split, OUTSIDE.get(room, OUTSIDE.get(room.split(".")[0], NUMPY)))
    own = {"iclnuim", "", *sys.stdlib_module_names}
    wrong = []
    for name, path in modules().items():
        if room_of(name) == room:
            early = imported_at_load(path) - own - set(at_load)
            others = set(outside_imports(path)) - own - {*at_load, *late}
            wrong += [f"{short(name)} imports {package}" for package in sorted(early | others)]
    assert wrong == []


def test_no_global_random_state():
    allowed = {"Generator", "default_rng", "SeedSequence", "PCG64", "BitGenerator"}
    wrong = [str(path) for path in modules().values() if "random" in outside_imports(path)]
    for path in modules().values():
        wrong += [
            f"{path}:{node.lineno}: random.{node.attr}"
            for node in nodes(path)
            if isinstance(node, ast.Attribute)
            and isinstance(node.value, ast.Attribute)
            and node.value.attr == "random"
            and node.attr not in allowed
        ]
    assert wrong == []


def state_in_globals(path: Path) -> Iterator[str]:
    """`global` statements, and module-level names whose value a function changes in place."""
    changing = {
        "append",
        "add",
        "update",
        "pop",
        "popitem",
        "setdefault",
        "clear",
        "extend",
        "insert",
        "remove",
        "discard",
    }
    top = [n for n in tree(path).body if isinstance(n, ast.Assign | ast.AnnAssign)]
    names = {
        n.id
        for node in top
        for n in ast.walk(node)
        if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
    }
    for function in nodes(path):
        if not isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            continue
        inside = list(ast.walk(function))
        own = {n.arg for n in inside if isinstance(n, ast.arg)}
        own |= {n.id for n in inside if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
        for node in inside:
            changed = None
            if isinstance(node, ast.Global):
                yield f"{node.lineno}: global {', '.join(node.names)}"
            elif isinstance(node, ast.Subscript | ast.Attribute) and isinstance(
                node.ctx, ast.Store | ast.Del
            ):
                changed = node.value
            elif (
                isinstance(node, ast.Call)
                and isinstance(node.func, ast.Attribute)
                and node.func.attr in changing
            ):
                changed = node.func.value
            if isinstance(changed, ast.Name) and changed.id in names - own:
                yield f"{node.lineno}: changes {changed.id}"


def test_no_module_keeps_state_in_a_global():
    found = {str(p.relative_to(REPOSITORY)): list(state_in_globals(p)) for p in modules().values()}
    assert {name: lines for name, lines in found.items() if lines} == {}


def messages(path: Path) -> Iterator[ast.Constant]:
    """Texts of more than one word that are no docstrings."""
    first = [
        n.body[0] for n in nodes(path) if isinstance(n, ast.Module | ast.FunctionDef | ast.ClassDef)
    ]
    docstrings = {id(n.value) for n in first if isinstance(n, ast.Expr)}
    for node in nodes(path):
        if (
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and id(node) not in docstrings
            and " " in node.value
        ):
            yield node


def test_the_library_does_not_speak_of_command_line_options():
    wrong = {}
    for path in (REPOSITORY / "addon/iclnuim").rglob("*.py"):
        found = [
            f"{m.lineno}: {m.value}"
            for m in messages(path)
            if re.search(r"(?<![-\w])--[a-z]", m.value)
        ]
        if found:
            wrong[str(path.relative_to(REPOSITORY))] = found
    assert wrong == {}


def test_import_is_quick_and_light():
    heavy = ("bpy", "scipy", "matplotlib", "cv2", "open3d", "igl", "numpy", "numba")
    program = f"import sys, iclnuim; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


def test_only_the_console_and_the_command_line_print():
    wrong = []
    for name, path in modules().items():
        if name.startswith(("iclnuim.tools", "iclnuim.blend")) or path.name in (
            "cli.py",
            "console.py",
        ):
            continue
        calls = [n for n in nodes(path) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)]
        wrong += [f"{name}:{call.lineno}" for call in calls if call.func.id == "print"]
    assert wrong == []


def test_every_package_folder_is_in_the_wheel():
    settings = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["tool"]["setuptools"]
    places = {name.replace(".", "/"): folder for name, folder in settings["package-dir"].items()}
    listed = set()
    for package in settings["packages"]:
        name = package.replace(".", "/")
        root = max((p for p in places if name == p or name.startswith(p + "/")), key=len)
        listed.add(places[root] + name[len(root) :])
    folders = {str(path.parent.relative_to(REPOSITORY)) for path in modules().values()}
    recipes = "benchmark/experiments/recipes"  # its folders are in the wheel as its data
    assert "*/*.py" in settings["package-data"]["iclnuim.benchmark.experiments.recipes"]
    others = {folder for folder in folders - listed if Path(folder).parent != Path(recipes)}
    assert others == {"tools", "blend/builder"}


def test_nothing_else_lies_at_the_top_level():
    if not (REPOSITORY / ".git").exists() or not shutil.which("git"):
        pytest.skip("no git checkout")
    listed = subprocess.run(["git", "ls-files"], cwd=REPOSITORY, capture_output=True, text=True)
    folders = {line.partition("/")[0] for line in listed.stdout.splitlines() if "/" in line}
    code = {"addon", "headless", "benchmark", "blend", "trajectories", "tests", "tools"}
    assert folders == code | {"docs", "examples", ".ci", ".github"}


def python_files() -> Iterator[Path]:
    yield from modules().values()
    yield from sorted((REPOSITORY / "tests").rglob("*.py"))


def test_every_file_says_what_it_is_for():
    assert [str(path) for path in python_files() if ast.get_docstring(tree(path)) is None] == []


def test_what_mypy_is_told_to_ignore_has_a_code_and_is_little():
    ignores = [
        line
        for path in python_files()
        for line in path.read_text().splitlines()
        if re.search(r"#\s*type: ignore", line)
    ]
    assert [
        line for line in ignores if not re.search(r"type: ignore\[[a-z-]+(, ?[a-z-]+)*\]", line)
    ] == []
    assert len(ignores) <= 40
