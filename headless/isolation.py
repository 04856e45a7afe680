"""User-provided files in Blender: opened in a forked process, whose end by a signal becomes one line, and without Blender's own output."""

import os
import pickle
import signal
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from iclnuim.blender.output import blender_output_in
from iclnuim.errors import IclnuimError, WorkError, blender_missing
from iclnuim.geometry.scene_axes import SceneReading


@contextmanager
def opened_scene(what: str, file: str, reading: SceneReading) -> Iterator[list[str]]:
    """Blender with the scene `file` open and its own output dropped; yields the notes of opening. Raises WorkError, naming `what`, without bpy."""
    with blender_output_in(Path(os.devnull)):  # the very import of bpy may print
        try:
            from iclnuim.blender import scene
        except ImportError as error:
            raise blender_missing(what, error) from None
        yield scene.open_scene(file, reading)


def survived(work: Callable[[], int | None], file: str) -> int:
    """Exit code of `work()`, done in a process of its own; its output goes where ours goes.

    Raises what IclnuimError or OSError it raises, and WorkError where Blender crashes on `file`. Where there is no fork, or Blender is loaded already
    (its threads would not survive one), the work is done here.
    """
    if not hasattr(os, "fork") or "bpy" in sys.modules:
        return work() or 0
    reading, writing = os.pipe()
    sys.stdout.flush()
    sys.stderr.flush()
    child = os.fork()
    if child == 0:
        os.close(reading)
        _run(work, writing)
    os.close(writing)
    with os.fdopen(reading, "rb") as stream:
        told = stream.read()
    while True:  # Ctrl-C reaches both, and the child's end is waited for all the same
        with suppress(KeyboardInterrupt):
            status = os.waitpid(child, 0)[1]
            break
    if os.WIFSIGNALED(status):
        raise WorkError(crash_words(file, os.WTERMSIG(status)))
    if told:
        raise pickle.loads(told)
    return os.waitstatus_to_exitcode(status)


def crash_words(file: str, number: int) -> str:
    """What the end of Blender by a signal means for the file it was at."""
    return (
        f"{file}: Blender crashed on it ({signal.Signals(number).name}): the file is damaged, or meets a bug of this Blender; "
        "try opening and saving it in a Blender window"
    )


def _run(work: Callable[[], int | None], writing: int) -> None:
    """In the forked process, which ends here: no clean-up of the parent's runs twice."""
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
