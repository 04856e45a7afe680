"""`iclnuim resume`: the folder knows what it was asked for."""

import json

import pytest
from iclnuim.headless.cli import main

pytest.importorskip("bpy", reason="needs the bpy package")


def test_a_local_run_goes_on_with_its_own_options_wherever_it_was_moved(tmp_path, capsys):
    words = ("--light", "path", "--samples", "1", "--no-denoise", "--camera", "32x24", "--frames", "10:60:20")
    assert main(["render", "kt2", *words, "--out", str(tmp_path / "a")]) == 0
    (tmp_path / "a").rename(tmp_path / "b")
    lost = tmp_path / "b/exr/000030.exr"
    before = lost.read_bytes()
    lost.unlink()
    assert main(["status", str(tmp_path / "b"), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["frames"], said["missing_frames"], said["queue"]) == (3, [30], None)
    assert main(["resume", str(tmp_path / "b")]) == 0
    assert lost.read_bytes() == before
    assert "1 of 3 frames to render" in capsys.readouterr().err
