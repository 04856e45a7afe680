"""`make --held-out`: what is asked for is a number or a trajectory, recorded, resumed, a run of its
own by the same light; refused in one line.
"""

import argparse
import json
from dataclasses import replace

import numpy as np
import pytest
from iclnuim import shipped
from iclnuim.console import Console
from iclnuim.errors import InputError
from iclnuim.headless.commands import make
from iclnuim.headless.commands.run_options import RunOptions
from iclnuim.headless.farm import held_out
from iclnuim.headless.farm.run_plan import RunPlan
from iclnuim.headless.farm.run_state import run_state
from iclnuim.sequences.run_folder import open_run
from iclnuim.trajectory_files.trajectories import read_trajectory, write_trajectory


def plan_of(out, *words) -> RunPlan:
    parser = argparse.ArgumentParser()
    make.configure(parser)
    args = parser.parse_args(["kt2", "--quick", "--camera", "80x60", "-o", str(out), *words])
    return RunOptions.of(args).plan(args.sequence)


def begin(plan, light="baked"):
    """The training run's folder with its recipe, as a worker settled it, and views that were
    chosen.
    """
    recipe = {
        "job": plan.job.changed(light=light).to_dict(),
        "trajectory_sha256": "a",
        "scene_sha256": "b",
    }
    poses = read_trajectory(shipped.trajectory_file("living_room/kt1")).trajectory[:4]
    open_run(plan.raw, recipe, poses)
    (plan.out / held_out.FOLDER).mkdir(exist_ok=True)
    write_trajectory(plan.out / held_out.FOLDER / held_out.POSES, poses, "tum")
    plan.write_record()


def test_a_number_a_shipped_trajectory_or_a_file_is_asked_for(tmp_path):
    assert plan_of(tmp_path).held_out == ""
    assert plan_of(tmp_path, "--held-out", "12").held_out == "12"
    assert plan_of(tmp_path, "--held-out", "kt1").held_out == "living_room/kt1"
    assert plan_of(tmp_path, "--held-out", "views.txt").held_out.endswith("/views.txt")
    with pytest.raises(
        InputError,
        match="held_out: expected a number of views of at least 1, or a trajectory, found 0",
    ):
        plan_of(tmp_path, "--held-out", "0")


def test_the_record_keeps_it_and_records_without_it_are_read(tmp_path):
    plan = plan_of(tmp_path, "--held-out", "12")
    assert RunPlan.from_dict(json.loads(json.dumps(plan.to_dict())), plan.raw) == plan
    without = plan_of(tmp_path)
    assert not {"held_out", "noisy"} & without.to_dict().keys()
    views = replace(without, noisy=False)
    assert RunPlan.from_dict(views.to_dict(), views.raw) == views
    assert [folder.name for folder in views.variants()] == ["clean"]


@pytest.mark.parametrize("light", ["baked", "path"])
def test_views_are_a_run_of_their_own_by_the_light_that_training_has(tmp_path, light):
    plan = plan_of(tmp_path, "--held-out", "4", "--light", "auto", "--exposure", "0.02")
    begin(plan, light)
    views = held_out.views_plan(plan)
    assert (
        views.out == tmp_path / "held_out" and views.numbers == (0, 1, 2, 3) and not views.held_out
    )
    job = views.job
    assert (job.light, job.samples) == (light, 1 if light == "baked" else 64)
    assert (job.exposure_s, job.scene, job.camera, job.seed) == (
        0,
        plan.job.scene,
        plan.job.camera,
        plan.job.seed,
    )
    assert job.sequence == "living_room/kt2/held_out" and np.array_equal(
        read_trajectory(job.trajectory).trajectory.positions_m,
        read_trajectory(shipped.trajectory_file("living_room/kt1")).trajectory[:4].positions_m,
    )


def test_views_that_stand_are_kept_and_others_are_refused(tmp_path):
    plan = plan_of(tmp_path, "--held-out", "4")
    begin(plan)
    (tmp_path / "held_out/views.json").write_text(json.dumps(held_out._identity(plan)))
    held_out.prepare(plan, Console(quiet=True))  # opens nothing
    for words, said in (
        (("--held-out", "5"), "held_out 4 there, 5 requested"),
        (("--held-out", "4", "--seed", "2"), "seed 0 there, 2 requested"),
        (("--held-out", "4", "--camera", "96x72"), "camera"),
    ):
        with pytest.raises(
            InputError, match=f"the set of views that was started there, found .*{said}"
        ):
            held_out.prepare(plan_of(tmp_path, *words), Console(quiet=True))
    with pytest.raises(InputError, match="expected engine local with held_out"):
        held_out.prepare(
            plan_of(tmp_path, "--held-out", "4", "--engine", "slurm"), Console(quiet=True)
        )


def test_status_counts_them(tmp_path):
    plan = plan_of(tmp_path, "--held-out", "4")
    begin(plan)
    assert run_state(tmp_path)["held_out"] == {}
    views = held_out.views_plan(plan)
    open_run(
        views.raw, {"job": views.job.to_dict()}, read_trajectory(views.job.trajectory).trajectory
    )
    views.write_record()
    for kind in ("rgb", "depth"):
        (views.out / "clean" / kind).mkdir(parents=True)
        (views.out / "clean" / kind / "000002.png").touch()
    (views.out / "clean/frames.jsonl").write_text('{"frame": 2}\n')
    found = run_state(tmp_path)["held_out"]
    assert (found["finished"], found["frames"], found["missing_frames"]) == (1, 4, [0, 1, 3])


@pytest.mark.slow
def test_make_renders_views_that_see_what_training_saw(tmp_path, command_here):
    """Judged by the images: nearly every pixel of a view is where some training frame has the same
    depth, in the same colour.
    """
    from iclnuim.sequences.stored_sequence import StoredSequence, read_images

    words = ["make", "kt2", "--quick", "--camera", "160x120", "-o", tmp_path, "--quiet"]
    assert command_here(*words, "--held-out", "kt2")[0] == 2 and not (tmp_path / "raw").exists()
    assert command_here(*words, "--held-out", "2")[0] == 0
    sequences = []
    for folder in (tmp_path / "clean", tmp_path / "held_out/clean"):
        pairs, truth = StoredSequence(folder).pairs, StoredSequence(folder).truth
        camera = StoredSequence(folder).camera
        sequences.append(
            [(*read_images(p, camera), truth.T_world_camera[k]) for k, p in enumerate(pairs)]
        )
    c = camera.pinhole
    for rgb, depth_z_m, T in sequences[1]:
        seen, off = np.zeros(depth_z_m.shape, bool), []
        for other_rgb, other_z_m, other in sequences[0]:
            points = (other.inverse() @ T).apply(c.unproject(depth_z_m).reshape(-1, 3))
            pixels = np.rint(np.nan_to_num(c.project(points), nan=-9).clip(-9, 999)).astype(int)
            inside = (pixels >= 0).all(1) & (pixels[:, 0] < c.width) & (pixels[:, 1] < c.height)
            u, v = pixels[inside].T
            same = np.abs(points[inside, 2] - other_z_m[v, u]) < 0.05
            seen.reshape(-1)[np.flatnonzero(inside)[same]] = True
            off.append(
                np.median(
                    np.abs(rgb.reshape(-1, 3)[inside][same].astype(int) - other_rgb[v, u][same])
                )
            )
        assert (~seen).mean() <= 0.01 and np.median(off) < 8
