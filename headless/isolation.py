"""A crash of Blender reported: what opens a user-provided file runs in a forked process, whose end by a signal becomes one line."""

import os
import pickle
import signal
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress

from iclnuim.errors import IclnuimError, WorkError


def survived(work: Callable[[], int], file: str) -> int:
    """Exit code of `work()`, done in a process of its own; its output goes where ours goes.

    Raises what IclnuimError it raises, and WorkError where Blender crashes on `file`. Where there is no fork, or Blender is loaded already
    (its threads would not survive one), the work is done here.
    """
    if not hasattr(os, "fork") or "bpy" in sys.modules:
        return work()
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
    status = _wait(child)
    if os.WIFSIGNALED(status):
        raise WorkError(crash_words(file, os.WTERMSIG(status)))
    if told:
        text, code = pickle.loads(told)
        error = IclnuimError(text)
        error.exit_code = code
        raise error
    return os.waitstatus_to_exitcode(status)


def crash_words(file: str, number: int) -> str:
    """What the end of Blender by a signal means for the file it was at."""
    return (
        f"{file}: Blender crashed on it ({signal.Signals(number).name}): the file is damaged, or meets a bug of this Blender; "
        "try opening and saving it in a Blender window"
    )


def _run(work: Callable[[], int], writing: int) -> None:
    """In the forked process, which ends here: no clean-up of the parent's runs twice."""
    code = 3
    try:
        code = work()
    except IclnuimError as error:
        with os.fdopen(writing, "wb") as stream:
            pickle.dump((str(error), error.exit_code), stream)
        code = error.exit_code
    except KeyboardInterrupt:
        code = 130
    except BaseException:
        traceback.print_exc()
    with suppress(OSError):
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(code)


def _wait(child: int) -> int:
    """Its status; Ctrl-C reaches both, and the child's end is waited for all the same."""
    while True:
        with suppress(KeyboardInterrupt):
            return os.waitpid(child, 0)[1]
