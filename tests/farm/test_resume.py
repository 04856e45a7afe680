"""`iclnuim resume`: the folder knows what it was asked for."""

import json

import pytest
from iclnuim.headless.cli import main

pytest.importorskip("bpy", reason="needs the bpy package")


def test_a_local_run_goes_on_with_its_own_options_wherever_it_was_moved(
    repository, tmp_path, capsys
):
    words = (
        "--scene",
        str(repository / "tests/room.obj"),
        "--light",
        "path",
        "--samples",
        "1",
        "--no-denoise",
        "--camera",
        "32x24",
        "--frames",
        "10:60:20",
    )
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
    assert "1 of 3 frames to render, 2 are there" in capsys.readouterr().err


def test_a_frame_that_was_changed_is_noticed_and_rendered_again(repository, tmp_path, capsys):
    run, out = str(tmp_path / "run"), str(tmp_path / "o")
    words = ["--scene", str(repository / "tests/room.obj"), "--light", "path", "--samples", "1"]
    words += ["--no-denoise", "--camera", "32x24", "--frames", ":3", "--out", run]
    assert main(["render", "kt2", *words]) == 0
    frame = tmp_path / "run/exr/000001.exr"
    before = frame.read_bytes()
    # a pixel, as valid as before
    frame.write_bytes(before[:-1] + bytes([before[-1] ^ 1]))
    assert main(["status", run, "--json"]) == 0
    capsys.readouterr()
    assert main(["dataset", run, out]) == 2
    sentence = "000001.exr: expected the frame that was rendered, found a file that was changed"
    assert sentence in capsys.readouterr().err
    assert main(["resume", run]) == 0
    assert frame.read_bytes() == before
    assert main(["dataset", run, out]) == 0
    (tmp_path / "run/frames.jsonl").unlink()  # as of an earlier release: frames are as they are
    assert main(["resume", run]) == 0


def test_an_extended_sequence_says_how_many_frames_are_there(repository, tmp_path, capsys):
    room = str(repository / "tests/room.obj")
    words = ["make", "kt2", "--scene", room, "--light", "path", "--samples", "1", "--no-denoise"]
    words += ["--camera", "32x24", "--out", str(tmp_path / "o"), "--frames"]
    assert main([*words, ":2"]) == 0
    assert "2 of 2 frames to render, in" in capsys.readouterr().err
    assert main([*words, ":5"]) == 0
    assert "3 of 5 frames to render, 2 are there, in" in capsys.readouterr().err


def test_a_refused_command_leaves_the_record_of_the_run_as_it_was(repository, tmp_path, capsys):
    room, out = str(repository / "tests/room.obj"), str(tmp_path / "o")
    small = (
        "--scene",
        room,
        "--light",
        "path",
        "--samples",
        "1",
        "--no-denoise",
        "--camera",
        "32x24",
        "--keep-raw",
    )
    assert main(["make", "kt2", *small, "--frames", ":2", "-o", out]) == 0
    assert main(["make", "kt2", *small, "--frames", ":2", "--depth-noise", "paper", "-o", out]) == 2
    assert main(["resume", out]) == 0
    assert main(["make", "kt2", *small, "--frames", ":1", "-o", out]) == 0
    assert "all 1 requested frames are complete" in capsys.readouterr().err
