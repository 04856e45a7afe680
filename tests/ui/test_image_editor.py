"""The last frame of a render: shown at most once a pause, and again when the work is over."""

from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")

from iclnuim.geometry.camera import PinholeCamera  # noqa: E402
from iclnuim.ui import image_editor  # noqa: E402
from iclnuim.ui.work import Work  # noqa: E402


def test_a_frame_is_shown_once_a_pause_and_the_last_one_at_the_end(monkeypatch, tmp_path: Path):
    shown = []
    now = [100.0]
    black = np.zeros((4, 6, 3), np.float32), np.ones((4, 6), np.float32)

    def read(file: Path, camera: PinholeCamera) -> tuple[np.ndarray, np.ndarray]:
        shown.append(file.stem)
        return black

    monkeypatch.setattr(image_editor, "read_frame", read)
    monkeypatch.setattr(image_editor, "show", lambda *_: None)
    monkeypatch.setattr(image_editor.state, "areas", lambda kind: [kind])
    monkeypatch.setattr(image_editor.time, "monotonic", lambda: now[0])
    last = image_editor.LastFrame(tmp_path, PinholeCamera.parse("6x4"))
    work = Work(phase="rendering")
    last.look(work)
    assert shown == []
    for number, seconds in enumerate((100.0, 100.5, 101.1, 101.2)):
        work.last_frame = number
        now[0] = seconds
        last.look(work)
    assert shown == ["000000", "000002"]
    work.phase = "done"
    last.look(work)
    assert shown[-1] == "000003"
