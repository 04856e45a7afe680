"""The job type for Flamenco 3, compiled in Node with a stub of the Manager; its command lines are
run by the real command.
"""

import argparse
import json
import re
import shutil
import subprocess
import sys

import pytest
from iclnuim import shipped
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.headless.commands import make, task
from iclnuim.headless.farm.chunks import numbers_from
from iclnuim.job import RenderJob
from iclnuim.sequences.sequence_options import SequenceOptions
from iclnuim.settings import declared
from patience import patience

pytestmark = pytest.mark.skipif(
    shutil.which("node") is None, reason="no node on the PATH (Debian: nodejs)"
)

#: Types, and what a setting may have besides, of Flamenco's AvailableJobSetting.
TYPES = {"string", "int32", "float", "bool"}
KEYS = {"key", "type", "subtype", "choices", "propargs", "description", "label", "default", "eval", "evalInfo", "visible", "required", "editable"}  # fmt: skip


@pytest.fixture
def compiled(repository):
    def compile(**settings):
        words = [
            "node",
            repository / "tests/farm/flamenco_author.js",
            repository / "headless/farm/flamenco/iclnuim.js",
        ]
        done = subprocess.run(
            [*words, json.dumps(settings)], capture_output=True, text=True, timeout=patience(30)
        )
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return compile


def words_of(one):
    """As Flamenco's worker puts the line together: exeArgs, argsBefore, the blend file, args."""
    p = one["commands"][0]["parameters"]
    assert isinstance(p["exeArgs"], str) and not p["exeArgs"]
    words = [*p["argsBefore"], p["blendfile"], *p["args"]]
    assert all(isinstance(word, str) and word for word in words)
    return words


def parsed(one):
    parser = argparse.ArgumentParser(exit_on_error=False)
    task.configure(parser)
    return parser.parse_args(words_of(one)[1:])


def test_light_comes_first_and_the_data_set_last(compiled):
    tasks = compiled(out="/shared/kt2", chunk_size=100)["tasks"]
    assert [t["name"] for t in tasks[:2]] == ["light", "frames-0-99"]
    frames = tasks[1:-1]
    assert len(frames) == 9 and all(t["dependencies"] == ["light"] for t in frames)
    assert tasks[-1]["name"] == "dataset" and tasks[-1]["dependencies"] == [
        t["name"] for t in frames
    ]
    assert {t["type"] for t in tasks} == {"blender"}
    assert {t["commands"][0]["name"] for t in tasks} == {"blender-render"}


def test_every_task_is_a_command_line_that_the_command_takes(compiled):
    given = {
        "out": "/shared/k t",
        "frames": "3, 5..9, 40-60",
        "chunk_size": 7,
        "light": "path",
        "samples": 16,
        "seed": 3,
    }
    tasks = compiled(**given, more_options='--no-denoise --scene "my room.blend"', sequence="kt1")[
        "tasks"
    ]
    stages = [parsed(t) for t in tasks]
    assert [s.action for s in stages] == ["simulations", "light", *["frames"] * 4, "dataset"]
    assert tasks[1]["dependencies"] == ["simulations"] and tasks[2]["dependencies"] == ["light"]
    for stage in stages:
        assert (stage.sequence, str(stage.out), stage.light, stage.samples) == (
            "kt1",
            "/shared/k t",
            "path",
            16,
        )
        assert (stage.seed, stage.denoise, stage.scene, stage.progress) == (
            3,
            False,
            "my room.blend",
            "flamenco",
        )
    shared = [numbers_from(s.numbers) for s in stages if s.action == "frames"]
    wanted = sorted({3, *range(5, 10), *range(40, 61)})
    assert [n for numbers in shared for n in numbers] == wanted
    assert list(numbers_from(stages[-1].numbers)) == wanted
    assert [t["commands"][0]["totalStepCount"] for t in tasks] == [
        0,
        0,
        *map(len, shared),
        len(wanted),
    ]


def test_frames_alone_where_no_data_set_is_wanted(compiled):
    job = compiled(out="/o", frames="0-3", chunk_size=2, dataset=False)
    assert [t["name"] for t in job["tasks"]] == ["light", "frames-0,1", "frames-2,3"]


def test_settings_are_such_as_flamenco_knows(compiled):
    settings = compiled(out="/o")["type"]["settings"]
    assert len({s["key"] for s in settings}) == len(settings)
    for setting in settings:
        assert setting["type"] in TYPES and set(setting) <= KEYS and setting["description"]
        assert setting.get("required") or "default" in setting


@pytest.mark.slow
def test_the_tasks_run_one_after_another_make_the_bytes_of_a_local_run(compiled, tmp_path):
    pytest.importorskip("bpy", reason="needs the bpy package")
    small = "--no-denoise --depth-noise kinect2012"
    out, frames = tmp_path / "far", 5
    job = compiled(
        out=str(out),
        frames="0-4",
        chunk_size=3,
        light="path",
        samples=1,
        camera="40x30",
        more_options=small,
    )
    said = [run(words_of(t)) for t in job["tasks"][:-1]]
    assert "skipping existing frame 1\n" in run(words_of(job["tasks"][1]))
    said.append(run(words_of(job["tasks"][-1])))
    for one, text in zip(job["tasks"], said, strict=True):
        steps = re.findall(r"^Time: [0-9:.]+|^skipping existing frame", text, re.M)
        assert len(steps) == one["commands"][0]["totalStepCount"], text
    assert len(re.findall(rf"^Saved: '{out}/clean/rgb/\d{{6}}.png'", said[-1], re.M)) == frames
    assert run(words_of(job["tasks"][1])).count("skipping existing frame") == 3, (
        "pairs that stand need no frame"
    )
    near = tmp_path / "near"
    words = [
        "--camera",
        "40x30",
        "--light",
        "path",
        "--samples",
        "1",
        *small.split(),
        "--frames",
        "0:5",
    ]
    run(["make", "living_room/kt2", *words, "--out", str(near)])
    images = sorted(p.relative_to(near) for p in near.rglob("*.png"))
    assert len(images) == 4 * frames
    assert [p for p in images if (near / p).read_bytes() != (out / p).read_bytes()] == []


def run(words):
    done = subprocess.run(
        [sys.executable, "-m", "iclnuim", *words],
        capture_output=True,
        text=True,
        timeout=patience(120),
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_settings_are_those_that_are_declared(compiled):
    """The job type is a static file: what it repeats of the declarations is compared here."""
    settings = {s["key"]: s for s in compiled(out="/o")["type"]["settings"]}
    job, sequence = declared(RenderJob), declared(SequenceOptions)
    assert (settings["light"]["choices"], settings["light"]["default"]) == (
        sorted(job["light"].choices),
        job["light"].default,
    )
    assert (settings["seed"]["default"], settings["seed"]["propargs"]["min"]) == (
        job["seed"].default,
        job["seed"].low,
    )
    assert (
        settings["samples"]["propargs"]["min"]
        == job["samples"].low - 1
        == settings["samples"]["default"]
    ), "0: the light's own"
    parser = argparse.ArgumentParser()
    make.configure(parser)
    for name in ("depth_noise", "rgb_noise"):
        assert (
            settings[name]["default"] == parser.get_default(name)
            and settings[name]["default"] in sequence[name].choices
        )
    camera = PinholeCamera()
    assert settings["camera"]["default"] == f"{camera.width}x{camera.height}"
    assert settings["sequence"]["default"] in shipped.sequence_names()
    known = {*job, *sequence, "camera", "sequence", "frames", "out"}
    assert set(settings) - known == {"chunk_size", "dataset", "more_options", "iclnuim"}
