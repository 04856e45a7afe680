"""The progress of a command: its rate and time left are those of work, not of compiling."""

import pytest
from iclnuim import console


@pytest.fixture
def clock(monkeypatch):
    """Seconds that time.monotonic() gives; the test sets them."""
    now = {"s": 100.0}
    monkeypatch.setattr(console.time, "monotonic", lambda: now["s"])
    return now


def shown(progress, clock, steps_s, capsys):
    lines = []
    for seconds in steps_s:
        clock["s"] += seconds
        progress.advance()
        lines.append(capsys.readouterr().err.strip())
    return lines


def test_the_steps_that_compile_are_no_part_of_the_rate(clock, capsys):
    progress = console.Console().progress(102, "icp")
    lines = shown(progress, clock, [30, 30, 11, 11, 11], capsys)
    assert lines[:2] == ["icp: 1/102 frames", "icp: 2/102 frames"]
    assert lines[-1] == "icp: 5/102 frames, 0.0909/s, 17:47 left"


def test_few_steps_have_a_rate_from_the_first_one(clock, capsys):
    progress = console.Console().progress(3, "run", "runs")
    assert shown(progress, clock, [20, 20], capsys) == [
        "run: 1/3 runs, 0.05/s, 00:40 left",
        "run: 2/3 runs, 0.05/s, 00:20 left",
    ]


@pytest.mark.parametrize(("total", "rate"), [(19, True), (20, False)])
def test_work_of_twenty_steps_is_long(total, rate, clock, capsys):
    (line,) = shown(console.Console().progress(total, "icp"), clock, [20], capsys)
    assert ("/s" in line) == rate


def test_preparation_is_not_counted_and_several_steps_at_once_are(clock, capsys):
    progress = console.Console().progress(40, "kt2")
    clock["s"] += 500
    progress.begin()
    clock["s"] += 20
    progress.advance(10)
    assert capsys.readouterr().err == "kt2: 10/40 frames, 0.5/s, 01:00 left\n"
