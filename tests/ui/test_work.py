"""The state machine of a child's work, without Blender: progress, cancel, crash, two at once, in words."""

import pytest
from iclnuim.errors import WorkError
from iclnuim.ui.work import GRACE_S, Work


class Child:
    """Says what the test puts into it."""

    def __init__(self):
        self.said, self.sent, self.stops, self.ended = [], [], 0, False

    def send(self, task):
        self.sent.append(task)

    def ask_to_stop(self):
        self.stops += 1

    def end(self):
        self.ended = True

    def events(self):
        said, self.said = self.said, []
        return said


@pytest.fixture
def child():
    return Child()


@pytest.fixture
def work(child):
    work = Work()
    work.start({"task": "render"}, child)
    return work


def say(work, child, *events, now_s=0.0):
    child.said.extend(events)
    return work.poll(now_s)


START = {"event": "start", "frames": 4, "missing": 4}


def frames(*numbers):
    return [{"event": "frame", "frame": n} for n in numbers]


def test_progress_rate_and_time_left_follow_the_frames(work, child):
    say(work, child, START, {"event": "ready"}, now_s=10.0)
    say(work, child, *frames(0, 30), now_s=14.0)
    assert (work.phase, work.done, work.total, work.last_frame) == ("rendering", 2, 4, 30)
    assert work.frames_per_second(14.0) == pytest.approx(0.5)
    assert work.seconds_left(14.0) == pytest.approx(4.0)


def test_there_is_no_rate_before_the_first_frame(work, child):
    say(work, child, START, {"event": "ready"})
    assert work.seconds_left(100.0) is None


def test_the_end_of_the_child_with_code_0_is_done(work, child):
    say(work, child, {"event": "result", "text": "4 frames"}, {"event": "exit", "code": 0})
    assert (work.phase, work.message, work.busy) == ("done", "4 frames", False)


def test_a_second_render_is_refused_in_words(work):
    with pytest.raises(WorkError, match="running here already"):
        work.start({"task": "render"}, Child())


def test_cancel_asks_first_and_ends_the_child_after_the_grace(work, child):
    say(work, child, START, {"event": "ready"})
    work.cancel(now_s=5.0)
    work.poll(5.0 + GRACE_S / 2)
    assert (child.stops, child.ended, work.phase) == (1, False, "stopping")
    work.poll(5.1 + GRACE_S)
    assert child.ended
    say(work, child, {"event": "exit", "code": -15})
    assert work.phase == "stopped"
    assert "Resume" in work.message


def test_cancel_while_light_is_baked_ends_the_child_at_once(work, child):
    say(work, child, START)
    work.cancel(now_s=5.0)
    work.poll(5.01)
    assert child.ended


def test_a_crash_becomes_words_with_what_to_do(work, child):
    say(
        work,
        child,
        START,
        {"event": "ready"},
        {"event": "exit", "code": -11, "log": "Its last word: Segmentation fault"},
    )
    assert work.phase == "failed"
    assert "Resume" in work.message and "Segmentation fault" in work.message


def test_an_error_of_the_library_keeps_its_words_and_names_fields_instead_of_options(work, child):
    say(
        work,
        child,
        {"event": "error", "text": "/x: 9 frames need 1 GB; try --frames or another --out"},
        {"event": "exit", "code": 3},
    )
    assert work.phase == "failed"
    assert "--" not in work.message and "Folder" in work.message


def test_after_a_failure_new_work_starts_from_nothing(work, child):
    say(work, child, START, *frames(1, 2), {"event": "exit", "code": 1})
    work.start({"task": "bake"}, Child())
    assert (work.phase, work.kind, work.done, work.last_frame, work.notes) == ("starting", "bake", 0, None, [])
