"""Breakdown of the time of a rendered frame: rays, shading, and the time that our frame loop and
its EXR files add to that of Cycles.
"""

import statistics
import tempfile
import time
from collections.abc import Iterator
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
        rays = _rays(job, [event.frame for event in closed], Path(folder), ticks)
    spans = ([b - a for a, b in pairwise(starts[WARM_UP:])], cycles[WARM_UP:], rays)
    frame_ms, cycles_ms, rays_ms = (1e3 * statistics.median(seconds) for seconds in spans)
    close_ms = 1e3 * statistics.median(event.close or 0.0 for event in closed[WARM_UP:])
    shading_ms, overhead_ms = max(0.0, cycles_ms - rays_ms), frame_ms - cycles_ms
    return Breakdown(len(closed), frame_ms, cycles_ms, rays_ms, shading_ms, close_ms, overhead_ms)


@contextmanager
def _clock() -> Iterator[list[tuple[str, float]]]:
    """Collect (name, seconds) of every render_pre and render_post."""
    ticks: list[tuple[str, float]] = []
    names = ("render_pre", "render_post")
    handlers = {
        name: (lambda *_, name=name: ticks.append((name, time.perf_counter()))) for name in names
    }
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
    starts, ends = (
        [when for n, when in ticks if n == name] for name in ("render_pre", "render_post")
    )
    return [b - a for a, b in zip(starts, ends, strict=True)], starts


def _rays(
    job: RenderJob, numbers: list[int], folder: Path, ticks: list[tuple[str, float]]
) -> list[float]:
    """Seconds of the same views with all materials black.

    The scene is still open from the frame loop.
    """
    scene = bpy.context.scene
    black = bpy.data.materials.new("black")
    black.use_nodes = True
    black.node_tree.nodes.clear()
    surface = black.node_tree.nodes.new("ShaderNodeOutputMaterial")
    black.node_tree.links.new(
        black.node_tree.nodes.new("ShaderNodeHoldout").outputs[0], surface.inputs[0]
    )
    scene.view_layers[0].material_override = black
    ticks.clear()
    with native_output_in(folder / "log"):
        for number in numbers:
            frames.render(number, folder / "black.exr")
    return _spans(ticks)[0][WARM_UP:]
