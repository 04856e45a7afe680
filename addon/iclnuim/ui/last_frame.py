"""The last frame of a render in an image editor that is open: read in a thread, so that the window goes on meanwhile."""

from __future__ import annotations

import threading
import time
from contextlib import suppress
from pathlib import Path

import bpy
import numpy as np

from ..dataset.frames import read_frame
from ..dataset.sequence import SequenceSettings, noisy_images
from ..errors import IclnuimError
from ..geometry.camera import PinholeCamera
from . import images
from .pictures import colour_and_depth
from .work import Work

NAME = "ICL-NUIM last frame"
#: A new picture this often at most.
PAUSE_S = 1.0


class LastFrame:
    """`look(work)` at each tick of the window."""

    def __init__(self, frames: Path, camera: PinholeCamera) -> None:
        """`frames`: the folder of 000000.exr and on."""
        self._frames, self._camera = frames, camera
        self._picture: np.ndarray | None = None
        self._shown, self._at_s, self._reading = -1, 0.0, False

    def look(self, work: Work) -> None:
        """Show what has been read; begin to read the last frame if it is new and the pause is over."""
        picture, self._picture = self._picture, None
        if picture is not None:
            images.show(bpy.context, NAME, picture, open_editor=False)
        number = work.last_frame if work.phase == "rendering" else None
        idle = not self._reading and time.monotonic() - self._at_s > PAUSE_S
        if number is not None and number != self._shown and idle and images.editor_is_open(bpy.context):
            self._shown, self._at_s, self._reading = number, time.monotonic(), True
            threading.Thread(target=self._read, args=(number,), daemon=True).start()

    def _read(self, number: int) -> None:
        with suppress(IclnuimError):  # a frame that cannot be read is named by the render itself
            light, depth_z_m = read_frame(self._frames / f"{number:06}.exr", self._camera)
            rgb = noisy_images(light, depth_z_m, self._camera, number, SequenceSettings())[0]
            self._picture = colour_and_depth(rgb, depth_z_m)
        self._reading = False
