"""Rendering of one frame to arrays: scene-linear RGB, exact planar Z, motion blur and rolling
shutter. Passes are taken from Cycles in memory where possible, otherwise from Blender's multilayer
EXR, with the same values.

For motion blur and rolling shutter, many cheap renders at poses inside the exposure are averaged in
linear light, band by band.
"""

import math
from pathlib import Path
from typing import NamedTuple, TypeAlias

import bpy
import numpy as np

from ...errors import InputError, WorkError
from ...formats import exr
from ...geometry.continuous import frames_at
from ...geometry.trajectory import Trajectory, sample
from ...job import RenderJob
from ...sensor.exposure import Band, motion_px, plan
from ..compat import passes_in_memory, temporarily
from . import settings

#: All channels of a frame by name, such as `ViewLayer.Combined.R`, or an EXR file with them.
Raw: TypeAlias = dict[str, np.ndarray] | Path
#: Blender writes 1e10 where a ray hits nothing.
_BACKGROUND = 1e9
#: Radiance that the noise hides: three standard deviations of the released frames' noise at black,
#: whose variance is about 1.5 of 8-bit steps.
_BLACK = 3 * 1.5**0.5 / 255 / 12.92
#: If the median depth is smaller than this, the camera is inside an object.
_TOO_NEAR_M = 0.05


def render(number: float, raw_file: Path, in_memory: bool = False) -> Raw:
    """Render frame `number` of the open scene, which may be between two frames, to `raw_file`, an
    EXR written by Blender.

    Returns that file, or with `in_memory`, if this Blender allows it, the channels, without writing
    a file. Raises WorkError if Blender fails.
    """
    scene = bpy.context.scene
    scene.frame_set(math.floor(number), subframe=number % 1)
    scene.render.filepath = str(raw_file)
    with passes_in_memory(in_memory) as passes:
        try:
            result = bpy.ops.render.render(write_still=passes is None)
        except RuntimeError as error:
            raise WorkError(f"frame {number}: Blender: {' '.join(str(error).split())}") from None
    if result != {"FINISHED"} or (not raw_file.is_file() if passes is None else not passes):
        raise WorkError(f"frame {number}: Blender ended with {result} and wrote no frame")
    return raw_file if passes is None else passes


class RawFrame(NamedTuple):
    """Blender's frames with RGB and with Z, usually the same, and with Z behind glass if the job
    needs it.
    """

    rgb: Raw
    depth: Raw
    behind: Raw | None


def render_parts(job: RenderJob, number: int, name: Path, volumes: bool) -> RawFrame:
    """Render a frame. Its parts may be files: the caller alternates names while another frame is
    being written.

    A separate render with one sample gives Z if the filter is wide or the scene has `volumes`, else
    Z is that of the first sample. It also gives the further channels, which otherwise are a mean
    over the samples.
    """
    scene = bpy.context.scene
    rgb = depth = render(number, name.with_suffix(".exr"), in_memory=True)
    behind = None
    # one narrow ray per pixel, so that Z has the same bits as without antialiasing
    narrow = {"filter_width": settings.CENTRE_FILTER_PX, "samples": 1, "use_denoising": False}
    if job.antialias or volumes or (job.further and job.samples != 1):
        with temporarily(scene.cycles, **narrow), settings.without_volumes():
            file = name.with_name(f"{name.name}-depth.exr")
            depth = render(number, file, in_memory=True)
    if job.glass != "surface":
        through = temporarily(scene.view_layers[0], pass_alpha_threshold=0.5)
        with through, temporarily(scene.cycles, **narrow), settings.without_volumes():
            file = name.with_name(f"{name.name}-behind.exr")
            behind = render(number, file, in_memory=True)
    return RawFrame(rgb, depth, behind)


def channels_of(raw: Raw) -> dict[str, np.ndarray]:
    """All channels of a frame. Raises InputError for a file that is not a whole EXR."""
    return raw if isinstance(raw, dict) else exr.read_exr(raw)


def read(raw: Raw, raw_depth: Raw) -> tuple[np.ndarray, np.ndarray]:
    """(h, w, 3) scene-linear RGB of `raw` and (h, w) planar Z in metres, 0 for background, of
    `raw_depth` (often the same).

    Raises WorkError for a truncated file: Blender does not report a full disk.
    """
    try:
        channels = channels_of(raw)
        with_depth = channels if raw_depth is raw else channels_of(raw_depth)
    except InputError as error:
        raise WorkError(f"cannot write a whole frame; the disk may be full: {error}") from None
    # each channel is contiguous, so that what follows is computed in half the time
    rgb = np.moveaxis(np.stack([channel_ending(channels, f"Combined.{c}") for c in "RGB"]), 0, -1)
    depth_z_m = channel_ending(with_depth, "Depth.Z")
    return rgb, np.where(depth_z_m < _BACKGROUND, depth_z_m, 0.0).astype(np.float32, copy=False)


def why_black(rgb: np.ndarray, depth_z_m: np.ndarray) -> str | None:
    """The likely cause if less than 1 % of the pixels of an image (h, w, 3) are not black; None for
    all other images.
    """
    # many times as fast as a maximum over the last axis
    brightest = np.maximum(np.maximum(rgb[..., 0], rgb[..., 1]), rgb[..., 2])
    if (brightest > _BLACK).mean() >= 0.01:
        return None
    seen = depth_z_m > 0
    if seen.mean() < 0.01:
        return "the camera sees no surface, and the sky is black; check the trajectory and the unit"
    if np.median(depth_z_m[seen]) < _TOO_NEAR_M:
        return "the camera is inside an object or touches one; check the trajectory"
    return (
        "no light reaches what the camera sees: lamps are hidden or too weak, or a dome shuts the "
        "sky out (of our scenes the backdrop: export them without it); a scene without any light "
        "is lit here"
    )


def channel_ending(channels: dict[str, np.ndarray], *names: str) -> np.ndarray:
    """The channel with one of these names, in any view layer.

    Raises WorkError unless there is exactly one.
    """
    found = [array for key, array in channels.items() if key.endswith(names)]
    if len(found) != 1:
        raise WorkError(
            f"expected one channel *{names[0]} in Blender's frame, found {sorted(channels)}"
        )
    return found[0]


def shoot(
    job: RenderJob, number: int, trajectory: Trajectory, depth_z_m: np.ndarray, raw_file: Path
) -> np.ndarray:
    """Render (h, w, 3) scene-linear RGB of frame `number` of the open scene through the shutter;
    depth_z_m (h, w) is the depth at its stamp.

    Before the start and after the end of the trajectory the camera does not move, but with an IMU,
    whose path goes on.
    """
    camera = job.camera
    here = trajectory.T_world_camera[number]
    stamps_s = trajectory.stamps_s
    motions_px = []
    for duration in (job.exposure_s, job.readout_s):
        ends = stamps_s[number] + np.array([-0.5, 0.5]) * duration
        first, last = np.clip(ends, stamps_s[0], stamps_s[-1])
        # the speed may change at every pose of the trajectory
        stops = np.concatenate([[first], stamps_s[(stamps_s > first) & (stamps_s < last)], [last]])
        moved = 0.0
        if len(trajectory) > 1 and last > first:
            moved = motion_px(depth_z_m, camera, here.inverse() @ sample(trajectory, stops), stops)
        motions_px.append(moved * duration / (last - first) if moved else 0.0)
    rgb = np.empty((camera.height, camera.width, 3), np.float32)
    for band in plan(job.exposure, camera.height, *motions_px):
        # only the band's rows. Blender rounds to whole rows: a quarter of a row is added so that
        # rounding gives exactly these
        part = band.top != 0 or band.bottom != camera.height
        border = {
            "use_border": part,
            "use_crop_to_border": part,
            "border_min_x": 0.0,
            "border_max_x": 1.0,
            "border_min_y": (camera.height - band.bottom + 0.25) / camera.height,
            "border_max_y": (camera.height - band.top + 0.25) / camera.height,
        }
        with temporarily(bpy.context.scene.render, **border):
            rgb[band.top : band.bottom] = _mean(number, band, trajectory, raw_file, bool(job.imu))
    return rgb


def _mean(
    number: int, band: Band, trajectory: Trajectory, raw_file: Path, goes_on: bool
) -> np.ndarray:
    """Mean light of a band's instants. goes_on: whether the camera moves beyond the trajectory.

    Each has a different random seed, which is the same whenever the frame is rendered.
    """
    cycles = bpy.context.scene.cycles
    seed = cycles.seed
    total = np.zeros(())
    stamps_s = trajectory.stamps_s
    for k, offset in enumerate(band.offsets_s):
        # pose i is keyed at frame i of Blender's timeline
        stamp_s = stamps_s[number] + offset
        if not goes_on:
            stamp_s = np.clip(stamp_s, stamps_s[0], stamps_s[-1])
        place = frames_at(trajectory, np.array([stamp_s]))[0]
        with temporarily(cycles, seed=(seed + 7919 * k) % (1 << 31)):
            raw = render(float(place), raw_file, in_memory=True)
        total = total + read(raw, raw)[0].astype(np.float64)
    return (total / len(band.offsets_s)).astype(np.float32)
