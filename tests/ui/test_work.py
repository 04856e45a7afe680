"""The state machine of work in a worker process, without Blender: progress, cancel, crash, two at
once, and what is reported.
"""

import pytest
from iclnuim import worker_events
from iclnuim.errors import InputError, WorkError
from iclnuim.ui.work import GRACE_S, Work

RENDER, STOP = {"frames": [0, 10, 20, 30]}, "stop"


class FakeWorker:
    """Returns the events that the test puts into it."""

    def __init__(self):
        self.queued, self.sent, self.ended = [], [], False

    def send(self, command):
        self.sent.append(command)

    def stop(self):
        self.sent.append(STOP)

    def terminate(self):
        self.ended = True

    def events(self):
        queued, self.queued = self.queued, []
        return queued


@pytest.fixture
def worker():
    return FakeWorker()


@pytest.fixture
def work(worker):
    work = Work()
    work.start("render", RENDER, worker, "4 frames are there")
    return work


def report(work, worker, *events, now_s=0.0):
    """Events as they come over the pipe; those of a later version are dropped there."""
    worker.queued.extend(filter(None, map(worker_events.from_dict, events)))
    return work.poll(now_s)


START = {"event": "start", "frames": 882, "pid": 1}
READY = ({"event": "missing", "of": "frames", "missing": 4}, {"event": "ready"})
ALL_DONE = (
    {"event": "chunk", "rendered": 4, "seconds": 1.0},
    {"event": "done"},
    {"event": "exit", "code": 0},
)


def frames(*numbers):
    return [{"event": "frame", "frame": n} for n in numbers]


def test_the_command_goes_to_the_worker_once(work, worker):
    assert worker.sent == [RENDER]
    assert (work.phase, work.kind) == ("starting", "render")


def test_progress_rate_and_time_left_follow_the_frames(work, worker):
    report(work, worker, START, *READY, now_s=10.0)
    report(work, worker, *frames(0, 30), now_s=14.0)
    assert (work.phase, work.done, work.total, work.last_frame) == ("rendering", 2, 4, 30)
    assert work.frames_per_second(14.0) == pytest.approx(0.5)
    assert work.seconds_left(14.0) == pytest.approx(4.0)


def test_there_is_no_rate_before_the_first_frame(work, worker):
    report(work, worker, START, *READY)
    assert work.seconds_left(100.0) is None


def test_time_spent_on_light_does_not_count_in_the_rate(work, worker):
    report(work, worker, START, READY[0], now_s=0.0)
    report(work, worker, READY[1], now_s=600.0)
    report(work, worker, *frames(0), now_s=602.0)
    assert work.frames_per_second(602.0) == pytest.approx(0.5)


def test_sequences_are_counted_as_a_stage_of_their_own(work, worker):
    report(work, worker, START, *READY, *frames(0, 10, 20, 30))
    report(
        work,
        worker,
        {"event": "missing", "of": "sequences", "missing": 4},
        {"event": "written", "frame": 0},
    )
    assert (work.phase, work.done, work.total) == ("writing", 1, 4)


def test_progress_counts_the_finished_frames_of_an_earlier_run_and_the_rate_does_not(work, worker):
    report(work, worker, START, {**READY[0], "missing": 1}, READY[1], now_s=10.0)
    assert (work.done, work.total, work.seconds_left(12.0)) == (3, 4, None)
    report(work, worker, *frames(30), now_s=12.0)
    assert (work.done, work.frames_per_second(12.0)) == (4, 0.5)


def test_when_all_is_done_the_worker_is_stopped_and_the_message_given_at_the_start_is_shown(
    work, worker
):
    report(work, worker, START, *READY, *frames(0, 10, 20, 30), *ALL_DONE)
    assert worker.sent == [RENDER, STOP]
    assert (work.phase, work.message, work.busy) == ("done", "4 frames are there", False)


def test_a_second_render_is_refused(work):
    with pytest.raises(WorkError, match="already running"):
        work.start("render", RENDER, FakeWorker())


def test_cancel_asks_first_and_ends_the_worker_after_the_grace(work, worker):
    report(work, worker, START, *READY)
    work.cancel(now_s=5.0)
    work.poll(5.0 + GRACE_S / 2)
    assert (worker.sent, worker.ended, work.phase) == ([RENDER, STOP], False, "stopping")
    work.poll(5.1 + GRACE_S)
    assert worker.ended
    report(work, worker, {"event": "exit", "code": -15})
    assert work.phase == "stopped"
    assert "Resume" in work.message


def test_only_a_render_can_be_resumed(worker):
    work = Work()
    work.start("preview", {"frames": [0]}, worker)
    work.cancel()
    assert work.message == "stopping"
    report(work, worker, {"event": "exit", "code": 130})
    assert work.message == "stopped"


def test_frames_that_finish_during_a_cancel_are_counted_and_stay_in_its_phase(work, worker):
    report(work, worker, START, *READY, *frames(0))
    work.cancel()
    report(work, worker, *frames(10))
    assert (work.done, work.phase) == (2, "stopping")


def test_cancel_while_light_is_baked_ends_the_worker_at_once(work, worker):
    report(work, worker, START)
    work.cancel(now_s=5.0)
    work.poll(5.01)
    assert worker.ended


def test_a_cancel_where_nothing_runs_changes_nothing():
    work = Work()
    work.cancel()
    assert work == Work()


def test_a_crash_is_reported_with_what_to_do(work, worker):
    report(work, worker, START, *READY, {"event": "exit", "code": -11, "log": "Segmentation fault"})
    assert work.phase == "failed"
    assert "Resume" in work.message and "Segmentation fault" in work.message


def test_the_message_of_an_error_outlives_the_end_of_the_worker(work, worker):
    report(
        work,
        worker,
        {"event": "error", "text": "/x: no camera", "code": 2},
        {"event": "exit", "code": 2},
    )
    assert (work.phase, work.message) == ("failed", "/x: no camera")


def test_a_disk_that_is_full_in_the_middle_of_a_render_is_named_with_what_to_do(work, worker):
    report(
        work,
        worker,
        START,
        *READY,
        *frames(0),
        {"event": "error", "text": "/x/000010.exr: cannot write: no space"},
    )
    assert work.phase == "failed" and "space" in work.message and "Resume" in work.message


def test_an_error_of_the_worker_names_what_the_panel_calls_the_setting(worker):
    work = Work(lambda setting: {"out": "Output folder", "samples": "Samples"}[setting])
    for error, message in (
        (
            WorkError("/x: no space", hint="another {out}"),
            "/x: no space; try another Output folder",
        ),
        (
            InputError("1 or more", setting="samples", found=0),
            "Samples: expected 1 or more, found 0",
        ),
    ):
        work.start("render", RENDER, worker)
        event = {
            "event": "error",
            "text": str(error),
            "template": error.template,
            "code": error.exit_code,
        }
        report(work, worker, event, {"event": "exit", "code": error.exit_code})
        assert (work.phase, work.message) == ("failed", message)


def test_notes_are_kept_and_the_last_one_is_shown(work, worker):
    report(
        work,
        worker,
        START,
        {"event": "note", "text": "light: charts"},
        {"event": "note", "text": "light: 10 %"},
    )
    assert work.notes == ["light: charts", "light: 10 %"] and work.message == "light: 10 %"


def test_alive_and_unknown_events_change_nothing(work, worker):
    report(work, worker, START)
    before = (work.phase, work.message, work.done)
    report(work, worker, {"event": "alive"}, {"event": "from a later version"}, {})
    assert (work.phase, work.message, work.done) == before


def test_after_a_failure_new_work_starts_from_nothing(work, worker):
    report(
        work,
        worker,
        START,
        *READY,
        *frames(1, 2),
        {"event": "note", "text": "x"},
        {"event": "exit", "code": 1},
    )
    work.start("bake", {"bake": True}, FakeWorker())
    assert (work.phase, work.kind, work.done, work.last_frame, work.notes) == (
        "starting",
        "bake",
        0,
        None,
        [],
    )
