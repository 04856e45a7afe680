"""`iclnuim scene`: one line for what it cannot do. The file it writes: test_living_room.py."""

import subprocess
import sys

import pytest


def scene(*arguments):
    command = [sys.executable, "-m", "iclnuim", "scene", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


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
