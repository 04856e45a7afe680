"""The bake of simulations is the first task of a scene that may have any. Its worker is a script."""

import json
import sys
import textwrap

import pytest
from iclnuim.console import Console
from iclnuim.errors import WorkError
from iclnuim.headless.cli import main
from iclnuim.headless.farm import estimate, rendering, run_plan, tasks
from iclnuim.headless.farm.farm_settings import limit_minutes
from iclnuim.headless.farm.run_plan import RunPlan
from iclnuim.job import shipped_job
from iclnuim.sequences.run_folder import load_trajectory, open_run

PRETENDER = textwrap.dedent("""
    import json, sys, time
    from pathlib import Path
    out = Path(sys.argv[2])
    (out / "options.json").write_text(Path(sys.argv[1]).read_text())
    def say(**event): print(json.dumps(event), flush=True)
    if not (out / "sequence.json").exists():
        say(event="baking", seconds=600)
        time.sleep(0.5)
        (out / "begun").touch()
    for line in sys.stdin:
        command = json.loads(line)
        if command.get("stop"):
            break
        for number in command["frames"]:
            say(event="frame", frame=number)
        say(event="chunk", rendered=len(command["frames"]), seconds=0)
""")


@pytest.fixture
def plan(tmp_path, monkeypatch):
    script = tmp_path / "cache/pretender.py"  # which workers may read
    script.parent.mkdir()
    script.write_text(PRETENDER)
    monkeypatch.setenv("ICLNUIM_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(rendering, "worker_command", lambda: [sys.executable, str(script)])
    monkeypatch.setattr(run_plan, "may_simulate", lambda scene: True)
    return RunPlan(shipped_job("kt2"), tmp_path / "raw", (2, 3, 4))


def bake(plan, should_stop=lambda: False, limit_s=1e9):
    task = ("simulations", plan, Console(quiet=True), lambda number: None)
    tasks.run(*task, should_stop, limit_s)


def test_a_bake_that_its_time_limit_would_end_is_refused_when_it_begins(plan):
    again = "a bake of 10 minutes in a task of 9; try: iclnuim resume .*raw --time 40"
    with pytest.raises(WorkError, match=again):
        bake(plan, limit_s=540)


def test_a_bake_that_is_stopped_says_that_it_begins_again(plan, monkeypatch, capsys):
    with pytest.raises(KeyboardInterrupt, match="begins the bake again") as stopped:
        bake(plan, (plan.raw / "begun").exists)
    assert json.loads((plan.raw / "options.json").read_text())["last"] == 4

    def interrupted(args, console):
        raise stopped.value

    monkeypatch.setattr("iclnuim.headless.commands.status.run", interrupted)
    assert main(["status", str(plan.raw)]) == 130
    words = "iclnuim status: interrupted: the same command begins the bake again\n"
    assert capsys.readouterr().err == words


def test_a_task_of_frames_needs_simulations_up_to_its_last_frame_only(plan):
    open_run(plan.raw, {"job": plan.job.to_dict()}, load_trajectory(plan.job))
    assert tasks.frames(plan, Console(quiet=True), lambda number: None).done == {2, 3, 4}
    assert json.loads((plan.raw / "options.json").read_text())["last"] == 4


def test_a_scene_without_simulations_needs_no_worker(plan, monkeypatch):
    monkeypatch.setattr(run_plan, "may_simulate", lambda scene: False)
    bake(plan)
    assert not plan.raw.exists()


@pytest.mark.parametrize(("last", "limit"), [(9, 30), (881, 119)])
def test_the_time_limit_grows_with_the_frames(plan, last, limit):
    """Cloth of 30,000 points takes 2 s a frame; the limit is four times that, and the start."""
    whole = RunPlan(plan.job, plan.raw, (last,))
    expected = estimate.estimate(whole, [1], estimate.default(plan.job))
    assert limit_minutes(expected.simulations_minutes) == limit
