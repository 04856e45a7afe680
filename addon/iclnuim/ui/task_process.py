"""The script that the child Blender runs: one JSON task in, one JSON event a line out; a line `stop` or a closed input ends it.

{"task": "render", "job": {...}, "out": RAW, "frames": [...], "sequences": {"dialects": [...], "variants": {FOLDER: {...}}}}
{"task": "bake", "job": {...}}

The events are those of blender/worker.py, and {"event": "stage", "phase", "missing", "text"}, {"event": "error", "text"},
{"event": "result", "text"}. Exit codes: 0 done, 2 and 3 as the command line has them, 130 stopped.
"""

from __future__ import annotations

import importlib.util
import json
import os
import sys
import threading
import traceback
from collections.abc import Callable
from pathlib import Path

Emit = Callable[[dict], None]


def main() -> int:
    """Serve the one task."""
    emit = _event_stream()
    if hasattr(os, "nice"):
        os.nice(10)
    _load_package()
    from iclnuim.errors import IclnuimError

    stopped = threading.Event()
    task = json.loads(sys.stdin.readline() or "{}")
    threading.Thread(target=_watch_input, args=(stopped,), daemon=True).start()
    try:
        run = {"render": _render, "bake": _bake}[task["task"]]
        return 0 if run(task, emit, stopped.is_set) else 130
    except IclnuimError as error:
        emit({"event": "error", "text": str(error)})
        return error.exit_code
    except Exception as error:
        traceback.print_exc()
        emit({"event": "error", "text": f"{type(error).__name__}: {error}; this should not happen, please report it"})
        return 3


def _render(task: dict, emit: Emit, should_stop: Callable[[], bool]) -> bool:
    """Frames, then the sequences made of them."""
    from iclnuim.blender import compat, worker
    from iclnuim.job import RenderJob

    job, out = RenderJob.from_dict(task["job"]), Path(task["out"])
    if job.denoise and not compat.has_denoiser():
        emit({"event": "note", "text": "this Blender has no OpenImageDenoise: rendering without"})
        job = job.changed(denoise=False)
    if not worker.render_run(job, out, task["frames"], emit, should_stop):
        return False
    text = f"{len(task['frames'])} frames are in {out}"
    if task.get("sequences"):
        if not _sequences(out, task["frames"], task["sequences"], emit, should_stop):
            return False
        text += "; sequences: " + ", ".join(Path(name).name for name in task["sequences"]["variants"])
    emit({"event": "result", "text": text})
    return True


def _sequences(raw: Path, numbers: list[int], wanted: dict, emit: Emit, should_stop: Callable[[], bool]) -> bool:
    """Every variant of the frames in `raw`; False when stopped in between."""
    from iclnuim.dataset.frames import frames_of_run
    from iclnuim.dataset.run_folder import read_run
    from iclnuim.dataset.sequence import SequenceSettings, SequenceWriter
    from iclnuim.formats.trajectories import read_trajectory
    from iclnuim.sensor.models import depth_model, rgb_model

    variants = {
        Path(folder): SequenceSettings(depth_model(v["depth"]), rgb_model(v["rgb"]), v["seed"])
        for folder, v in wanted["variants"].items()
    }
    truth = read_trajectory(raw / "groundtruth.txt", "tum").trajectory
    writer = SequenceWriter(frames_of_run(read_run(raw), truth, numbers), variants, wanted["dialects"])
    emit({"event": "stage", "phase": "writing", "missing": len(writer.missing), "text": "sequences are written"})

    def written(number: int) -> None:
        emit({"event": "frame", "frame": number})
        if should_stop():
            raise _StoppedError

    try:
        writer.write(on_frame=written)
    except _StoppedError:
        return False
    return True


def _bake(task: dict, emit: Emit, should_stop: Callable[[], bool]) -> bool:
    from iclnuim.blender import worker
    from iclnuim.job import RenderJob

    folder = worker.bake_light(RenderJob.from_dict(task["job"]), emit)
    emit({"event": "result", "text": "the light is baked and lies in the cache", "folder": str(folder)})
    return True


class _StoppedError(Exception):
    """Ends the writing of sequences between two frames."""


def _event_stream() -> Emit:
    """Events on what was standard output; all else that is printed goes to standard error."""
    stream = os.fdopen(os.dup(1), "w", encoding="utf-8", buffering=1)
    os.dup2(2, 1)
    lock = threading.Lock()

    def emit(event: dict) -> None:
        with lock:
            try:
                stream.write(json.dumps(event) + "\n")
            except OSError:
                os._exit(130)  # the window is gone

    return emit


def _watch_input(stopped: threading.Event) -> None:
    """Until the first further line, or the end of input when the window goes."""
    sys.stdin.readline()
    stopped.set()


def _load_package() -> None:
    """This package as `iclnuim`, wherever it is installed and however its folder is called."""
    if "iclnuim" in sys.modules:
        return
    package = Path(__file__).resolve().parents[1]
    spec = importlib.util.spec_from_file_location(
        "iclnuim", package / "__init__.py", submodule_search_locations=[str(package)]
    )
    if spec is None or spec.loader is None:
        raise ImportError(f"{package} is no package")
    sys.modules["iclnuim"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(sys.modules["iclnuim"])


if __name__ == "__main__":
    try:
        code = main()
    except BaseException:
        traceback.print_exc()
        code = 3
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)
