"""Frames that a measurement renders, as arrays."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from iclnuim.formats.exr import read_exr
from iclnuim.job import RenderJob
from iclnuim.sequences.run_folder import read_run
from iclnuim.worker_events import Event, FrameDone


def rendered(
    job: RenderJob, out: Path, numbers: Sequence[int] | str = "::"
) -> tuple[np.ndarray, np.ndarray, float]:
    """(n, h, w, 3) scene-linear RGB and (n, h, w) planar depth in metres of some frames, and the
    median seconds per frame in Cycles, without the first, in which it reads the scene.
    """
    from iclnuim.blender.render import worker

    times_s: list[float] = []

    def listen(event: Event) -> None:
        if isinstance(event, FrameDone) and event.cycles is not None:
            times_s.append(event.cycles)

    with worker.Session(job, out, listen) as session:
        session.render(numbers, lambda: False)
    rgb, depth_z_m = read_frames(out, read_run(out).frame_numbers())
    return rgb, depth_z_m, float(np.median(times_s[1:]))


def read_frames(folder: Path, numbers: Iterable[int]) -> tuple[np.ndarray, np.ndarray]:
    """(n, h, w, 3) scene-linear RGB and (n, h, w) planar depth in metres."""
    run = read_run(folder)
    channels = [read_exr(run.frame_file(n)) for n in numbers]
    rgb = np.stack([np.stack([c[name] for name in "RGB"], -1) for c in channels]).astype(np.float32)
    return rgb, np.stack([c["Z"] for c in channels])


def psnr_db(square: np.ndarray | float) -> np.ndarray:
    """PSNR of mean squared differences of values 0..1, at most 90 dB."""
    return -10 * np.log10(np.maximum(square, 1e-9))
