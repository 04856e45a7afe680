"""Opens user-provided files in Blender: in a forked process, so that a crash becomes a one-line
error, and without Blender's own output.
"""

import dataclasses
import os
import pickle
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
from iclnuim import scene_wall
from iclnuim.blender.open.model_file import ClassedModel, read_classed_model
from iclnuim.blender.open.run_frames import RunFrames
from iclnuim.errors import IclnuimError, WorkError, blender_missing
from iclnuim.formats.meshes import MESH_ENDINGS
from iclnuim.geometry.scene_axes import SceneReading
from iclnuim.native_output import native_output_in


@contextmanager
def opened_scene(
    what: str,
    file: str,
    reading: SceneReading,
    reads: Iterable[Path] = (),
    writes: Iterable[Path | None] = (),
    frames: RunFrames | None = None,
) -> Iterator[list[str]]:
    """Open the scene `file` in Blender, for the frames of a run, with Blender's output suppressed;
    yields the notes about the import. Raises WorkError, which names `what`, without bpy.

    From here on this process reads and writes only what the scene may read, the temporary folder,
    and what the command reads and writes besides (put_up_wall).
    """
    put_up_wall(file, reading, reads, writes)
    with native_output_in(Path(os.devnull)):  # even the import of bpy may print
        try:
            from iclnuim.blender.open import scene
        except ImportError as error:
            raise blender_missing(what, error) from None
        yield scene.open_scene(file, reading, frames)


def put_up_wall(
    file: str, reading: SceneReading, reads: Iterable[Path], writes: Iterable[Path | None]
) -> None:
    """Put the wall of a scene around this process, unless Blender is already loaded in it."""
    if "bpy" in sys.modules:
        return
    scratch = tempfile.gettempdir()
    os.environ["BLENDER_USER_RESOURCES"] = scratch  # Blender prints if it cannot use the user's
    places = [Path(scratch)]
    places += [_existing_folder(path.resolve()) for path in writes if path is not None]
    scene_wall.around(file, reading, sys.executable, reads, places).put_up()


def _existing_folder(path: Path) -> Path:
    """The folder itself, or the one in which the file or folder will be made."""
    while not path.is_dir():
        path = path.parent
    return path


def run_isolated(work: Callable[[], int | None], file: str) -> int:
    """Run `work()` in a forked process, which shares standard output and standard error, and return
    its exit code.

    Re-raises an IclnuimError or OSError of `work`. Raises WorkError if Blender crashes on `file`.
    `work` runs in this process where the system has no fork, or where Blender is already loaded
    (its threads do not survive a fork).
    """
    if not hasattr(os, "fork") or "bpy" in sys.modules:
        return work() or 0
    with tempfile.TemporaryDirectory(prefix="iclnuim-") as scratch:
        status, pickled_error = _forked(work, scratch)
    if os.WIFSIGNALED(status):
        raise WorkError(crash_words(file, os.WTERMSIG(status)))
    if pickled_error:
        raise pickle.loads(pickled_error)
    return os.waitstatus_to_exitcode(status)


def _forked(work: Callable[[], int | None], scratch: str) -> tuple[int, bytes]:
    """Run `work` in a forked process with this folder for temporary files. Returns its wait status
    and its pickled error.
    """
    reading, writing = os.pipe()
    sys.stdout.flush()
    sys.stderr.flush()
    child = os.fork()
    if child == 0:
        os.close(reading)
        os.environ["TMPDIR"] = tempfile.tempdir = scratch
        _run(work, writing)
    os.close(writing)
    with os.fdopen(reading, "rb") as stream:
        pickled_error = stream.read()
    while True:  # Ctrl-C reaches both processes; still wait for the child
        with suppress(KeyboardInterrupt):
            return os.waitpid(child, 0)[1], pickled_error


def isolated_model(name: str, unit_m: float = 1.0) -> ClassedModel:
    """model_file.read_classed_model; a scene is opened in a forked process behind its wall."""
    if Path(name).suffix.lower() in MESH_ENDINGS:
        return read_classed_model(name, unit_m)
    with tempfile.TemporaryDirectory(prefix="iclnuim-") as folder:
        arrays = Path(folder) / "model.npz"

        def read() -> None:
            put_up_wall(name, SceneReading(), (), [arrays.parent])
            model = read_classed_model(name, unit_m)
            fields = {one.name: getattr(model, one.name) for one in dataclasses.fields(model)}
            np.savez(arrays, **fields)

        run_isolated(read, name)
        with np.load(arrays) as stored:
            return ClassedModel(**{**stored, "names": tuple(stored["names"].tolist())})


def crash_words(file: str, number: int) -> str:
    """The error message for a Blender process that a signal ended while it worked on `file`."""
    return (
        f"{file}: Blender crashed on it ({signal.Signals(number).name}): "
        "the file is damaged, or triggers a bug in this Blender; "
        "try opening and saving it in a Blender window"
    )


def _run(work: Callable[[], int | None], writing: int) -> None:
    """Run `work` in the forked process and end it with os._exit, so that the parent's clean-up does
    not run twice.
    """
    code = 3
    try:
        code = work() or 0
    except (IclnuimError, OSError) as error:
        with os.fdopen(writing, "wb") as stream:
            pickle.dump(error, stream)
    except KeyboardInterrupt:
        code = 130
    except BaseException:
        traceback.print_exc()
    with suppress(OSError):
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(code)
