"""An odometer of two files (its class, its line in the registry), and a scene of three (its line,
its .blend, its trajectories): every command that names odometers or scenes works with them.
"""

import json
import shutil

import pytest
from iclnuim import shipped
from iclnuim.benchmark.odometry import registry
from iclnuim.console import Console
from iclnuim.headless.cli import main
from iclnuim.headless.method_options import installed
from iclnuim.tools import measured_tables
from iclnuim.tools.measured import take
from iclnuim.tools.measured_cells import PublishedCells
from iclnuim.tools.measured_drawn import stress_totals

CLASS = '''
from dataclasses import dataclass
from iclnuim.benchmark.odometry.protocol import OdometryResult
from iclnuim.geometry.se3 import SE3


@dataclass(frozen=True)
class StillSettings:
    patience: float = 1.0


class Still:
    """Finds that the camera moves as it always does."""

    name, reference = "still", "frame"
    PRESETS = {"best": StillSettings(), "paper": StillSettings(2.0)}

    def __init__(self, settings):
        self.settings = settings

    def prepare(self, frame, camera):
        return frame

    def align(self, reference, current, guess):
        return OdometryResult(SE3.exp([0.007, 0.002, 0.005, 0.002, 0.007, 0.002]))
'''


@pytest.fixture
def still(tmp_path, monkeypatch):
    """An odometer without iterations, which the paper does not have."""
    (tmp_path / "still_odometer.py").write_text(CLASS)
    monkeypatch.syspath_prepend(tmp_path)
    entry = registry.OdometerEntry("still_odometer", "Still", "geometric")
    monkeypatch.setitem(registry.ODOMETERS, "still", entry)
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def cellar(tmp_path, monkeypatch):
    """A scene with one trajectory of its own."""
    places = {name: shipped.folder(name) for name in ("blend", "trajectories")}
    ours = tmp_path / "shipped"
    for name, place in places.items():
        (ours / name).mkdir(parents=True)
        for path in place.iterdir():
            (ours / name / path.name).symlink_to(path)
    (ours / "trajectories/cellar").mkdir()
    shutil.copy(
        places["trajectories"] / "living_room/kt2.txt", ours / "trajectories/cellar/loop.txt"
    )
    shutil.copy(places["blend"] / "office.blend", ours / "blend/cellar.blend")
    monkeypatch.setattr(shipped, "folder", lambda name: ours / name)
    monkeypatch.setitem(shipped.SCENES, "cellar", shipped.SceneEntry("cellar", "Cellar", "dark"))
    monkeypatch.setattr(shipped, "SCENE_NAMES", tuple(shipped.SCENES))
    monkeypatch.chdir(tmp_path)


def result(command_here, *words):
    code, out, err = command_here(*words, "--json", "--quiet")
    assert code == 0, err
    return json.loads(out)


def sequence(folder, data, name):
    """The box as the frames of a sequence of `iclnuim make all`."""
    return shutil.copytree(folder, data / name / "clean")


def benchmark(command_here, data, *words):
    options = ("--data", data, "--out", data / "bench", "--no-surfaces", "--first", "30")
    return result(command_here, "benchmark", *options, "--workers", "1", *words)


def test_an_odometer_without_iterations_works_in_every_command(
    still, command_here, folder, tmp_path
):
    (run,) = result(command_here, "odometry", "still", folder, "--first", "6")["runs"]
    assert run["odometer"] == "still" and run["lost"] == 0
    (compared,) = result(
        command_here, "bench", "odometry", folder, "--only", "still", "--first", "6"
    )["results"]
    assert [one["odometer"] for one in compared["runs"]] == ["still"]
    words = ("--frames", ":6", "--starts", "1", "--only", "holes", "--severities", "5")
    groups = result(
        command_here,
        "stress",
        folder,
        "-o",
        "stress",
        *words,
        "--methods",
        "still",
        "--base",
        "clean",
    )
    assert {cell["method"] for cell in groups["cells"]} == {"still"}
    published = PublishedCells()
    assert take(published, tmp_path / "stress") == len(groups["cells"])
    assert "still" in [row[0] for row in stress_totals(published)]
    for curve, values in (("iterations", [1.0, None]), ("resolution", [160.0, 160.0])):
        words = ("--method", "opencv-icp", "--method", "still", "--method", "icp")
        points = result(
            command_here, "bench", "curve", curve, folder, "--first", "6", "--values",
            values[0], *words,
        )["points"]  # fmt: skip
        assert [p["value"] for p in points if p["method"] == "still"] == values[1:]
        columns = measured_tables._curve(values[0])([{"points": points}])[0]
        assert ("still" in columns) == (values[1] is not None)
    code, _, err = command_here("bench", "curve", "levels", folder, "--method", "still")
    assert code == 2 and "expected an odometer with such settings" in err


def test_an_odometer_that_the_paper_does_not_have_has_rows_of_its_own(
    still, command_here, folder, tmp_path
):
    sequence(folder, tmp_path, "living_room/kt2")
    found = benchmark(command_here, tmp_path, "--only", "still")
    assert [cell["cell"]["odometer"] for cell in found["cells"]] == ["still"]
    table = found["tables"]["table_3"]
    rows = [row for row in table["rows"] if row[0] == "still"]
    assert len(rows) == 1 and float(rows[0][table["columns"].index("kt2")]) > 0
    assert len(table["rows"]) == 5 * 6 + 1
    shown = result(command_here, "table", "3", "--out", tmp_path / "bench")
    assert shown["rows"] == table["rows"]
    code, text, err = command_here("benchmark", "--report-only", tmp_path / "bench")
    assert code == 0 and "still" in text, err
    assert "still" in (tmp_path / "bench/report.html").read_text()


def test_a_scene_that_the_paper_does_not_have_works_in_every_command(
    cellar, command_here, folder, tmp_path
):
    assert shipped.sequence_names()[-1] == "cellar/loop"
    assert len(result(command_here, "table", "1")) == 8
    sequence(folder, tmp_path, "cellar/loop")
    words = ("--only", "cellar/icp/default")
    found = benchmark(command_here, tmp_path, *words)
    assert [cell["cell"]["room"] for cell in found["cells"]] == ["cellar"]
    table = found["tables"]["cells"]
    (row,) = table["rows"]
    assert row[:2] == ["cellar", "loop"] and float(row[table["columns"].index("ATE mm")]) > 0
    assert table["notes"] == ["The paper's tables do not have cellar."]
    for number in range(2, 8):
        assert command_here("table", number, "--out", tmp_path / "bench")[0] == 0
    words = ("--frames", ":6", "--starts", "1", "--only", "holes", "--severities", "5")
    box = tmp_path / "cellar/loop/clean"
    methods = ("--methods", "opencv-icp", "--workers", "1")
    assert result(command_here, "stress", box, "-o", "stress", *words, *methods)["cells"]
    curve = ("bench", "curve", "resolution", box, "--values", "160", "--first", "6")
    assert result(command_here, *curve, "--method", "opencv-icp")["points"]
    compared = ("bench", "odometry", box, "--only", "opencv-icp", "--first", "6")
    assert result(command_here, *compared)["results"]


def test_an_odometer_whose_package_or_preset_is_missing_is_left_out_of_a_comparison(
    still, folder, tmp_path, monkeypatch, capsys
):
    for name, line in (("lame", "import not_there\n"), ("plain", "PRESETS = {}\n")):
        text = line + CLASS.replace('"still"', f'"{name}"')
        (tmp_path / f"{name}_odometer.py").write_text(text.replace('"paper":', '"other":'))
        entry = registry.OdometerEntry(f"{name}_odometer", "Still", "geometric")
        monkeypatch.setitem(registry.ODOMETERS, name, entry)
    console = Console()
    assert installed(["still", "lame", "plain"], "paper", console) == ["still"]
    notes = capsys.readouterr().err
    assert "left out: lame needs not_there; try: pip install not_there" in notes
    assert "left out: expected a preset of plain (best, other), found paper" in notes
    assert main(["odometry", "--all", str(folder), "--first", "2", "--preset", "paper"]) == 0
    shown, notes = capsys.readouterr()
    assert "still" in shown and "plain" not in shown
    assert "left out: lame needs not_there" in notes
