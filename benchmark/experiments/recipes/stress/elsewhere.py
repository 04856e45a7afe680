"""Perturbed sequences for systems that run elsewhere, and the cells of the trajectories that come
back from there.

DIR/sequences/SEQUENCE/START/[noisy/]PERTURBATION_SEVERITY        a sequence (TUM)
DIR/masks/SEQUENCE/START/[noisy/]PERTURBATION_SEVERITY            a mask for each RGB image
DIR/trajectories/SEQUENCE/START/[noisy/]PERTURBATION_SEVERITY     NAME.txt (TUM) of a system NAME
"""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from iclnuim.console import Console
from iclnuim.errors import InputError
from iclnuim.evaluation.associate import AssociationSettings, associate
from iclnuim.formats.files import make_folder
from iclnuim.formats.png import write_png
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.sequences.stored_sequence import StoredSequence
from iclnuim.trajectory_files.trajectories import read_trajectory

from ....systems.staging import StagedSequence
from ...outcome import Poses, outcome
from .recipe import Stress, StressKey, staged_truth, system_name, write_segment

#: Value of a pixel of a mask that shows what was put in.
_ON = np.uint16(65535)
#: The share of a frame's time by which a stamp may differ from that of its frame.
_MATCH_SHARE = 0.4


def write_perturbed(stress: Stress, folder: Path, console: Console) -> int:
    """Write every perturbed segment as a sequence, as `iclnuim run` would read it, with the readings
    of an IMU as they are, and masks where something is put in; resumes. Returns the number of sequences.
    """
    keys = list(stress.segment_keys())
    advance = console.progress(len(keys), "stress", "sequences").advance
    for key in keys:
        target = folder / "sequences" / key.segment_place
        imu = stress.inputs[key.sequence].sequence.stored.imu
        write_segment(stress.segment(key), target, imu)
        entry = stress.plan.perturbations.get(key.perturbation)
        if entry is not None and entry.puts_in:
            _write_masks(stress, key, target, folder / "masks" / key.segment_place)
        advance(1)
    return len(keys)


def _write_masks(stress: Stress, key: StressKey, sequence: Path, target: Path) -> None:
    """(h, w) of 0 and 65535 for each frame, under the name of its RGB image."""
    make_folder(target)
    numbers = stress.segment(key).numbers
    clean = stress.clean_segment(key)
    for pair, number in zip(StoredSequence(sequence).pairs, numbers, strict=True):
        path = target / pair.rgb.name
        if not path.is_file():
            on = stress.plan.put_in(key.perturbation, key.severity, clean, number)
            write_png(path, on * _ON)


def returned_cells(stress: Stress, folder: Path) -> dict[StressKey, dict[str, Any]]:
    """The cells of the trajectories in a folder of `write_perturbed`, as of systems of `iclnuim
    run`. Raises InputError if there is none, or one fits no frame.
    """
    found = {}
    for key in stress.segment_keys():
        sequence = folder / "sequences" / key.segment_place
        files = sorted((folder / "trajectories" / key.segment_place).glob("*.txt"))
        if not files:
            continue
        staged = StagedSequence.of(sequence)
        truth = staged_truth(staged, stress.segment(key))
        for file in files:
            poses = Poses.of_file(_on_frames(file, staged), staged.stamps_s)
            method = system_name(file.stem)
            of_system = StressKey(*key.segment, method=method, base=key.base)
            clean = not key.severity
            found[of_system] = asdict(outcome(poses, truth, stress.plan.bounds, clean))
    if not found:
        expected = "a trajectory trajectories/SEQUENCE/START/PERTURBATION_SEVERITY/NAME.txt"
        raise InputError(expected, path=folder, found="none")
    return found


def _on_frames(file: Path, staged: StagedSequence) -> Trajectory:
    """The poses of a trajectory with the stamps of the frames that they match."""
    written = read_trajectory(file, "tum").trajectory
    window_s = _MATCH_SHARE / staged.rate_hz
    pairs = associate(
        staged.stamps_s, written.stamps_s, AssociationSettings(max_difference_s=window_s)
    )
    if not len(pairs):
        raise InputError("the stamps of the frames", path=file, found="none of them")
    return Trajectory(staged.stamps_s[pairs.first], written.T_world_camera[pairs.second])
