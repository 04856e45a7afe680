"""Noise, sequences and trajectory error for use from Python, in Blender or out of it: one thin module over the library.

from iclnuim import postprocess
postprocess.make_sequence("out/living_room/kt2/raw", "noisy", depth_noise="released", rgb_noise="released", seed=1)
postprocess.absolute_trajectory_error("noisy/groundtruth.txt", "estimate.txt").translation_m.rmse
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .dataset.frames import image_frames, run_frames
from .dataset.sequence import SequenceSettings, WrittenSequence, write_sequence
from .evaluation.absolute_error import AbsoluteError, AbsoluteErrorSettings, absolute_error
from .formats.trajectories import read_trajectory
from .geometry.camera import PinholeCamera
from .sensor.models import depth_model, rgb_model
from .sensor.randomness import DEPTH, RGB, frame_generator

Settings = Mapping[str, Any]


def noisy_depth(
    depth_z_m: np.ndarray,
    model: str = "paper",
    camera: PinholeCamera | None = None,
    seed: int = 0,
    frame: int = 0,
    settings: Settings | None = None,
) -> np.ndarray:
    """(h, w) planar depth in metres, 0 = missing -> the same with the noise of a model (sensor/models.py), float32."""
    camera = camera or PinholeCamera.parse(f"{depth_z_m.shape[1]}x{depth_z_m.shape[0]}")
    return depth_model(model, settings).apply(depth_z_m, camera, frame_generator(seed, frame, DEPTH))


def noisy_rgb(
    light: np.ndarray, model: str = "paper", seed: int = 0, frame: int = 0, settings: Settings | None = None
) -> np.ndarray:
    """(h, w, 3) scene-linear light, 1 = white -> (h, w, 3) uint8 with the noise of a model."""
    return rgb_model(model, settings).apply(light, frame_generator(seed, frame, RGB))


def make_sequence(
    frames: str | os.PathLike[str],
    out: str | os.PathLike[str],
    depth_noise: str = "none",
    rgb_noise: str = "none",
    seed: int = 0,
    dialects: tuple[str, ...] = ("tum",),
    depth_settings: Settings | None = None,
    rgb_settings: Settings | None = None,
) -> WrittenSequence:
    """A sequence from a run's EXR frames, or from a sequence of PNG pairs; goes on where it was stopped."""
    folder = Path(frames)
    source = run_frames(folder) if (folder / "exr").is_dir() else image_frames(folder)
    settings = SequenceSettings(depth_model(depth_noise, depth_settings), rgb_model(rgb_noise, rgb_settings), seed)
    return write_sequence(source, Path(out), settings, dialects)


def absolute_trajectory_error(
    truth: str | os.PathLike[str], estimate: str | os.PathLike[str], settings: AbsoluteErrorSettings | None = None
) -> AbsoluteError:
    """ATE of an estimate file against a ground-truth file, each in any format that can be read."""
    reference, other = (read_trajectory(path).trajectory for path in (truth, estimate))
    return absolute_error(reference, other, settings or AbsoluteErrorSettings())
