"""The site is built without a complaint, and has every public name (mkdocs.yml)."""

import re
import subprocess
import sys
from pathlib import Path

import iclnuim
import pytest


@pytest.mark.slow
def test_the_site_is_built_strictly_and_has_every_public_name(repository, tmp_path):
    pytest.importorskip("mkdocs", reason="needs ./setup.sh docs")
    program = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path)]
    done = subprocess.run(program, cwd=repository, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    pages = "".join(path.read_text() for path in (tmp_path / "reference/python").glob("*.html"))
    for name in set(iclnuim.__all__) - {"__version__"}:
        assert f'id="iclnuim.{name}"' in pages
    for example in (repository / "examples").glob("[0-9]*"):
        assert f'href="{example.name}.html"' in (tmp_path / "examples/index.html").read_text()
    assert 'href="../addon/index.html#light-baked"' in (tmp_path / "guide/light.html").read_text()
    front = (tmp_path / "index.html").read_text()
    assert 'class="slider"' in front and "icon.svg" in front
    assert 'class="chart"' in (tmp_path / "measured/curves.html").read_text()
    assert 'class="chart"' in (tmp_path / "guide/imu.html").read_text()
    assert 'class="chart"' not in front


def test_comments_behind_commands_become_lines_of_their_own(repository, monkeypatch):
    pages = hook(repository, monkeypatch, "site_pages", "mkdocs")
    text = "```sh\n# a\nmake kt2 '#1'    # a minute\nmake --x \\\n  --y    # two\n```"
    block = re.search(r"(?s).*", text)
    expected = "```sh\n# a\n# a minute\nmake kt2 '#1'\nmake --x \\\n  --y    # two\n```"
    assert pages.comments_above(block) == expected


def test_what_a_docstring_says_of_parameters_is_a_table(repository, monkeypatch):
    parameters = hook(repository, monkeypatch, "site_parameters", "griffe")
    text = """Add noise.

    model: a key; a, b: sizes (h, w). c: 1. Raises InputError: never.
    """
    table = parameters.with_table(text, ["model", "a", "b", "c", "d"])
    rows = "| `model` | a key |\n| `a, b` | sizes (h, w) |\n| `c` | 1 |"
    assert table.startswith("Add noise.\n\nRaises InputError: never.\n\n|") and rows in table
    assert parameters.with_table("Gives d: no.", ["a"]) == "Gives d: no."


def hook(repository: Path, monkeypatch, name: str, needed: str):
    """A module of tools/, which needs a package of the site."""
    pytest.importorskip(needed, reason="needs ./setup.sh docs")
    monkeypatch.syspath_prepend(str(repository / "tools"))
    return __import__(name)
