"""`iclnuim resume`: the folder knows what it was asked for."""

import json
import shutil

import pytest
from iclnuim import __version__, shipped
from iclnuim.formats.files import sha256
from iclnuim.headless.cli import main
from iclnuim.headless.farm.run_plan import find_run, read_plan

pytest.importorskip("bpy", reason="needs the bpy package")
from iclnuim.blender import compat  # noqa: E402


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
    assert "1 of 3 frames to render" in capsys.readouterr().err


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


@pytest.fixture
def begun(repository, tmp_path):
    """A copy of the folders that iclnuim 0.1.0 began, with the option --camera 64x48 --light path
    --samples 1 --frames 0:4, and --stuck-after 90
    and --depth-noise kinect2012 of make; some files removed."""
    shutil.copytree(repository / "tests/farm/begun_by_0_1_0", tmp_path / "begun")
    return tmp_path / "begun"


def test_the_records_of_0_1_0_are_read_as_plans(begun):
    render, make = read_plan(begun / "render"), read_plan(find_run(begun / "make"))
    for plan in (render, make):
        assert (plan.job.light, plan.job.samples, plan.job.camera.width, plan.numbers) == (
            "path",
            1,
            64,
            (0, 1, 2, 3),
        )
    assert (render.command, make.command, make.keep_raw) == ("render", "make", True)
    assert (make.sequences.depth_noise, make.sequences.rgb_noise) == ("kinect2012", "released")
    assert (render.farm.worker_timeout_s, make.farm.worker_timeout_s) == (120.0, 90.0)


def test_what_0_1_0_only_submitted_is_refused_in_a_sentence(begun, capsys):
    (begun / "render/sequence.json").unlink()
    assert main(["resume", str(begun / "render")]) == 2
    assert (
        "version 0.1.0 only submitted this one; try running its command again"
        in capsys.readouterr().err
    )


@pytest.mark.parametrize("command", ["render", "make"])
def test_a_folder_of_0_1_0_is_resumed_or_refused_in_a_line(begun, command, capsys):
    folder = begun / command
    before = {p: p.read_bytes() for p in folder.rglob("*.[ep][xn][rg]")}
    code = main(["resume", str(folder), "--quiet"])
    words = capsys.readouterr().err
    begun = json.loads(
        (folder / ("raw" if command == "make" else "") / "sequence.json").read_text()
    )
    stamped_so = begun["trajectory_sha256"] == sha256(shipped.trajectory_file("kt2").read_bytes())
    if not stamped_so:  # its stamps began at 0 s
        assert "other poses or stamps of the trajectory living_room/kt2" in words
    if (
        begun["blender"] == compat.version_line()
        and stamped_so
        and (command == "render" or __version__ == "0.1.0")
    ):
        assert code == 0, words
        assert main(["status", str(folder), "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["missing"] == 0
    else:  # another Blender's frames, another version's noise, other stamps
        assert code == 2 and len(words.splitlines()) == 1 and "there" in words
    assert {p: p.read_bytes() for p in before} == before
