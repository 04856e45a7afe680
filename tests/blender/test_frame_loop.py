"""The render command: exact depth, equal bytes however a frame is made, resume, stop, kill, and
refusals in words.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections import namedtuple
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from iclnuim.errors import WorkError
from iclnuim.formats.exr import read_exr
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.job import RenderJob
from iclnuim.sequences.run_folder import read_run
from iclnuim.trajectory_files.trajectories import read_trajectory


def frames(out):
    return {p.name: p.read_bytes() for p in sorted((out / "exr").glob("[0-9]*.exr"))}


@pytest.fixture(scope="module")
def whole_run(render, tmp_path_factory):
    out = tmp_path_factory.mktemp("whole") / "run"
    done = render(out)
    assert done.returncode == 0, done.stderr
    return out


def job_of(run, **settings):
    """The job that a run folder was made by, with other settings."""
    return RenderJob.from_dict(json.loads((run / "sequence.json").read_text())["job"]).changed(
        **settings
    )


def analytic_depth(camera, T):
    """Planar Z of the cornered room without its ramp: the nearer of floor and wall; NaN near the
    ramp.
    """
    rays = camera.rays() @ T.rotation.T
    x, y, z = T.translation
    with np.errstate(divide="ignore"):
        floor = np.where(rays[..., 2] < 0, -z / rays[..., 2], np.inf)
        wall = np.where(rays[..., 1] > 0, (2 - y) / rays[..., 1], np.inf)
    return np.minimum(floor, wall)


def test_depth_is_planar_and_exact_to_a_tenth_of_a_millimetre(whole_run):
    run = read_run(whole_run)
    poses = read_trajectory(whole_run / "groundtruth.txt", "tum").trajectory.T_world_camera
    for number in (0, 5, 11):
        z = read_exr(run.frame_file(number))["Z"]
        truth = analytic_depth(run.camera, poses[number])
        off = np.abs(z - truth)
        nearer = z < truth - 1e-3  # the ramp stands before floor and wall
        assert 0.002 < nearer.mean() < 0.3
        assert np.quantile(off[~nearer], 0.995) < 1e-4
        assert np.median(off[~nearer]) < 1e-5


def test_depth_is_the_same_bits_at_any_sample_count_and_with_antialiasing(
    render_here, whole_run, tmp_path
):
    for name, changed in (("many", {"samples": 16}), ("soft", {"antialias": True})):
        out = tmp_path / name
        render_here(out, "3", job=job_of(whole_run, **changed))
        a = read_exr(out / "exr/000003.exr")
        b = read_exr(whole_run / "exr/000003.exr")
        assert a["Z"].dtype == np.float32
        assert np.array_equal(a["Z"], b["Z"])
        assert not np.array_equal(a["R"], b["R"])


@pytest.mark.parametrize(
    "width, height", [pytest.param(2100, 2049, marks=pytest.mark.slow), (16, 8200)]
)
def test_an_image_larger_than_the_tiles_of_cycles_is_not_black(
    render_here, whole_run, tmp_path, width, height
):
    """2048 x 2048 pixels by default, 8192 x 8192 at most: in tiles, Cycles has no passes in memory,
    and the frame would be black.
    """
    camera = PinholeCamera(width, height, 1600, 1600, (width - 1) / 2, (height - 1) / 2)
    render_here(
        tmp_path / "large", "3", job=job_of(whole_run, camera=camera, samples=1, denoise=False)
    )
    run = read_run(tmp_path / "large")
    z = read_exr(run.frame_file(3))["Z"]
    truth = analytic_depth(camera, run.truth().T_world_camera[3])
    assert np.median(np.abs(z - truth)) < 1e-5 and np.median(read_exr(run.frame_file(3))["G"]) > 0.1


def test_a_frame_is_the_same_bytes_alone_in_sequence_backwards_and_resumed(
    render_here, whole_run, tmp_path
):
    reference = frames(whole_run)
    assert len(reference) == 12
    out = tmp_path / "parts"
    for part in ("7", "::-3", "0:5", "::"):
        render_here(out, part, job=job_of(whole_run))
    assert frames(out) == reference


def test_a_second_start_renders_nothing_again(render, whole_run):
    before = {p.name: p.stat().st_mtime_ns for p in (whole_run / "exr").iterdir()}
    done = render(whole_run)
    assert done.returncode == 0
    assert "0 of 12 frames" in done.stderr
    assert {p.name: p.stat().st_mtime_ns for p in (whole_run / "exr").iterdir()} == before


def test_broken_and_foreign_frames_are_rendered_again(render, whole_run, tmp_path):
    reference = frames(whole_run)
    out = tmp_path / "damaged"
    shutil.copytree(whole_run, out)
    (out / "exr/000002.exr").write_bytes(reference["000002.exr"][:-100])
    (out / "exr/000004.exr").write_bytes(b"")
    os.remove(out / "exr/000006.exr")
    done = render(out)
    assert "3 of 12 frames" in done.stderr
    assert frames(out) == reference


def test_the_run_folder_tells_camera_poses_and_recipe(whole_run, forward_path):
    recipe = json.loads((whole_run / "sequence.json").read_text())
    assert (
        recipe["job"]["samples"] == 2
        and recipe["job"]["seed"] == 0
        and recipe["schema_version"] == 1
    )
    assert json.loads((whole_run / "camera.json").read_text()) == recipe["job"]["camera"]
    ours = read_trajectory(whole_run / "groundtruth.txt", "tum").trajectory
    theirs = read_trajectory(forward_path, "tum").trajectory
    assert np.abs(ours.positions_m - theirs.positions_m).max() < 1e-8
    assert sorted(p.name for p in whole_run.iterdir()) == [
        ".farm",
        "camera.json",
        "exr",
        "frames.jsonl",
        "groundtruth.txt",
        "sequence.json",
    ]


def test_background_is_zero(render_here, tmp_path, forward_path):
    """Looking up from the cornered room, where there is nothing."""
    text = [line for line in forward_path.read_text().splitlines() if not line.startswith("#")][:1]
    stamp, x, y, z, *_ = text[0].split()
    up = tmp_path / "up.txt"
    up.write_text(f"{stamp} {x} {y} {z} 0 0 0 1\n{float(stamp) + 1} {x} {y} {z} 0 0 0 1\n")
    render_here(tmp_path / "run", "0", trajectory=up)
    assert (read_exr(tmp_path / "run/exr/000000.exr")["Z"] == 0).all()


@pytest.fixture(scope="module")
def long_path(tmp_path_factory):
    """A TUM file of 400 poses that look along +y: with small frames none of the tests that end it
    early sees its end.
    """
    path = tmp_path_factory.mktemp("path") / "long.txt"
    half = np.sqrt(0.5)
    np.savetxt(
        path, [(k / 30, 0.001 * k, -1.5, 1.3, -half, 0, 0, half) for k in range(400)], fmt="%.9f"
    )
    return path


def start(render, out, *options, **paths):
    return subprocess.Popen(
        render.command(out, *options, **paths), stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL
    )


def wait_for_frames(out, count, process, seconds=120):
    until = time.monotonic() + seconds
    while time.monotonic() < until and process.poll() is None:
        if len(list((out / "exr").glob("[0-9]*.exr"))) >= count:
            return
        time.sleep(0.01)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_stops_after_the_frame_in_work_and_leaves_all_valid(
    render, long_path, tmp_path, number
):
    out = tmp_path / "run"
    process = start(render, out, "--workers", "1", trajectory=long_path)
    wait_for_frames(out, 2, process)
    process.send_signal(number)
    assert process.wait(120) == 130
    run = read_run(out)
    numbers = run.frame_numbers()
    assert 2 <= len(numbers) < 400
    assert run.missing(range(numbers[-1] + 1)) == []
    assert not list(out.glob(".work*"))


def killed_and_resumed(render, out, kills, seed, *options, **paths):
    """Kill -9 at random moments until done; every frame's modification time is taken as soon as it
    is seen.
    """
    rng = np.random.default_rng(seed)
    first_seen = {}
    for _ in range(kills):
        process = start(render, out, *options, **paths)
        at_least = len(list((out / "exr").glob("[0-9]*.exr"))) if out.exists() else 0
        wait_for_frames(out, min(at_least + int(rng.integers(0, 2)), 11), process)
        time.sleep(rng.uniform(0, 0.3))
        process.kill()
        process.wait()
        for path in (out / "exr").glob("[0-9]*.exr"):
            first_seen.setdefault(path.name, path.stat().st_mtime_ns)
    last = subprocess.run(render.command(out, *options, **paths), capture_output=True, text=True)
    assert last.returncode == 0, last.stderr
    return first_seen


def check_kills(render, render_here, tmp_path, kills, *options, **paths):
    out = tmp_path / "killed"
    undisturbed = tmp_path / "undisturbed"
    first_seen = killed_and_resumed(render, out, kills, 5, *options, **paths)
    render_here(undisturbed, job=job_of(out))
    assert frames(out) == frames(undisturbed)
    again = []
    for name, when in first_seen.items():
        if (out / "exr" / name).stat().st_mtime_ns != when:
            again.append(name)
    assert again == []
    assert sorted(p.name for p in out.iterdir()) == [
        ".farm",
        "camera.json",
        "exr",
        "frames.jsonl",
        "groundtruth.txt",
        "sequence.json",
    ]
    assert not list((out / "exr").glob(".*"))


def test_killed_and_started_again_no_frame_is_lost_or_made_twice(render, render_here, tmp_path):
    check_kills(render, render_here, tmp_path, 1, "--samples", "32", "--camera", "64x48")


@pytest.mark.slow
def test_killed_twenty_times_and_started_again_no_frame_is_lost_or_made_twice(
    render, render_here, tmp_path
):
    check_kills(render, render_here, tmp_path, 20, "--samples", "64", "--camera", "160x120")


REFUSALS = {
    "another_recipe": (("--samples", "3"), "samples 2 there, 3 requested"),
    "no_such_sequence": (("kt9",), "living_room/kt0"),
    "no_such_frame": (("--frames", "50:60"), "0..11"),
    "a_broken_slice": (("--frames", "1:2:0"), "A:B:S"),
    "a_camera_of_nothing": (("--camera", "0x0"), "camera"),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_refusals_are_one_line_and_exit_code_2(render, whole_run, case):
    options, words = REFUSALS[case]
    done = render(whole_run, *options)
    assert done.returncode == 2
    assert words in done.stderr
    assert "Traceback" not in done.stderr
    assert len([line for line in done.stderr.splitlines() if line.startswith("iclnuim")]) == 1


def test_scene_files_that_cannot_be_opened_are_refused(render, tmp_path):
    broken = tmp_path / "broken.blend"
    broken.write_bytes(b"BLENDER-v405 and no more")
    for scene, words in (
        (broken, "broken.blend"),
        (tmp_path / "absent.glb", "no such file"),
        (tmp_path / "room.xyz", ".blend"),
    ):
        done = render(tmp_path / "out", scene=scene)
        assert done.returncode == 2, done.stderr
        assert words in done.stderr and "Traceback" not in done.stderr


def test_an_output_that_is_a_file_or_holds_other_files_is_refused(render, tmp_path):
    taken = tmp_path / "taken"
    taken.write_text("mine")
    assert render(taken).returncode == 2
    assert taken.read_text() == "mine"
    folder = tmp_path / "photos"
    folder.mkdir()
    (folder / "holiday.jpg").write_bytes(b"mine")
    done = render(folder)
    assert done.returncode == 2 and "other files" in done.stderr
    assert [p.name for p in folder.iterdir()] == ["holiday.jpg"]


def test_a_disk_too_small_is_said_before_rendering(whole_run, monkeypatch):
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(1, 1, 1000))
    with pytest.raises(WorkError, match=r"12 frames need up to .* GB"):
        read_run(whole_run).check_space(12)


def test_ground_truth_counts_in_the_space_that_is_needed(whole_run, monkeypatch):
    run = read_run(whole_run)
    usage = namedtuple("usage", "total used free")
    pixels = run.camera.width * run.camera.height
    job = run.recipe["job"]
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(1, 1, 12 * pixels))
    replace(run, recipe={**run.recipe, "job": {**job, "ground_truth": False}}).check_space(1)
    with pytest.raises(WorkError, match="1 frames need up to"):
        replace(run, recipe={**run.recipe, "job": {**job, "ground_truth": True}}).check_space(1)


def test_the_script_refuses_an_unknown_choice_with_2(repository):
    """An unexpected error inside: tests/headless/test_exit_codes.py."""
    program = (
        "import runpy, sys; sys.argv = ['render.py', 'kt2', '--light', 'nonsense-\\0']\n"
        f"runpy.run_path({str(repository / 'headless/render.py')!r}, run_name='__main__')"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.returncode == 2


def test_check_depth_finds_nothing_wrong_with_our_frames_and_much_with_shifted_ones(
    whole_run, tmp_path, command_here
):
    pytest.importorskip("embreex")
    from iclnuim.formats.exr import write_exr

    run = [sys.executable, "-m", "iclnuim", "check-depth", "--json"]
    good = subprocess.run([*run, str(whole_run)], capture_output=True, text=True)
    assert good.returncode == 0, good.stderr
    figures = json.loads(good.stdout)
    assert (
        figures["within_01mm_share"] > 0.999
        and figures["median_m"] < 1e-5
        and figures["edge_share"] < 0.05
    )
    shifted = tmp_path / "shifted"
    shutil.copytree(whole_run, shifted)
    for file in (shifted / "exr").iterdir():
        channels = read_exr(file)
        channels["Z"] = np.roll(channels["Z"], 1, axis=1)
        write_exr(file, channels)
    code, printed, _ = command_here("check-depth", "--json", shifted)
    assert code == 3
    assert any(line.startswith("within 0.1 mm: ") for line in json.loads(printed)["failed"])
    assert "failed: within 0.1 mm: " in command_here("check-depth", shifted)[1]


@pytest.mark.parametrize(
    "settings",
    [{}, {"antialias": True, "ground_truth": True}, {"exposure_s": 0.02, "readout_s": 0.02}],
)
def test_passes_taken_in_memory_give_the_bytes_of_passes_in_files(
    render_here, cornered_room, tmp_path, monkeypatch, settings
):
    from contextlib import nullcontext

    from iclnuim.blender.render import frames as loop

    written = []
    original = loop.render
    monkeypatch.setattr(
        loop, "render", lambda *a, **k: written.append(original(*a, **k)) or written[-1]
    )
    render_here(tmp_path / "memory", "3", **settings)
    assert written and all(isinstance(raw, dict) for raw in written)
    written.clear()
    monkeypatch.setattr(
        loop, "passes_in_memory", lambda wanted: nullcontext(None)
    )  # as in a Blender without access
    render_here(tmp_path / "file", "3", **settings)
    assert written and all(isinstance(raw, Path) for raw in written)
    assert frames(tmp_path / "memory") == frames(tmp_path / "file")
