"""Damaged scene files: each is opened or refused in words; where Blender itself crashes, that is
the parent's to say.
"""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from patience import patience

bpy = pytest.importorskip("bpy", reason="needs the bpy package")
sys.path.insert(0, str(Path(__file__).parent))
import own_scene_files as made  # noqa: E402

READER = Path(__file__).with_name("scene_reader.py")
KINDS = ("obj", "gltf", "glb", "ply", "blend", "usdc", "fbx")
TEXT = ("obj", "gltf")
WORDS = [
    b"nan",
    b"inf",
    b"-1",
    b"1e999",
    b"0",
    b"",
    b"99999999999",
    b"x",
    b"null",
    b"[]",
    b"{}",
    b'"',
]


@pytest.fixture(scope="module")
def originals(tmp_path_factory):
    room = made.small_room(bpy, tmp_path_factory.mktemp("whole"))
    files = {"blend": room}
    for kind in KINDS:
        if kind in made.EXPORTS:
            bpy.ops.wm.open_mainfile(filepath=str(room))
            files[kind] = room.with_suffix(f".{kind}")
            made.EXPORTS[kind](bpy, str(files[kind]))
    return files


def damaged(rng, data: bytes, text: bool) -> bytes:
    """A few bytes changed in place, a word of a text replaced, or a stretch cut, doubled or lost at
    the end.
    """
    changed = bytearray(data)
    way = rng.integers(8)
    at = int(rng.integers(len(data)))
    length = int(rng.integers(1, 300))
    if way == 0:
        return data[:at]
    if way == 1:
        return data[:at] + data[at + length :]
    if way == 2:
        return data[:at] + data[at : at + length] + data[at:]
    if text and way < 7:
        for _ in range(rng.integers(1, 4)):
            words = list(re.finditer(rb'[-\d.eE]+|"[^"]*"', bytes(changed)))
            word = words[rng.integers(len(words))]
            changed[word.start() : word.end()] = WORDS[rng.integers(len(WORDS))]
        return bytes(changed)
    for place in rng.integers(len(data), size=rng.integers(1, 8)):
        changed[place] = rng.integers(256)
    return bytes(changed)


def outcomes(files: list[Path], answers: Path) -> tuple[list[dict], list[str]]:
    """What became of each file, and the files that Blender crashed on; it is started again behind
    those.
    """
    crashed = []
    left = [str(f) for f in files]
    while left:
        done = subprocess.run(
            [sys.executable, str(READER), str(answers), *left],
            capture_output=True,
            timeout=patience(1200),
            check=False,
        )
        rows = [json.loads(line) for line in answers.read_text().splitlines()]
        if done.returncode == 0:
            break
        assert done.returncode < 0, done.stderr[-2000:]  # a signal, never an exception
        crashed.append([r["file"] for r in rows if r.get("begun")][-1])
        left = left[left.index(crashed[-1]) + 1 :]
    return [r for r in rows if not r.get("begun")], crashed


def check(originals, folder, count, kinds=KINDS):
    shutil.copy(originals["gltf"].with_suffix(".bin"), folder)
    shutil.copy(originals["obj"].with_suffix(".mtl"), folder)
    shutil.copytree(originals["blend"].parent / "tex", folder / "tex")
    files = []
    for number, kind in enumerate(kinds):
        rng = np.random.default_rng([number, 5])
        for k in range(count):
            files.append(folder / f"{k}.{kind}")
            files[-1].write_bytes(damaged(rng, originals[kind].read_bytes(), kind in TEXT))
    rows, crashed = outcomes(files, folder / "answers.jsonl")
    assert [r for r in rows if "wrong" in r] == []
    assert len(rows) + len(crashed) == len(files)
    for row in rows:
        assert "triangles" in row or "expected" in row["refused"]
        assert "\n" not in row.get("refused", "")
    return rows, crashed


def test_damaged_files_are_opened_or_refused_in_words(originals, tmp_path):
    rows, crashed = check(originals, tmp_path, 6)
    assert sum("triangles" in r for r in rows) > 5
    assert sum("refused" in r for r in rows) > 5
    assert [c for c in crashed if not c.endswith((".blend", ".usdc"))] == []


@pytest.mark.slow
def test_very_many_damaged_files_are_opened_or_refused_in_words(originals, tmp_path):
    rows, crashed = check(originals, tmp_path, 150)
    assert len(crashed) <= 0.02 * len(rows), crashed
