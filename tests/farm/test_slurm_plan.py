"""What is handed over to Slurm, and how it is asked for: everything that can be said without one."""

import argparse
import json
import os
import stat
from dataclasses import replace

import numpy as np
import pytest
from iclnuim import shipped
from iclnuim.errors import InputError, WorkError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.headless.cli import main
from iclnuim.headless.commands import make, render
from iclnuim.headless.commands.run_options import RunOptions
from iclnuim.headless.farm import estimate, run_plan, slurm, slurm_queue, tasks
from iclnuim.headless.farm.farm_settings import SlurmSettings, minutes, read_settings
from iclnuim.headless.farm.run_plan import RECORD, RunPlan, find_run, read_plan
from iclnuim.job import shipped_job
from iclnuim.sequences.frame_source import frames_of_run
from iclnuim.sequences.run_folder import load_trajectory, open_run
from iclnuim.sequences.sequence_options import SequenceOptions
from iclnuim.sequences.writer import SequenceWriter

TINY = ("--camera", "16x12", "--frames", "0:10")


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("ICLNUIM_CACHE", str(tmp_path / "cache"))


@pytest.fixture
def job():
    return shipped_job("kt2").changed(camera=PinholeCamera.parse("16x12"))


def begun(job, raw, frames):
    """A run folder with these frames rendered."""
    run = open_run(raw, {"job": job.to_dict()}, load_trajectory(job))
    for number in frames:
        run.write_frame(number, np.full((12, 16, 3), 0.2), np.full((12, 16), 1.0 + number))
    return run


@pytest.fixture
def pretended(tmp_path, monkeypatch):
    """`pretended(queue="13_0 RUNNING")` puts commands on the PATH that answer as a Slurm would;
    each sbatch is kept.
    """
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}:{os.environ['PATH']}")
    (tmp_path / "bin").mkdir()

    def say(queue="", most=1001, refuse=99):
        given = f'n=$(ls {tmp_path}/sent* 2>/dev/null | wc -l); [ $n -lt {refuse} ] || {{ echo "Invalid account" >&2; exit 1; }}'
        commands = {
            "sbatch": f'{given}; cp "$1" {tmp_path}/sent$((n + 11)); echo "Submitted batch job $((n + 11))"',
            "squeue": f"printf '{queue}'",
            "scontrol": f"echo 'MaxArraySize            = {most}'",
            "scancel": f"echo $@ > {tmp_path}/cancelled",
            "srun": "true",
        }
        for name, text in commands.items():
            path = tmp_path / "bin" / name
            path.write_text(f"#!/bin/sh\n{text}\n")
            path.chmod(path.stat().st_mode | stat.S_IXUSR)
        return lambda: [p.read_text() for p in sorted(tmp_path.glob("sent*"))]

    return say


def option(script, name):
    return [
        line.split("=", 1)[1]
        for line in script.splitlines()
        if line.startswith(f"#SBATCH --{name}=")
    ]


@pytest.mark.parametrize(
    "text, expected",
    [
        ("30", 30),
        ("90:00", 90),
        ("2:00:00", 120),
        ("0:00:30", 1),
        ("1-12", 2160),
        ("1-0:30", 1470),
        ("2-1:1:1", 2942),
    ],
)
def test_times_are_read_as_slurm_reads_them(text, expected):
    assert minutes(text) == expected


@pytest.mark.parametrize("text", ["", "soon", "0", "1:2:3:4", "-5"])
def test_other_times_are_refused(text):
    with pytest.raises(InputError, match="a time"):
        minutes(text)


def test_settings_come_from_a_file_and_unknown_keys_are_refused(tmp_path):
    file = tmp_path / "cluster.toml"
    file.write_text(
        'partition = "long"\ntime = 45\nsetup = ["module load x"]\n[extra]\nreservation = "r"\n'
    )
    assert read_settings(file) == SlurmSettings(
        partition="long", time="45", setup=("module load x",), extra={"reservation": "r"}
    )
    for text, words in (
        ("partion = 1", "partion"),
        ("cpus = 0", "cpus: expected a whole number of 1 or more"),
        ("cpus = [", "TOML"),
    ):
        file.write_text(text)
        with pytest.raises(InputError, match=words):
            read_settings(file)


def test_printing_needs_no_slurm_and_leaves_nothing(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    out = tmp_path / "out"
    words = ("make", "kt2", *TINY, "--engine", "slurm", "--print-only", "--json", "--out", str(out))
    assert (
        main(
            [
                *words,
                "--time",
                "1:00:00",
                "--scratch",
                "$TMPDIR/a b",
                "--partition",
                "p",
                "--cpus",
                "6",
            ]
        )
        == 0
    )
    said = json.loads(capsys.readouterr().out)
    light, frames, dataset = said["scripts"]
    assert option(light, "dependency") == [] and option(dataset, "dependency") == [
        "afterany:LIGHT:FRAMES"
    ]
    assert option(frames, "dependency") == ["afterok:LIGHT"]
    for script in said["scripts"]:
        assert (option(script, "time"), option(script, "partition")) == (["60"], ["p"])
        assert "#SBATCH --requeue" in script.splitlines() and option(script, "cpus-per-task") == [
            "6"
        ]
        assert (
            'export ICLNUIM_SCRATCH="$TMPDIR/a b"' in script
            and "--cpus-per-task=6" in script.split("srun")[-1]
        )
    assert said["estimate"]["frames"] == 10 and said["estimate"]["core_hours"] > 0
    assert not out.exists()


def test_printing_without_slurm_as_engine_is_bad_input(capsys):
    assert main(["render", "kt2", "--print-only"]) == 2
    assert "--engine slurm" in capsys.readouterr().err


def test_without_slurm_the_command_says_so(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert main(["render", "kt2", "--engine", "slurm", "--out", str(tmp_path / "o")]) == 3
    assert (
        "Slurm is not available here" in capsys.readouterr().err and not (tmp_path / "o").exists()
    )


def test_light_frames_and_data_set_wait_for_each_other(pretended, tmp_path, capsys):
    sent = pretended(most=4)
    words = (
        "make",
        "kt2",
        *TINY,
        "--engine",
        "slurm",
        "--chunk-minutes",
        "1e-5",
        "--out",
        str(tmp_path / "o"),
    )
    assert main(list(words)) == 0, capsys.readouterr().err
    scripts = sent()
    assert [option(s, "job-name")[0] for s in scripts] == [
        "iclnuim-light",
        *["iclnuim-frames"] * 3,
        "iclnuim-dataset",
    ]
    after = [option(s, "dependency") for s in scripts]
    assert after == [[], *[["afterok:11"]] * 3, ["afterany:11:12:13:14"]]
    assert [option(s, "array")[0].split("%")[0] for s in scripts[1:4]] == ["0-2", "0-2", "0-3"]
    jobs = slurm_queue.recorded(tmp_path / "o/raw")
    assert sorted(n for job in jobs for chunk in job.chunks for n in chunk) == list(range(10))
    assert "submitted: light as job 11" in capsys.readouterr().err


def test_simulations_are_baked_before_the_light(pretended, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(run_plan, "may_simulate", lambda scene: True)
    sent = pretended()
    words = [
        "make",
        "kt2",
        "--frames",
        "870:880",
        "--engine",
        "slurm",
        "--out",
        str(tmp_path / "o"),
    ]
    assert main(words) == 0
    scripts = sent()
    stages = ["simulations", "light", "frames", "dataset"]
    assert [option(s, "job-name") for s in scripts] == [[f"iclnuim-{one}"] for one in stages]
    after = [option(s, "dependency") for s in scripts]
    assert after == [[], ["afterok:11"], ["afterok:12"], ["afterany:11:12:13"]]
    assert option(scripts[0], "time") == ["119"], "all frames up to the last are simulated"
    assert "submitted: simulations as job 11" in capsys.readouterr().err
    assert main([*words[:-1], str(tmp_path / "shown"), "--print-only"]) == 0
    printed = capsys.readouterr().out
    assert "afterany:SIMULATIONS:LIGHT:FRAMES" in printed
    assert "after 30 min of simulations, a guess of 2 s a frame, if the scene has any" in printed
    assert main([*words[:-1], str(tmp_path / "shown"), "--print-only", "--time", "7"]) == 0
    scripts = capsys.readouterr().out.split("# job ")[1:]
    assert [option(s, "time") for s in scripts] == [["7"]] * 4, "an explicit limit is of all tasks"


def test_what_slurm_refuses_is_said_and_what_was_sent_is_cancelled(pretended, tmp_path, capsys):
    pretended(refuse=1)
    assert main(["render", "kt2", *TINY, "--engine", "slurm", "--out", str(tmp_path / "o")]) == 3
    assert "Invalid account" in capsys.readouterr().err
    assert (tmp_path / "cancelled").read_text() == "11\n"


def test_frames_of_tasks_in_the_queue_are_not_asked_for_again(pretended, job, tmp_path):
    raw = tmp_path / "o/raw"
    begun(job, raw, [0, 1])
    chunks = ((0, 1), (2, 3), (4, 5))
    slurm_queue.record(
        raw, [slurm_queue.Submitted("11", "light"), slurm_queue.Submitted("12", "frames", chunks)]
    )
    pretended(queue="12_1 RUNNING\\n99_2 PENDING\\n")
    batch = slurm.prepare(RunPlan(job, raw, tuple(range(8))))
    assert batch.waiting == {"12_1": "RUNNING"}
    assert [n for _, array in batch.stages for chunk in array for n in chunk] == [4, 5, 6, 7]


@pytest.mark.parametrize(
    ("other", "words"),
    [
        (("kt2", *TINY, "--seed", "3"), "seed 0 there, 3 requested"),
        (("office/kt1", *TINY), "scene living_room there, office requested"),
        (("kt2", *TINY, "--depth-noise", "paper"), "depth_noise released there, paper requested"),
    ],
)
def test_another_command_is_refused_while_the_first_waits_in_the_queue(
    pretended, tmp_path, capsys, other, words
):
    pretended(queue="11_0 PENDING\\n12_0 PENDING\\n13 PENDING\\n")
    out = ("--engine", "slurm", "--out", str(tmp_path / "o"))
    assert main(["make", "kt2", *TINY, *out]) == 0
    assert main(["make", *other, *out]) == 2
    assert words in capsys.readouterr().err
    assert read_plan(find_run(tmp_path / "o")).job.sequence == "living_room/kt2"


def test_another_recipe_in_the_folder_is_refused_before_anything_is_sent(
    pretended, job, tmp_path, capsys
):
    begun(job, tmp_path / "o", [])
    sent = pretended()
    assert (
        main(
            [
                "render",
                "kt2",
                *TINY,
                "--samples",
                "7",
                "--engine",
                "slurm",
                "--out",
                str(tmp_path / "o"),
            ]
        )
        == 2
    )
    assert "samples 1 there, 7 requested" in capsys.readouterr().err and sent() == []


def test_the_data_set_task_makes_what_is_there_and_tells_what_is_missing(job, tmp_path):
    raw, numbers = tmp_path / "o/raw", (0, 1, 2, 3)
    begun(job, raw, [0, 1, 3])
    plan = RunPlan(job, raw, numbers, asked_for(tmp_path).sequences, keep_raw=False)
    with pytest.raises(WorkError, match=r"1 of 4 frames are not rendered \(the first is 2\)"):
        tasks.dataset(plan, lambda number: None)
    assert plan.missing() == [2] and not slurm.complete(plan)
    begun(job, raw, [2])
    assert tasks.dataset(plan, lambda number: None) == 4
    assert slurm.complete(plan) and plan.missing() == []
    image = raw.parent / "noisy/depth/000003.png"
    image.write_bytes(image.read_bytes()[:-9])
    assert plan.missing() == [3], "a damaged image wants its frame again"
    assert slurm.complete(plan), "looking changes nothing"


def test_clean_and_noisy_are_those_of_a_local_make(job, tmp_path):
    raw, plan = tmp_path / "near/raw", asked_for(tmp_path)
    run = begun(job, raw, range(3))
    near = RunPlan(job, raw, (0, 1, 2), plan.sequences)
    SequenceWriter(frames_of_run(run, [0, 1, 2]), near.variants()).write()
    begun(job, tmp_path / "far/raw", range(3))
    tasks.dataset(
        RunPlan(job, tmp_path / "far/raw", (0, 1, 2), plan.sequences), lambda number: None
    )
    files = sorted(p.relative_to(tmp_path / "near") for p in (tmp_path / "near").rglob("*.png"))
    assert len(files) == 12
    assert all(
        (tmp_path / "near" / p).read_bytes() == (tmp_path / "far" / p).read_bytes() for p in files
    )


def asked_for(tmp_path, *words, command=make):
    """The plan of `iclnuim make kt2`, or of other words."""
    parser = argparse.ArgumentParser()
    command.configure(parser)
    args = parser.parse_args([*(words or ("kt2", *TINY)), "--out", str(tmp_path / "plan")])
    return RunOptions.of(args).plan(args.sequence)


def test_a_plan_is_recorded_and_read_back_wherever_the_folder_moves(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.txt").write_text("0 0 0 0 0 0 0 1\n")
    words = [
        "--scene",
        "office",
        "--trajectory",
        "mine.txt",
        "--seed",
        "4",
        "--depth-noise",
        "redwood",
        "--workers",
        "1",
    ]
    words += [
        "--format",
        "tum",
        "--format",
        "nerf",
        "--time",
        "1:00",
        "--depth-settings",
        "{}",
        "--up=-y",
    ]
    plan = asked_for(tmp_path, *words)
    plan.write_record()
    (tmp_path / "plan").rename(tmp_path / "b")
    raw = find_run(tmp_path / "b")
    again = read_plan(raw)
    assert (again.raw, again.out, again.job.scene, again.job.seed) == (
        raw,
        tmp_path / "b",
        "office",
        4,
    )
    assert (again.job.trajectory, again.sequences.depth_noise) == (
        str(tmp_path / "mine.txt"),
        "redwood",
    )
    assert again == replace(plan, raw=raw)


def test_light_is_chosen_for_a_scene_without_a_map_unless_options_name_it_or_its_map(
    tmp_path, monkeypatch
):
    own = ("--scene", str(tmp_path / "own.blend"))
    cases = {
        ("kt2", *own): "auto",
        ("kt2", *own, "--light", "baked"): "baked",
        ("kt2", *own, "--map-size", "64"): "baked",
    }
    cases |= {
        ("kt2",): "baked",
        ("kt2", "--scene", "office"): "baked",
        ("kt2", "--light", "auto"): "baked",
    }
    for words, light in cases.items():
        assert asked_for(tmp_path, *words).job.light == light, words
    monkeypatch.setattr(shipped, "has_light", lambda scene: False)
    assert asked_for(tmp_path, "kt2").job.light == "auto"
    assert asked_for(tmp_path, "kt2", "--light", "baked").job.light == "baked"
    baked = "if its light is baked (a first look chooses the light)"
    assert baked in estimate.local_work([asked_for(tmp_path, "kt2")]).work
    assert baked not in estimate.local_work([asked_for(tmp_path, "kt2", "--light", "path")]).work
    auto = asked_for(tmp_path, "kt2", *own, "--samples", "7").job
    assert (auto.samples, replace(auto, light="path").denoise) == (7, True)


def test_a_quality_that_would_not_be_used_is_refused(tmp_path):
    own = ("--scene", str(tmp_path / "own.blend"), "--quality", "30dB")
    assert asked_for(tmp_path, "kt2", *own).job.quality == "30dB"
    for words in (("--light", "path"), ("--light", "baked"), ("--samples", "4")):
        with pytest.raises(InputError, match="quality.* with .*light.* auto, without"):
            asked_for(tmp_path, "kt2", *own, *words)
    with pytest.raises(InputError, match="found light baked"):
        asked_for(tmp_path, "kt2", "--quality", "30dB")


def test_a_record_with_unknown_keys_or_values_that_do_not_fit_is_refused_by_name(
    tmp_path, job, capsys
):
    plan = RunPlan(job, tmp_path, (0, 1))
    plan.write_record()
    content = json.loads((tmp_path / RECORD).read_text())
    for change, words in (
        ({"warp": 9}, "warp"),
        ({"schema_version": 3}, "schema_version 2"),
        ({"farm": {"warp": 9}}, "warp"),
        ({"farm": {"workers": 0}}, "workers: expected a whole number of 1 or more"),
        ({"frames": "all"}, "0-24,30"),
        ({"frames": 7.5}, "0-24,30"),
        ({"job": "kt2"}, "a render job: "),
        ({"sequences": ["tum"]}, "a sequence: "),
    ):
        (tmp_path / RECORD).write_text(json.dumps({**content, **change}))
        with pytest.raises(InputError, match=words) as error:
            read_plan(tmp_path)
        assert str(error.value).startswith(f"{tmp_path / RECORD}: ")
    del content["job"]
    (tmp_path / RECORD).write_text(json.dumps(content))
    assert main(["resume", str(tmp_path)]) == 2
    assert "expected the key 'job'" in capsys.readouterr().err


def test_resume_of_a_folder_without_a_record_is_bad_input(tmp_path, capsys):
    assert main(["resume", str(tmp_path)]) == 2
    assert "command.json" in capsys.readouterr().err


def test_measured_figures_stand_above_defaults_and_a_first_frame_counts_as_start(job):
    assert estimate.known(job) == estimate.default(job)
    measured = estimate.measured([5.0, 1.0, 1.0, 1.0, 1.0], [3.0], 2)
    assert (measured.frame_core_s, measured.start_s) == (1.0, 5.0)
    estimate.keep(job, measured)
    assert estimate.known(job) == measured
    assert estimate.known(job.changed(samples=8)).frames == 0


def test_a_run_of_this_machine_is_resumed_by_slurm_with_other_options(
    pretended, job, tmp_path, capsys
):
    out = tmp_path / "o"
    begun(job, out, [0, 1])
    asked = asked_for(tmp_path, "kt2", *TINY, "--light", "path", "--samples", "1", command=render)
    replace(asked, raw=out).write_record()
    pretended()
    words = (
        "resume",
        str(out),
        "--engine",
        "slurm",
        "--partition",
        "night",
        "--print-only",
        "--json",
    )
    assert main(list(words)) == 2 and "light baked there, path requested" in capsys.readouterr().err
    replace(asked_for(tmp_path, "kt2", *TINY, command=render), raw=out).write_record()
    assert main(list(words)) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["estimate"]["frames"] == 8 and {
        option(s, "partition")[0] for s in said["scripts"]
    } == {"night"}


def test_status_says_why_nothing_goes_on(pretended, job, tmp_path, capsys):
    raw = tmp_path / "o/raw"
    begun(job, raw, [0])
    slurm_queue.record(
        raw,
        [slurm_queue.Submitted("11", "light"), slurm_queue.Submitted("12", "frames", ((0,), (1,)))],
    )
    (raw / ".farm/slurm/12_1_0_log.err").write_text(
        "Traceback ...\niclnuim.errors.WorkError: no space left\nsrun: error: x\n"
    )
    pretended()
    assert main(["status", str(raw), "--frames", "0:2"]) == 0
    said = capsys.readouterr().out
    assert "1 missing" in said and "in Slurm's queue: nothing" in said
    assert "the last task that failed: 12_1_0_log.err: no space left" in said


def test_pairs_in_other_formats_stand_too(job, tmp_path):
    raw = tmp_path / "o/raw"
    begun(job, raw, range(3))
    options = SequenceOptions(depth_noise="kinect2012", formats=("tum", "euroc"))
    plan = RunPlan(job, raw, (0, 1, 2), options, keep_raw=False)
    assert tasks.dataset(plan, lambda number: None) == 3
    assert plan.missing() == [] and list((raw / "exr").iterdir()) == []
    assert (raw.parent / "noisy/euroc/mav0/cam0").is_dir() and (
        raw.parent / "clean/tum/rgb.txt"
    ).is_file()
    next((raw.parent / "clean/euroc").rglob("*.png")).unlink()
    assert len(plan.missing()) == 1


@pytest.mark.parametrize("command", [make, render])
def test_quick_is_sixty_frames_in_a_row_from_the_first(tmp_path, command):
    assert asked_for(tmp_path, "office/kt1", "--quick", command=command).numbers == tuple(range(60))
    with pytest.raises(InputError, match="not both"):
        asked_for(tmp_path, "kt2", "--quick", "--frames", "::30", command=command)


def test_poses_that_are_left_out_of_a_trajectory_are_told(pretended, tmp_path, capsys):
    pretended()
    rows = [(1.0, 0.0), (1.1, 0.1), (1.1, 0.4), (1.2, 0.2)]
    (tmp_path / "twice.txt").write_text("".join(f"{t} {x} 0 0 0 0 0 1\n" for t, x in rows))
    words = (
        "--scene",
        "living_room",
        "--trajectory",
        str(tmp_path / "twice.txt"),
        "--camera",
        "16x12",
    )
    assert (
        main(["render", *words, "--engine", "slurm", "--print-only", "--out", str(tmp_path / "o")])
        == 0
    )
    said = capsys.readouterr()
    assert "twice.txt: " in said.err and "1 repeated stamp left out" in said.err
