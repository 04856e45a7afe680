"""The state machine of a child's work, without Blender: progress, cancel, crash, two at once, in words."""

import pytest
from iclnuim.errors import WorkError
from iclnuim.ui.work import GRACE_S, STOP, Work, in_panel_words

RENDER = {"frames": [0, 10, 20, 30]}


class Child:
    """Says what the test puts into it."""

    def __init__(self):
        self.said, self.sent, self.ended = [], [], False

    def send(self, command):
        self.sent.append(command)

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
    work.start("render", RENDER, child, "4 frames are there")
    return work


def say(work, child, *events, now_s=0.0):
    child.said.extend(events)
    return work.poll(now_s)


START = {"event": "start", "frames": 882, "pid": 1}
READY = ({"event": "missing", "of": "frames", "missing": 4}, {"event": "ready"})
ALL_DONE = ({"event": "chunk", "rendered": 4, "seconds": 1.0}, {"event": "done"}, {"event": "exit", "code": 0})


def frames(*numbers):
    return [{"event": "frame", "frame": n} for n in numbers]


def test_the_command_goes_to_the_child_once(work, child):
    assert child.sent == [RENDER]
    assert (work.phase, work.kind) == ("starting", "render")


def test_progress_rate_and_time_left_follow_the_frames(work, child):
    say(work, child, START, *READY, now_s=10.0)
    say(work, child, *frames(0, 30), now_s=14.0)
    assert (work.phase, work.done, work.total, work.last_frame) == ("rendering", 2, 4, 30)
    assert work.frames_per_second(14.0) == pytest.approx(0.5)
    assert work.seconds_left(14.0) == pytest.approx(4.0)


def test_there_is_no_rate_before_the_first_frame(work, child):
    say(work, child, START, *READY)
    assert work.seconds_left(100.0) is None


def test_time_spent_on_light_does_not_count_in_the_rate(work, child):
    say(work, child, START, READY[0], now_s=0.0)
    say(work, child, READY[1], now_s=600.0)
    say(work, child, *frames(0), now_s=602.0)
    assert work.frames_per_second(602.0) == pytest.approx(0.5)


def test_sequences_are_counted_as_a_stage_of_their_own(work, child):
    say(work, child, START, *READY, *frames(0, 10, 20, 30))
    say(work, child, {"event": "missing", "of": "sequences", "missing": 8}, {"event": "written", "frame": 0})
    assert (work.phase, work.done, work.total) == ("writing", 1, 8)


def test_when_all_is_done_the_child_is_sent_home_and_the_words_of_the_start_are_shown(work, child):
    say(work, child, START, *READY, *frames(0, 10, 20, 30), *ALL_DONE)
    assert child.sent == [RENDER, STOP]
    assert (work.phase, work.message, work.busy) == ("done", "4 frames are there", False)


def test_a_second_render_is_refused_in_words(work):
    with pytest.raises(WorkError, match="running here already"):
        work.start("render", RENDER, Child())


def test_cancel_asks_first_and_ends_the_child_after_the_grace(work, child):
    say(work, child, START, *READY)
    work.cancel(now_s=5.0)
    work.poll(5.0 + GRACE_S / 2)
    assert (child.sent, child.ended, work.phase) == ([RENDER, STOP], False, "stopping")
    work.poll(5.1 + GRACE_S)
    assert child.ended
    say(work, child, {"event": "exit", "code": -15})
    assert work.phase == "stopped"
    assert "Resume" in work.message


def test_frames_that_finish_during_a_cancel_are_counted_and_stay_in_its_phase(work, child):
    say(work, child, START, *READY, *frames(0))
    work.cancel()
    say(work, child, *frames(10))
    assert (work.done, work.phase) == (2, "stopping")


def test_cancel_while_light_is_baked_ends_the_child_at_once(work, child):
    say(work, child, START)
    work.cancel(now_s=5.0)
    work.poll(5.01)
    assert child.ended


def test_a_cancel_where_nothing_runs_changes_nothing():
    work = Work()
    work.cancel()
    assert work == Work()


def test_a_crash_becomes_words_with_what_to_do(work, child):
    say(work, child, START, *READY, {"event": "exit", "code": -11, "log": "Its last word: Segmentation fault"})
    assert work.phase == "failed"
    assert "Resume" in work.message and "Segmentation fault" in work.message


def test_the_words_of_an_error_outlive_the_end_of_the_child(work, child):
    say(work, child, {"event": "error", "text": "/x: no camera", "code": 2}, {"event": "exit", "code": 2})
    assert (work.phase, work.message) == ("failed", "/x: no camera")


def test_a_disk_that_is_full_in_the_middle_of_a_render_is_named_with_what_to_do(work, child):
    say(work, child, START, *READY, *frames(0), {"event": "error", "text": "/x/000010.exr: cannot write: failed"})
    assert work.phase == "failed" and "space" in work.message and "Resume" in work.message


@pytest.mark.parametrize(
    "text, field",
    [
        ("/x: 9 frames need 1 GB; try --frames or another --out", "Folder"),
        ("expected a scene whose light can be baked; try --light path", "Path traced"),
        ("the file's up axis is not known; --up and --scene-unit decide", "Up and Unit"),
        ("this Blender has no denoiser; try --no-denoise with more --samples", "Denoise"),
    ],
)
def test_options_of_the_command_line_become_fields_of_the_panel(text, field):
    assert "--" not in in_panel_words(text) and field in in_panel_words(text)


def test_notes_are_kept_and_the_last_one_is_shown(work, child):
    say(work, child, START, {"event": "note", "text": "light: charts"}, {"event": "note", "text": "light: 10 %"})
    assert work.notes == ["light: charts", "light: 10 %"] and work.message == "light: 10 %"


def test_signs_of_life_and_unknown_events_change_nothing(work, child):
    say(work, child, START)
    before = (work.phase, work.message, work.done)
    say(work, child, {"event": "alive"}, {"event": "from a later version"}, {})
    assert (work.phase, work.message, work.done) == before


def test_after_a_failure_new_work_starts_from_nothing(work, child):
    say(work, child, START, *READY, *frames(1, 2), {"event": "note", "text": "x"}, {"event": "exit", "code": 1})
    work.start("bake", {"bake": True}, Child())
    assert (work.phase, work.kind, work.done, work.last_frame, work.notes) == ("starting", "bake", 0, None, [])
