"""`iclnuim make all`: every sequence in its turn, one progress, resumable, and what fails does not
stop the others.
"""

import argparse

import pytest
from iclnuim.console import Console
from iclnuim.errors import InputError, WorkError
from iclnuim.headless.cli import main
from iclnuim.headless.commands import make
from iclnuim.headless.commands.run_options import RunOptions
from iclnuim.headless.farm.all_sequences import make_all
from iclnuim.sequences.journal import JournalEntry
from iclnuim.shipped import paper_sequences


def plans(*words):
    parser = argparse.ArgumentParser()
    make.configure(parser)
    return RunOptions.of(parser.parse_args(["all", *words])).every_plan()


def test_all_are_both_rooms_clean_and_noisy_in_folders_of_their_own(tmp_path):
    every = plans("--out", str(tmp_path), "--quick", "--seed", "3")
    assert [plan.job.sequence for plan in every] == paper_sequences() and len(every) == 8
    folders = [
        folder.relative_to(tmp_path).as_posix() for plan in every for folder in plan.variants()
    ]
    assert folders == [
        f"{name}/{kind}" for name in paper_sequences() for kind in ("clean", "noisy")
    ]
    assert all(plan.numbers == tuple(range(60)) and plan.job.seed == 3 for plan in every)
    assert sum(len(plan.numbers) for plan in plans()) == 9202
    with pytest.raises(InputError, match="all without"):
        plans("--scene", "office")


def test_progress_counts_what_is_left_of_all(tmp_path, capsys):
    every = plans("--out", str(tmp_path), "--frames", ":3")
    for folder in every[
        0
    ].variants():  # of the first, one frame is made, and one journal ends in half a line
        folder.mkdir(parents=True)
        (folder / "frames.jsonl").write_text(JournalEntry(1).to_line() + '{"fra')

    def execute(plan, console):
        progress = console.progress(2 if plan is every[0] else 3, plan.job.sequence)
        totals.append((progress.done, progress.total))
        progress.advance(2 if plan is every[0] else 3)
        return 0

    totals = []
    assert make_all(every, execute, Console()) == 0
    assert totals == [(0, 23), *((2 + 3 * k, 23) for k in range(7))]
    assert "office/kt3: 23/23 frames" in capsys.readouterr().err


def test_what_fails_leaves_the_others_their_turn_and_a_stop_ends_all(tmp_path, capsys):
    every, begun = plans("--out", str(tmp_path)), []

    def execute(plan, console, code=0):
        begun.append(plan.job.sequence)
        if plan is every[1]:
            raise InputError("another folder", hint="another {out}")
        return code if plan is every[3] else 0

    with pytest.raises(
        WorkError, match="^living_room/kt1 failed, for the reasons above; 7 of 8 are done$"
    ):
        make_all(every, execute, Console())
    assert begun == paper_sequences()
    assert "living_room/kt1: expected another folder; try another --out" in capsys.readouterr().err
    begun.clear()
    assert make_all(every, lambda plan, console: execute(plan, console, 130), Console()) == 130
    assert begun == paper_sequences()[:4]


def test_job_scripts_of_a_run_without_a_cluster_are_refused_once_for_all(tmp_path, capsys):
    assert main(["make", "all", "--print-only", "-o", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error == "iclnuim make: expected --print-only with --engine slurm, found local\n"
    assert not (tmp_path / "out").exists()
