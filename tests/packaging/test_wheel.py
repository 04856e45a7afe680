"""The wheel: what users call is in it, what builds the rooms and measures ourselves is not, and it
works away from the checkout.
"""

import importlib.metadata
import os
import shutil
import subprocess
import sys
import zipfile

import pytest
from patience import patience

SOURCES = (
    "addon",
    "benchmark",
    "headless",
    "blend",
    "trajectories",
    "pyproject.toml",
    "README.md",
    "LICENSE",
)


@pytest.fixture(scope="module")
def wheel(repository, tmp_path_factory):
    """The wheel of this checkout, built from a copy."""
    if int(importlib.metadata.version("setuptools").split(".")[0]) < 77:
        pytest.skip("building the wheel needs setuptools 77 or newer; try: ./setup.sh test")
    folder = tmp_path_factory.mktemp("wheel")
    (folder / "source").mkdir()
    for name in SOURCES:
        copy = shutil.copytree if (repository / name).is_dir() else shutil.copy
        copy(repository / name, folder / "source" / name)
    build = [
        sys.executable,
        "-m",
        "pip",
        "wheel",
        "-q",
        "--no-deps",
        "--no-build-isolation",
        "--wheel-dir",
        str(folder),
    ]
    subprocess.run([*build, str(folder / "source")], check=True, capture_output=True)
    return next(folder.glob("*.whl"))


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """`installed(*argv)` runs the command from the unpacked wheel, in an empty folder."""
    place, away = tmp_path_factory.mktemp("site"), tmp_path_factory.mktemp("away")
    zipfile.ZipFile(wheel).extractall(place)

    def run(*argv):
        environment = {
            **os.environ,
            "PYTHONPATH": str(place),
            "XDG_CACHE_HOME": str(away / "cache"),
        }
        command = [sys.executable, "-m", "iclnuim", *argv]
        return subprocess.run(
            command,
            cwd=away,
            env=environment,
            capture_output=True,
            text=True,
            timeout=patience(300),
        )

    run.away = away
    return run


def test_what_is_needed_is_in_it_and_nothing_of_the_checkout_alone(wheel, repository):
    names = set(zipfile.ZipFile(wheel).namelist())
    shipped = {
        "py.typed",
        "blender_manifest.toml",
        "benchmark/experiments/recipes/paper/paper.json",
        "benchmark/experiments/page.html",
    }
    shipped |= {"headless/farm/iclnuim.def", "headless/farm/flamenco/iclnuim.js"}
    for folder, ending, name in (
        ("benchmark/systems", "*.toml", "benchmark/systems"),
        ("benchmark/systems/drivers", "*", "benchmark/systems/drivers"),
        ("headless/settings", "*.toml", "headless/settings"),
        ("addon/iclnuim/labels/class_maps", "*.csv", "labels/class_maps"),
    ):
        files = list((repository / folder).glob(ending))
        assert files
        shipped |= {f"{name}/{path.name}" for path in files}
    shipped |= {
        f"blend/{path.relative_to(repository / 'blend')}"
        for path in (repository / "blend").glob("*.blend")
    }
    shipped |= {
        str(path.relative_to(repository)) for path in (repository / "blend/light").glob("*/*")
    }
    shipped |= {
        f"trajectories/{room}/kt{k}.txt" for room in ("living_room", "office") for k in range(4)
    }
    for source, name in (
        ("addon/iclnuim", ""),
        ("headless", "headless/"),
        ("benchmark", "benchmark/"),
    ):
        shipped |= {
            name + str(path.relative_to(repository / source))
            for path in (repository / source).rglob("*.py")
        }
    assert {f"iclnuim/{name}" for name in shipped} <= names
    assert [name for name in names if "builder" in name or "tools" in name or "tests" in name] == []


def test_the_version_and_a_table_are_printed(installed):
    assert installed("--version").stdout.startswith("iclnuim ")
    assert "living_room/kt0" in installed("table", "1").stdout


@pytest.mark.parametrize(
    "command", [("scene", "build", "office"), ("bench", "render"), ("bench", "chaos")], ids=" ".join
)
def test_what_needs_a_checkout_says_so_in_a_line(installed, command):
    done = installed(*command)
    assert done.returncode == 3
    assert (
        "needs a checkout of the repository" in done.stderr and len(done.stderr.splitlines()) == 1
    )


def test_a_sequence_is_made(installed):
    pytest.importorskip("bpy", reason="needs the bpy package")
    size = ["--frames", "0:1", "--camera", "64x48", "--light", "path", "--samples", "1"]
    done = installed("make", "kt2", *size)
    assert done.returncode == 0, done.stderr
    folder = installed.away / "out/living_room/kt2"
    assert [len(list((folder / kind / "depth").glob("*.png"))) for kind in ("clean", "noisy")] == [
        1,
        1,
    ]
