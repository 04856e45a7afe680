"""`iclnuim scene`: one line for what it cannot do. The file it writes: test_living_room.py."""

import json
import subprocess
import sys

import numpy as np
import pytest
from patience import patience


def scene(*arguments):
    command = [sys.executable, "-m", "iclnuim", "scene", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=patience(1200))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("build", "ballroom"), "living_room"),
        (("build", "living_room", "--out", "no such folder/x.blend"), "no such folder"),
        (("compare",), "no samples here"),
    ],
)
def test_bad_input_ends_with_code_2_and_one_line(blender, monkeypatch, arguments, said):
    monkeypatch.setenv("ICLNUIM_SAMPLES", "no samples here")
    done = scene(*arguments)
    assert done.returncode == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    "room", [pytest.param(name, marks=pytest.mark.slow) for name in ("living_room", "office")]
)
def test_our_frames_feed_an_odometer_as_the_official_ones_do(
    samples, blender, monkeypatch, tmp_path, room
):
    """Corners as the mean of three views: in one view their number depends on how edges are sampled
    (blend/README.md).
    """
    pytest.importorskip("cv2")
    monkeypatch.setenv("ICLNUIM_SAMPLES", str(samples))
    done = scene("compare", room, "--samples", 32, "--out", tmp_path, "--quiet", "--json")
    assert done.returncode == 0, done.stderr
    views = json.loads(done.stdout)
    for number, ratios in views.items():
        for name in ("gradient", "grey", "depth_quantiles_m"):
            assert np.all(np.abs(np.array(ratios[name]) - 1) < 1 / 3), (number, name, ratios[name])
    for name in ("corners_20", "corners_10"):
        mean = np.exp(np.mean([np.log(ratios[name]) for ratios in views.values()]))
        assert 2 / 3 < mean < 4 / 3, (name, mean)
    assert len(list(tmp_path.glob("*.png"))) == len(views) == 3


def test_compare_renders_like_make_unless_told_otherwise(samples, blender, monkeypatch, tmp_path):
    pytest.importorskip("cv2")
    monkeypatch.setenv("ICLNUIM_SAMPLES", str(samples))
    done = scene("compare", "office", "--out", tmp_path, "--quiet", "--json")
    assert done.returncode == 0, done.stderr
    for ratios in json.loads(done.stdout).values():
        assert np.allclose(ratios["depth_quantiles_m"], 1, atol=0.01)
        assert ratios["grey"] == pytest.approx(1, abs=0.05)
