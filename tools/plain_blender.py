"""Applies the same kills to plain Blender, which renders an animation with overwrite off and
placeholders on, and counts broken and lost frames.

python -m iclnuim.tools.plain_blender SCENE.blend OUT FIRST LAST      the process that is killed, as
a user would run Blender
"""

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from iclnuim.errors import InputError, WorkError
from iclnuim.formats.exr import read_exr

from .farm_chaos import FRAMES_BETWEEN, Damage


def render_animation(blend: Path, out: Path, first: int, last: int) -> None:
    """Do `blender -b FILE -o OUT -s FIRST -e LAST -a` with overwrite off and placeholders on, in
    the bpy package.
    """
    import bpy

    bpy.ops.wm.open_mainfile(filepath=str(blend))
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = first, last
    render = scene.render
    render.use_overwrite = False
    render.use_placeholder = True
    render.use_file_extension = True
    render.filepath = str(out / "######")
    bpy.ops.render.render(animation=True)


class PlainBlender:
    """Renders frames `first` to `last` of a .blend into `out`, killed at random moments drawn from
    `rng`.
    """

    def __init__(
        self, blend: Path, out: Path, first: int, last: int, rng: np.random.Generator
    ) -> None:
        self._arguments = [str(blend), str(out), str(first), str(last)]
        self.out = out
        self._files = [out / f"{n:06}.exr" for n in range(first, last + 1)]
        self._rng = rng

    def run(self, kills: int, note: Callable[[str], None]) -> Damage:
        """Kill the process `kills` times, each after at least three more frames, and start it
        again; at last it runs to its end.
        """
        for k in range(kills):
            self._kill_once()
            note(f"plain Blender: kill {k + 1} of {kills}, {self._there()} frames")
        self._start().wait()
        return self.damage(kills)

    def _start(self) -> subprocess.Popen:
        command = [sys.executable, "-m", __name__, *self._arguments]
        with open(self.out.with_suffix(".log"), "ab") as log:
            return subprocess.Popen(command, stdout=log, stderr=log)

    def _kill_once(self) -> None:
        process = self._start()
        before = self._there()
        while self._there() < before + FRAMES_BETWEEN:
            if process.poll() is not None:
                log = self.out.with_suffix(".log")
                raise WorkError(f"plain Blender ended before it could be killed; its log: {log}")
            time.sleep(0.01)
        time.sleep(self._rng.uniform(0, 0.3))
        process.kill()
        process.wait()

    def damage(self, kills: int) -> Damage:
        """Count broken files, which are incomplete images, and lost ones, which are missing or
        empty placeholders.
        """
        filled = [file for file in self._files if _size(file)]
        broken = sum(not _readable(file) for file in filled)
        return Damage(len(self._files), kills, broken, len(self._files) - len(filled))

    def _there(self) -> int:
        return sum(_size(file) > 0 for file in self._files)


def _size(file: Path) -> int:
    return file.stat().st_size if file.exists() else 0


def _readable(file: Path) -> bool:
    try:
        return all(np.isfinite(channel).all() for channel in read_exr(file).values())
    except InputError:
        return False


if __name__ == "__main__":
    render_animation(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]))
