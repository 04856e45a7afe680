"""docs/reference/json.md has every key that a command prints with --json, and no other."""

import argparse
import importlib.util
import json
import shutil
import subprocess
import sys

import iclnuim
import numpy as np
import pytest
from iclnuim import checkout
from iclnuim.headless import cli
from iclnuim.tools.write_json_page import sections
from sequences.conftest import labelled_formats, labelled_run, shared_run

__all__ = ["labelled_formats", "labelled_run", "shared_run"]

CAMERA = iclnuim.PinholeCamera.parse("80x60")
#: Commands that open a scene.
BLENDER = ("bake", "status", "surface", "trajectory make", "check-depth")


def look(T):
    """A room of 4 x 5 x 2.5 m with a pattern on its walls."""
    rays = CAMERA.rays() @ T.rotation.T
    walls = np.where(rays > 0, [2.0, 2.5, 2.5], [-2.0, -2.5, 0.0])
    depth_z_m = ((walls - T.translation) / rays).min(axis=-1)
    points = T.translation + rays * depth_z_m[..., None]
    stripes = np.sin(23 * points.sum(-1, keepdims=True))
    return 0.4 + 0.15 * (np.sin(points * [7, 9, 11]) + stripes), depth_z_m


@pytest.fixture(scope="module")
def folder(tmp_path_factory, labelled_formats, shared_run):  # noqa: F811
    """What the lines of the page read."""
    made = tmp_path_factory.mktemp("json")
    t_s = np.arange(16)[:, None] / 30
    start = iclnuim.SE3.from_quat_xyzw([-0.775, 0.281, -0.193, 0.532], [0.0, 0.0, 1.4])
    truth = iclnuim.Trajectory.at_rate(
        start @ iclnuim.SE3.exp(t_s * [0.9, 0.15, 0.6, 0.3, 0.9, 0.15])
    )
    source = iclnuim.frames_from(CAMERA, truth, lambda k: look(truth.T_world_camera[k]))
    iclnuim.make_sequence(source, made / "room", workers=1)
    iclnuim.make_sequence(made / "room", made / "noisy", depth_noise="kinect2012", workers=1)
    shutil.copytree(made / "room", made / "tenfold")
    tenfold = iclnuim.SE3(truth.T_world_camera.rotation, 10 * truth.positions_m)
    longer = iclnuim.Trajectory(truth.stamps_s, tenfold)
    iclnuim.write_trajectory(made / "tenfold/groundtruth.txt", longer, "tum")
    rng = np.random.default_rng(1)
    poses = truth.T_world_camera @ iclnuim.SE3.exp(rng.normal(0, 1e-3, (16, 6)))
    iclnuim.write_trajectory(
        made / "estimate.txt", iclnuim.Trajectory(truth.stamps_s, poses), "tum"
    )
    scaled = iclnuim.SE3(poses.rotation, 100 * poses.translation)
    iclnuim.write_trajectory(made / "scaled.txt", iclnuim.Trajectory(truth.stamps_s, scaled), "tum")
    (made / "keyframes.txt").write_text("0\n")
    world = [T.apply(CAMERA.unproject(look(T)[1]).reshape(-1, 3)) for T in truth.T_world_camera]
    np.savez(made / "points.npz", world_points=np.reshape(world, (16, 60, 80, 3)))
    shutil.copy(checkout.ROOT / "tests/room.obj", made)
    shutil.copytree(labelled_formats / "tum", made / "labelled")
    shutil.copytree(shared_run.path, made / "run")
    assert cli.main(["convert", str(made / "room"), str(made / "replica"), "--format", "replica", "--quiet"]) == 0  # fmt: skip
    return made


def leaves(value, path=""):
    """Path -> value of everything in JSON that has no keys of its own; `\\0` between names."""
    if isinstance(value, dict) and value:
        for name, one in value.items():
            yield from leaves(one, f"{path}\0{name}" if path else name)
    elif isinstance(value, list) and any(isinstance(one, dict) for one in value):
        for one in value:
            yield from leaves(one, f"{path}[]")
    else:
        yield path, value


@pytest.mark.parametrize("section", [s for s in sections() if s.lines], ids=lambda s: s.command)
def test_the_page_has_the_keys_that_the_command_prints(section, folder, monkeypatch, capfd):
    if section.command in BLENDER and importlib.util.find_spec("bpy") is None:
        pytest.skip("needs bpy")
    monkeypatch.chdir(folder)
    found = {}
    for line in section.lines:
        cli.main([*line.split(), *(["--quiet"] if "--quiet" in line else ["--json", "--quiet"])])
        printed, errors = capfd.readouterr()
        assert "expected" not in errors, errors
        if "--quiet" in line:  # makes what the next line reads
            continue
        found |= dict(leaves(json.loads(printed))) if printed else {}

    def is_declared(path, value):
        if any(key.fits(path) for key in section.keys):
            return True
        beginning = path.replace("\0", ".")
        empty = value is None or value in ({}, [])
        return empty and any(key.path.startswith((f"{beginning}.", f"{beginning}[].")) for key in section.keys)  # fmt: skip

    assert [path for path, value in found.items() if not is_declared(path, value)] == []
    required = [key for key in section.keys if not key.optional]
    assert [key.path for key in required if not any(map(key.fits, found))] == []


def with_json():
    """Every command and action that has --json."""
    for command in cli.COMMANDS:
        parser = argparse.ArgumentParser()
        cli._configure(parser, command)
        parsers = {command: parser}
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction):
                parsers |= {f"{command} {name}": one for name, one in action.choices.items()}
        yield from (name for name, one in parsers.items() if "--json" in one._option_string_actions)


def test_every_command_that_has_the_option_is_on_the_page():
    """`resume` prints what `render` prints; other benches and scenes are tools of a checkout."""
    on_page = {section.command for section in sections()}
    tools = {name for name in with_json() if name.startswith(("bench ", "scene "))} - on_page
    assert set(with_json()) - tools - {"resume"} == on_page


def test_the_page_is_written_from_the_declarations(repository):
    words = [sys.executable, str(repository / "tools/write_json_page.py"), "--check"]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, "run python tools/write_json_page.py"
