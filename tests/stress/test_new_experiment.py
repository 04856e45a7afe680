"""A new experiment is one folder: its command, resuming, tables and page are there at once, with
nothing else changed.
"""

import json
import os
import re
import sys

import pytest
from iclnuim.benchmark.experiments import recipes


@pytest.fixture
def example(repository):
    """The experiment of the guide."""
    text = (repository / "docs/guide/experiments.md").read_text()
    return re.search(r"```python\n(.*?)```", text, re.S)[1]


@pytest.fixture
def recipe(example, tmp_path, monkeypatch):
    """The file of an experiment in a folder of its own beside those of the project; returns it."""
    file = tmp_path / "recipes/loading_time/__init__.py"
    file.parent.mkdir(parents=True)
    file.write_text(example)
    monkeypatch.setattr(recipes, "__path__", [*recipes.__path__, str(tmp_path / "recipes")])
    monkeypatch.chdir(tmp_path)
    yield file
    del sys.modules[f"{recipes.__name__}.loading_time"]


def cells(tmp_path):
    found = sorted((tmp_path / "out/loading_time/cells").rglob("*.cell.json"))
    return {file.name.split(".")[0]: os.stat(file).st_mtime_ns for file in found}


def test_a_folder_is_an_experiment_with_a_command_that_resumes(
    recipe, command_here, folder, tmp_path
):
    code, text, _ = command_here("experiment", "--list")
    assert code == 0
    assert "loading_time: How long reading a frame takes.\n  repeats=3  how often" in text
    words = ("experiment", "loading_time", folder, "--frames", ":4", "--workers", "2")
    code, text, err = command_here(*words)
    assert code == 0, err
    rows = {line.split()[1]: line.split() for line in text.splitlines()[2:]}
    assert rows["first"][:3] == [rows["again"][0], "first", "4"] and rows["again"][2] == "12"
    assert (
        "How long reading a frame takes."
        in (tmp_path / "out/loading_time/loading_time.html").read_text()
    )
    assert (tmp_path / "out/loading_time/tables/cells.csv").read_text().count("\n") == 3
    measured = cells(tmp_path)
    victim = next((tmp_path / "out/loading_time/cells").rglob("first.cell.json"))
    victim.unlink()
    code, again, _ = command_here(*words, "--json", "--quiet")
    figures = json.loads(again)["cells"]
    assert code == 0 and [one["reads"] for one in figures] == [4, 12]
    now = cells(tmp_path)
    assert set(now) == set(measured) == {"first", "again"}
    assert now["again"] == measured["again"] and now["first"] != measured["first"]
    code, shown, err = command_here(*words, "--report-only", "--set", "repeats=2")
    assert code == 3 and "no measured cells" in err


def test_a_file_of_your_own_is_an_experiment(example, command_here, folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "own_loading.py").write_text(example)
    words = ("experiment", "own_loading.py", folder, "--frames", ":3", "--set", "repeats=2")
    code, text, err = command_here(*words, "--workers", "1")
    assert code == 0 and " again " in text, err
    assert (tmp_path / "out/own_loading/own_loading.html").is_file()
    for setting, message in (
        ("repeats=0", "repeats of the experiment as a whole number of 1 or more, found 0"),
        ("repeats=x", "repeats of the experiment as a whole number of 1 or more, found x"),
        ("repeat=2", "--set: expected NAME=VALUE with NAME of repeats, found repeat=2"),
    ):
        code, _, err = command_here(*words[:-1], setting)
        assert code == 2 and message in err and err.count("\n") == 1


def test_what_is_no_experiment_is_refused_in_a_line(command_here, folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "plain_module.py").write_text("LIMIT = 1\n")
    for name, message in (
        ("loadin", "expected an experiment"),
        ("plain_module.py", "expected a class derived from Experiment, found none"),
    ):
        code, _, err = command_here("experiment", name, folder)
        assert code == 2 and message in err and err.count("\n") == 1


def test_a_measurement_that_fails_is_named_and_the_others_are_kept(
    recipe, command_here, folder, tmp_path
):
    text = recipe.read_text().replace(
        "        times_s = []\n",
        "        from iclnuim.errors import WorkError\n\n        times_s = []\n"
        '        if variant == "again":\n            raise WorkError("the disk is gone")\n',
    )
    recipe.write_text(text)
    words = ("experiment", "loading_time", folder, "--frames", ":3", "--workers", "1")
    code, text, err = command_here(*words)
    assert code == 3 and "again failed: the disk is gone" in err
    assert set(cells(tmp_path)) == {"first"}
