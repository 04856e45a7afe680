"""The store of cells: what is measured is kept, what belongs to something else is refused in a line,
and nothing is half written.
"""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass

import pytest
from iclnuim.benchmark.experiments.cell import Cell
from iclnuim.benchmark.experiments.pool import Job, run_jobs
from iclnuim.benchmark.experiments.store import Store
from iclnuim.errors import InputError, WorkError


@dataclass(frozen=True)
class Key:
    name: str

    @property
    def place(self):
        return f"some/{self.name}"


CELL = Cell(Key("a"), {"input": "1", "levels": (1, 2)})


def test_a_cell_is_kept_until_something_that_decided_it_changes(tmp_path):
    store = Store(tmp_path, "stress")
    store.open({})
    assert store.missing([CELL]) == [CELL] and store.read([CELL]) == []
    store.write(CELL, {"ate_m": 0.5})
    assert store.missing([CELL]) == []
    (found,) = store.read([CELL])
    assert found.key == CELL.key and found.figures == {"ate_m": 0.5}
    assert store.has(Cell(CELL.key, {"input": "1"}))  # asks for less
    assert not store.has(Cell(CELL.key, {"input": "2"}))
    assert not store.has(Cell(CELL.key, {"input": "1", "code": "x"}))
    assert [one.key for one in store.read_all(Key)] == [Key("a")]


def test_a_store_that_keeps_its_cells_refuses_others(tmp_path):
    store = Store(tmp_path, "systems", keeps=True)
    store.write(CELL, {})
    with pytest.raises(InputError, match="input 1 there, 2 requested; try another") as caught:
        store.missing([Cell(CELL.key, {"input": "2"})])
    assert "\n" not in str(caught.value)


def test_a_folder_of_another_experiment_setting_or_format_is_refused(tmp_path):
    store = Store(tmp_path, "benchmark")
    store.open({"first": 60})
    store.open({"first": 60})
    with pytest.raises(InputError, match="first 60 there, 50 requested"):
        store.open({"first": 50})
    for open_again in (lambda s: s.open({}), lambda s: s.read_all(Key)):
        with pytest.raises(InputError, match="kind benchmark there, stress requested"):
            open_again(Store(tmp_path, "stress"))
    (tmp_path / "recipe.json").write_text(json.dumps({"schema_version": 1, "kind": "benchmark"}))
    for read in (lambda: store.open({}), lambda: store.read_all(Key)):
        with pytest.raises(InputError, match="found older ones; try .*run it again"):
            read()


def test_further_files_are_replaced_together_with_the_cell(tmp_path):
    store = Store(tmp_path, "benchmark")
    with store.files(CELL) as folder:
        (folder / "old.txt").write_text("1")
    store.write(CELL, {})
    with pytest.raises(WorkError), store.files(CELL) as folder:
        (folder / "new.txt").write_text("2")
        raise WorkError("disk full")
    assert not store.has(CELL)
    with store.files(CELL) as folder:
        (folder / "new.txt").write_text("2")
    assert [path.name for path in store.folder(CELL.key).iterdir()] == ["new.txt"]


def failing(advance):
    advance(1)
    raise WorkError("no model")


@pytest.mark.parametrize("workers", [1, 2])
def test_a_job_that_fails_is_named_and_the_others_go_on(tmp_path, workers):
    def write(name):
        return lambda advance: advance(2) or (tmp_path / name).write_text("done")

    steps, problems = [], []
    jobs = [Job("b", failing, 3), Job("a", write("a"), 2), Job("c", write("c"), 5)]
    run_jobs(jobs, workers, steps.append, problems.append)
    assert problems == ["b failed: no model"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "c"]
    assert sum(steps) == 10  # a job's steps are complete when it ends
    with pytest.raises(WorkError, match="no model"):
        run_jobs(jobs, workers, steps.append)


def test_ctrl_c_ends_jobs_of_many_minutes_at_once(tmp_path):
    program = f"""
import time
from iclnuim.benchmark.experiments.pool import Job, run_jobs
def wait(advance):
    open({str(tmp_path / "begun")!r}, "a").write("x")
    time.sleep(600)
run_jobs([Job("a", wait, 1), Job("b", wait, 1)], 2, print)
"""
    with subprocess.Popen([sys.executable, "-c", program], stderr=subprocess.DEVNULL) as process:
        deadline = time.monotonic() + 60
        begun = tmp_path / "begun"
        while time.monotonic() < deadline and not (begun.exists() and begun.stat().st_size == 2):
            time.sleep(0.05)
        os.kill(process.pid, signal.SIGINT)
        assert process.wait(20) != 0
    left = subprocess.run(["ps", "-eo", "args"], capture_output=True, text=True).stdout
    assert str(tmp_path) not in left
