"""The progress of a command: its rate and time left are those of work, not of compiling."""

import pytest
from iclnuim import console
from iclnuim.benchmark.odometry import compiling
from iclnuim.benchmark.odometry.protocol import OdometryResult
from iclnuim.benchmark.odometry.run import timed
from iclnuim.benchmark.odometry.track import Tracked
from iclnuim.geometry.se3 import SE3
from iclnuim.headless.method_options import require
from numba.core.event import end_event, start_event


@pytest.fixture
def clock(monkeypatch):
    """Seconds that the clocks give; the test sets them."""
    now = {"s": 100.0}
    monkeypatch.setattr(console.time, "monotonic", lambda: now["s"])
    monkeypatch.setattr(compiling.time, "perf_counter", lambda: now["s"])
    return now


def shown(progress, clock, steps_s, capsys):
    lines = []
    for seconds in steps_s:
        clock["s"] += seconds
        progress.advance()
        lines.append(capsys.readouterr().err.strip())
    return lines


@pytest.fixture
def compiles(clock, monkeypatch):
    """Compiles for a number of seconds, as numba reports it."""
    monkeypatch.setattr("numba.core.event.timer", lambda: clock["s"])

    def compiles(seconds):
        start_event("numba:compile")
        start_event("numba:compile")  # a function that the first one calls
        end_event("numba:compile")
        clock["s"] += seconds
        end_event("numba:compile")

    return compiles


def test_compiling_is_announced_once_and_is_no_part_of_a_rate(clock, compiles, capsys):
    quiet = console.Console()
    with quiet.at_end:
        require(quiet, "odometry", "numba")
        progress = quiet.progress(102, "icp")
        compiles(30)
        assert shown(progress, clock, [10], capsys) == [
            "compiling, once: 10 s to a minute\nicp: 1/102 frames, 0.1/s, 16:50 left"
        ]
        compiles(30)
        assert shown(progress, clock, [10], capsys) == ["icp: 2/102 frames, 0.1/s, 16:40 left"]
    compiles(30)
    assert capsys.readouterr().err == ""


def test_compiling_is_no_part_of_the_time_of_a_frame(clock, compiles, monkeypatch):
    class Slow:
        def add(self, stamp_s, frame):
            compiles(30)
            return Tracked(stamp_s, SE3.identity(), OdometryResult(SE3.identity(), seconds=32.0))

    with compiling.WorkClock() as work:
        assert timed(Slow(), 0.0, "no frame", work).result.seconds == 2.0


def test_few_steps_have_a_rate_from_the_first_one(clock, capsys):
    progress = console.Console().progress(3, "run", "runs")
    assert shown(progress, clock, [20, 20], capsys) == [
        "run: 1/3 runs, 0.05/s, 00:40 left",
        "run: 2/3 runs, 0.05/s, 00:20 left",
    ]


def test_what_was_there_before_counts_and_is_no_part_of_the_rate(clock, capsys):
    progress = console.Console().progress(882, "kt2", there=60)
    assert shown(progress, clock, [0.1], capsys) == ["kt2: 61/882 frames, 10/s, 01:22 left"]


def test_preparation_is_not_counted_and_several_steps_at_once_are(clock, capsys):
    progress = console.Console().progress(40, "kt2")
    clock["s"] += 500
    progress.begin()
    clock["s"] += 20
    progress.advance(10)
    assert capsys.readouterr().err == "kt2: 10/40 frames, 0.5/s, 01:00 left\n"
