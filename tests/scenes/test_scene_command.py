"""`iclnuim scene`: the file it writes, and one line for what it cannot do."""

import json
import subprocess
import sys

import pytest


def scene(*arguments):
    command = [sys.executable, "-m", "iclnuim", "scene", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


def test_the_command_writes_the_room_that_is_shipped(built, blender, tmp_path):
    file = tmp_path / "room.blend"
    done = scene("build", "living_room", "--out", file, "--json", "--quiet")
    assert done.returncode == 0, done.stderr
    figures = json.loads(done.stdout)
    assert figures["geometry_sha256"] == built.sha256
    assert figures["bytes"] == file.stat().st_size < 8e6
    assert [p.name for p in tmp_path.iterdir()] == ["room.blend"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("build", "ballroom"), "living_room"),
        (("build", "living_room", "--out", "no such folder/x.blend"), "no such folder"),
        (("compare", "--samples-dir", "no samples here"), "no samples here"),
    ],
)
def test_bad_input_ends_with_code_2_and_one_line(blender, arguments, said):
    done = scene(*arguments)
    assert done.returncode == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr
