"""Events of the worker process: the JSON on the wire, and back."""

import json

import pytest
from iclnuim import worker_events as events
from iclnuim.errors import InputError

WIRE = [
    (events.Note("text"), '{"event": "note", "text": "text"}'),
    (events.Started(frames=882, pid=7), '{"event": "start", "frames": 882, "pid": 7}'),
    (events.Ready(), '{"event": "ready"}'),
    (events.Missing("frames", 4), '{"event": "missing", "of": "frames", "missing": 4}'),
    (
        events.FrameDone(0, 0.5, 0.0, True),
        '{"event": "frame", "frame": 0, "cycles": 0.5, "close": 0.0, "found": true}',
    ),
    (events.FrameDone(2, black="why"), '{"event": "frame", "frame": 2, "black": "why"}'),
    (
        events.FrameDone(1, 0.5, 0.25),
        '{"event": "frame", "frame": 1, "cycles": 0.5, "close": 0.25}',
    ),
    (events.Written(2), '{"event": "written", "frame": 2}'),
    (events.Baking(2.5), '{"event": "baking", "seconds": 2.5}'),
    (events.Baked("/x"), '{"event": "baked", "folder": "/x"}'),
    (
        events.ChunkDone(0, 1.5, 0.0),
        '{"event": "chunk", "rendered": 0, "seconds": 1.5, "rss_mb": 0.0}',
    ),
    (events.Stopped(2, 1.5), '{"event": "stopped", "rendered": 2, "seconds": 1.5}'),
    (events.Alive(), '{"event": "alive"}'),
    (events.Failed("bad", 2), '{"event": "error", "text": "bad", "code": 2}'),
    (
        events.Failed("bad", 2, "bad {light}"),
        '{"event": "error", "text": "bad", "code": 2, "template": "bad {light}"}',
    ),
    (
        events.Failed("bad", 3, bug=True),
        '{"event": "error", "text": "bad", "code": 3, "bug": true}',
    ),
    (events.Done(), '{"event": "done"}'),
    (events.Exited(-9), '{"event": "exit", "code": -9}'),
]


@pytest.mark.parametrize("event, line", WIRE)
def test_events_keep_their_lines(event, line):
    assert json.dumps(event.to_dict()) == line
    assert events.from_dict(json.loads(line)) == event


def test_events_and_keys_of_a_later_version_are_left_out():
    assert events.from_dict({"event": "from a later version"}) is None
    assert events.from_dict({}) is None
    assert events.from_dict({"event": "note", "text": "a", "colour": "red"}) == events.Note("a")


def test_an_event_without_a_field_is_refused():
    with pytest.raises(InputError, match="'frame' with frame"):
        events.from_dict({"event": "frame"})
