"""Breakdown of the time of a rendered frame: rays, shading, and the time that our frame loop and
its EXR files add to that of Cycles.
"""

import statistics
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import bpy
from iclnuim.blender.render import frames, worker
from iclnuim.errors import InputError
from iclnuim.job import RenderJob
from iclnuim.native_output import native_output_in
from iclnuim.worker_events import Event, FrameDone

#: The first frames build the BVH and warm the caches.
WARM_UP = 2


@dataclass(frozen=True)
class Breakdown:
    """Median milliseconds per frame. frame = cycles + overhead; cycles = rays + shading; close_ms
    runs in parallel with the next frame.

    `rays_ms` is the time of the same views with all materials black and no light: rays, and
    Blender's own work per frame.
    """

    frames: int
    frame_ms: float
    cycles_ms: float
    rays_ms: float
    shading_ms: float
    close_ms: float
    overhead_ms: float


def measure(job: RenderJob, frame_range: str) -> Breakdown:
    """Render the frames into a temporary folder with the real frame loop, timed by Blender's render
    handlers.
    """
    with tempfile.TemporaryDirectory() as folder, _clock() as ticks:
        events: list[Event] = []
        with worker.Session(job, Path(folder) / "run", events.append) as session:
            session.render(frame_range, lambda: False)
        closed = [event for event in events if isinstance(event, FrameDone)]
        if len(closed) <= WARM_UP + 1:
            raise InputError(f"at least {WARM_UP + 2} frames to measure", found=len(closed))
        cycles, starts = _spans(ticks)
        rays = _rays([event.frame for event in closed], Path(folder), ticks)
    frame_ms = _median_ms(b - a for a, b in pairwise(starts[WARM_UP:]))
    cycles_ms = _median_ms(cycles[WARM_UP:])
    rays_ms = _median_ms(rays)
    return Breakdown(
        frames=len(closed),
        frame_ms=frame_ms,
        cycles_ms=cycles_ms,
        rays_ms=rays_ms,
        shading_ms=max(0.0, cycles_ms - rays_ms),
        close_ms=_median_ms(event.close or 0.0 for event in closed[WARM_UP:]),
        overhead_ms=frame_ms - cycles_ms,
    )


def _median_ms(seconds: Iterable[float]) -> float:
    return 1e3 * statistics.median(seconds)


@contextmanager
def _clock() -> Iterator[list[tuple[str, float]]]:
    """Collect (name, seconds) of every render_pre and render_post."""
    ticks: list[tuple[str, float]] = []

    def handler_of(name: str) -> Callable[..., None]:
        return lambda *_: ticks.append((name, time.perf_counter()))

    handlers = {name: handler_of(name) for name in ("render_pre", "render_post")}
    for name, handler in handlers.items():
        bpy.app.handlers.persistent(handler)
        getattr(bpy.app.handlers, name).append(handler)
    try:
        yield ticks
    finally:
        for name, handler in handlers.items():
            getattr(bpy.app.handlers, name).remove(handler)


def _spans(ticks: list[tuple[str, float]]) -> tuple[list[float], list[float]]:
    """Seconds in Cycles and start time of each frame."""
    starts = [seconds for name, seconds in ticks if name == "render_pre"]
    ends = [seconds for name, seconds in ticks if name == "render_post"]
    return [b - a for a, b in zip(starts, ends, strict=True)], starts


def _rays(numbers: list[int], folder: Path, ticks: list[tuple[str, float]]) -> list[float]:
    """Seconds of the same views with all materials black.

    The scene is still open from the frame loop.
    """
    scene = bpy.context.scene
    black = bpy.data.materials.new("black")
    black.use_nodes = True
    black.node_tree.nodes.clear()
    surface = black.node_tree.nodes.new("ShaderNodeOutputMaterial")
    holdout = black.node_tree.nodes.new("ShaderNodeHoldout")
    black.node_tree.links.new(holdout.outputs[0], surface.inputs[0])
    scene.view_layers[0].material_override = black
    ticks.clear()
    with native_output_in(folder / "log"):
        for number in numbers:
            frames.render(number, folder / "black.exr")
    return _spans(ticks)[0][WARM_UP:]
