"""Sequences, runs, trajectories and surfaces from files as what a page shows: estimates aligned with
the ground truth as for the ATE, the world z up.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from ...errors import InputError, StrPath, within
from ...evaluation.absolute_error import AbsoluteErrorSettings, absolute_error
from ...formats.depth_units import UNITS_PER_METRE
from ...geometry.se3 import SE3
from ...geometry.trajectory import Trajectory
from ...sensor.transfer import srgb8
from ...sequences.frame_source import run_frames
from ...sequences.rgbd_sequence import open_sequence
from ...sequences.stored_sequence import StoredSequence
from ...trajectory_files.trajectories import LoadedTrajectory
from .contents import ViewContents, ViewedFrame, ViewedSequence, ViewedSurface, ViewedTrajectory

#: Frames that a page shows unless others are asked for: it has room for the images of these.
FRAMES = 60


def read_sequence(
    folder: StrPath, name: str, frames: str | None = None, allow_outside: bool = False
) -> tuple[ViewedSequence, Trajectory | None, str]:
    """A sequence in any format, or the frames of a run; its true poses; a note about frames that
    are left out, or "". frames: A:B:S as a Python slice; without it FRAMES of them, evenly chosen.
    allow_outside: as of StoredSequence.

    Raises InputError if there are no frames.
    """
    folder = Path(folder)
    if (folder / "exr").is_dir():
        found, truth = _run(folder, name)
    else:
        found, truth = _sequence(StoredSequence(folder, allow_outside), name)
    count = len(found.frames)
    if frames is None:
        rows = np.unique(np.linspace(0, count - 1, min(count, FRAMES)).round().astype(int)).tolist()
    else:
        parts = (int(part) if part else None for part in frames.split(":"))
        rows = list(range(count))[slice(*parts)]
    if not rows:
        raise InputError(f"frames of the {count} that are there", path=folder, found=frames)
    note = ""
    if len(rows) < count:
        note = f"{name}: {len(rows)} of {count} frames"
    return replace(found, frames=[found.frames[row] for row in rows]), truth, note


def _sequence(stored: StoredSequence, name: str) -> tuple[ViewedSequence, Trajectory | None]:
    sequence = open_sequence(stored)

    def load(row: int) -> tuple[np.ndarray, np.ndarray]:
        frame = sequence[row]
        return frame.rgb, frame.depth_z_m

    frames = [
        ViewedFrame(pair.number, pair.stamp_s, sequence.poses[row], partial(load, row))
        for row, pair in enumerate(sequence.pairs)
    ]
    units = sequence.stored.camera.depth_units_per_metre
    return ViewedSequence(name, sequence.camera, units, frames), sequence.truth


def _run(folder: Path, name: str) -> tuple[ViewedSequence, Trajectory | None]:
    source = run_frames(folder)

    def load(number: int) -> tuple[np.ndarray, np.ndarray]:
        light, depth_z_m = source.load(number)
        return srgb8(light), depth_z_m

    truth = source.truth_of(source.numbers)
    poses = [None] * len(source.numbers) if truth is None else list(truth.T_world_camera)
    frames = [
        ViewedFrame(number, source.stamps_s[number], pose, partial(load, number))
        for number, pose in zip(source.numbers, poses, strict=True)
    ]
    return ViewedSequence(name, source.camera, UNITS_PER_METRE, frames), truth


def trajectories(
    named: Sequence[tuple[str, LoadedTrajectory]],
    truth: Trajectory | None,
    settings: AbsoluteErrorSettings,
) -> list[ViewedTrajectory]:
    """Estimates beside the truth, aligned with it as for the ATE. Without a truth the first one
    stands for it if there are several.

    Raises InputError for an estimate that cannot be aligned.
    """
    rest = list(named)
    found = []
    if truth is None and len(rest) > 1:
        name, loaded = rest.pop(0)
        truth = loaded.trajectory
        found.append(ViewedTrajectory(name, truth, True, loaded.read_as.has_rotations))
    elif truth is not None:
        found.append(ViewedTrajectory("ground truth", truth, is_truth=True))
    for name, loaded in rest:
        if truth is None:
            found.append(
                ViewedTrajectory(name, loaded.trajectory, False, loaded.read_as.has_rotations)
            )
            continue
        with within(name):
            error = absolute_error(truth, loaded.trajectory, settings)
        aligned = Trajectory(
            loaded.trajectory.stamps_s, error.alignment.apply(loaded.trajectory.T_world_camera)
        )
        errors_m = np.full(len(aligned), np.nan)
        errors_m[error.association.second] = error.translation_error_m
        rotations = loaded.read_as.has_rotations
        found.append(ViewedTrajectory(name, aligned, False, rotations, errors_m, error.rmse_mm))
    return found


def gathered(
    title: str,
    read: Sequence[tuple[ViewedSequence, Trajectory | None, str]],
    named: Sequence[tuple[str, LoadedTrajectory]],
    settings: AbsoluteErrorSettings,
    surfaces: Sequence[ViewedSurface] = (),
) -> ViewContents:
    """One page of what read_sequence() returned, and of estimates, which are aligned with the first
    truth; z up.
    """
    truth = next((truth for _, truth, _ in read if truth is not None), None)
    paths = trajectories(named, truth, settings)
    notes = [note for _, _, note in read if note]
    return upright(ViewContents(title, [one for one, _, _ in read], paths, surfaces, notes))


def upright(view: ViewContents) -> ViewContents:
    """The view in a world whose z axis points up: of the world's axes, the one that the cameras'
    upper sides point to most. Without cameras it is z.
    """
    up = np.zeros(3)
    for sequence in view.sequences:
        for frame in sequence.frames:
            if frame.T_world_camera is not None:
                up -= frame.T_world_camera.rotation[:, 1]
    for one in view.trajectories:
        if one.has_rotations:
            up -= one.trajectory.T_world_camera.rotation[..., 1].sum(axis=0)
    axis = int(np.argmax(np.abs(up)))
    if not up.any() or (axis == 2 and up[2] > 0):
        return view
    z = np.zeros(3)
    z[axis] = np.sign(up[axis])
    x = np.roll(np.abs(z), 1)
    T = SE3(np.stack([x, np.cross(z, x), z]), np.zeros(3))
    return ViewContents(
        view.title,
        [_turned_sequence(one, T) for one in view.sequences],
        [
            replace(
                one,
                trajectory=Trajectory(one.trajectory.stamps_s, T @ one.trajectory.T_world_camera),
            )
            for one in view.trajectories
        ],
        [_turned_surface(one, T) for one in view.surfaces],
        view.notes,
    )


def _turned_sequence(sequence: ViewedSequence, T: SE3) -> ViewedSequence:
    frames = [
        replace(one, T_world_camera=one.T_world_camera and T @ one.T_world_camera)
        for one in sequence.frames
    ]
    return replace(sequence, frames=frames)


def _turned_surface(surface: ViewedSurface, T: SE3) -> ViewedSurface:
    return replace(surface, points=T.apply(surface.points))
