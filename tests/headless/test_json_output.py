"""What --json prints is JSON, whatever the figures are: NaN and infinity, which JSON does not have,
are null.
"""

import ast
import json
import math

import numpy as np
import pytest
from iclnuim import checkout, frames_from
from iclnuim.console import Console
from iclnuim.formats.files import read_json, write_json
from iclnuim.formats.ply import write_ply
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.headless import cli
from iclnuim.sequences.writer import write_sequence

CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
SIDES = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]], np.int32)


def strict(text: str):
    """The content of JSON, of which Python also reads NaN."""

    def refuse(word):
        raise AssertionError(f"{word} is no JSON")

    return json.loads(text, parse_constant=refuse)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, np.float64("nan")])
def test_a_figure_that_is_not_finite_is_null_wherever_it_stands(value, capsys, tmp_path):
    values = {"a": value, "b": [1.5, value], "c": {"d": (value, "nan", 3)}, "e": [[value]], "f": 2}
    null = {"a": None, "b": [1.5, None], "c": {"d": [None, "nan", 3]}, "e": [[None]], "f": 2}
    Console(json=True).result(values, "")
    assert strict(capsys.readouterr().out) == null
    write_json(tmp_path / "a.json", values)
    assert read_json(tmp_path / "a.json") == null


def test_only_one_function_makes_the_json_that_commands_print():
    """A command prints by Console.result alone (that nothing else prints is a rule of the house)."""
    found = []
    for path in sorted((checkout.ROOT / "headless" / "commands").glob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Attribute) and node.attr == "dump":
                found.append(path.name)
    assert found == []
    console = (checkout.ROOT / "addon/iclnuim/console.py").read_text()
    assert "json_text(values" in console and "json.dump" not in console


@pytest.fixture
def folder(tmp_path):
    """A sequence of arrays with infinite depth, meshes with NaN, and an estimate that stands still
    but for a lost pose.
    """
    camera = PinholeCamera(32, 24, 30.0, 30.0, 15.5, 11.5)
    still = Trajectory.at_rate(SE3.exp(np.zeros((6, 6))))
    light = np.full((24, 32, 3), 0.5, np.float32)
    depth_z_m = np.full((24, 32), 2.0, np.float32)
    source = frames_from(camera, still, lambda number: (light, depth_z_m))
    write_sequence(source, tmp_path / "seq", formats=("tartanair",), workers=1)
    for path in sorted((tmp_path / "seq").rglob("*_depth.npy")):
        depth = np.load(path)
        depth[:2] = np.inf
        depth[2, :3] = np.nan
        np.save(path, depth)
    write_ply(tmp_path / "model.ply", CUBE, SIDES)
    write_ply(tmp_path / "mesh.ply", np.vstack([CUBE, np.full((1, 3), np.nan)]), SIDES)
    rows = [f"{n / 30:.6f} 0 0 0 0 0 0 1\n" for n in range(6)]
    (tmp_path / "still.txt").write_text("".join(rows))
    return tmp_path


@pytest.mark.parametrize(
    "words",
    [
        "inspect seq",
        "evaluate surface mesh.ply --model model.ply --samples 2000",
        "evaluate surface model.ply --model model.ply --samples 2000 --align icp",
        "evaluate ate still.txt still.txt",
        "evaluate rpe still.txt still.txt",
        "trajectory info still.txt",
        "compare seq seq",
        "fuse seq -o fused.ply",
        "odometry plain seq -o estimate.txt",
    ],
)
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_every_kind_of_figure_is_printed_as_json(folder, words, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    code = cli.main([*words.split(), "--json", "--quiet"])
    printed = capsys.readouterr()
    assert strict(printed.out) if printed.out else code == 2, printed.err


def test_infinite_depth_is_counted_and_read_as_missing(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    cli.main(["inspect", "seq", "--json"])
    found = strict(capsys.readouterr().out)
    assert found["figures"]["depth_m"]["farthest"] == 2.0
    assert found["figures"]["depth_missing_share"] == pytest.approx(67 / 768, abs=1e-4)
    assert any(f"{6 * 67} depths of 6" in text for text in found["warnings"])
    assert not any("65535" in text for text in found["errors"])
