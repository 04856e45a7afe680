"""Sequences on which methods are measured: opened once, with their ground truth and a hash that
identifies them.
"""

from dataclasses import dataclass
from pathlib import Path

from iclnuim.benchmark.odometry.run import Sequence
from iclnuim.errors import InputError
from iclnuim.formats.files import read_bytes, sha256
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.sequences.recipe import rendered_job
from iclnuim.sequences.stored_sequence import StoredSequence

from ..systems.staging import StagedSequence

#: Files that identify a sequence of ours: its journal has the hash of every image.
_JOURNAL = ("frames.jsonl", "groundtruth.txt", "camera.json")


@dataclass(frozen=True, eq=False)
class Input:
    """A sequence and its ground truth. sha256: of images, camera and ground truth."""

    name: str
    sequence: Sequence
    truth: Trajectory
    sha256: str

    @classmethod
    def of(cls, sequence: Sequence, name: str) -> "Input":
        """Raises InputError without ground truth."""
        folder = sequence.folder
        truth = sequence.stored.truth
        if truth is None:
            raise InputError("a ground truth in the folder", path=folder, found="none")
        return cls(name, sequence, truth, input_sha256(folder))


def rendered_name(folder: Path) -> str:
    """`living_room/kt2` for a sequence that was rendered along it, else its last two folders."""
    return rendered_job(folder).get("sequence") or "/".join(folder.resolve().parts[-2:])


def input_sha256(folder: Path) -> str:
    """The hash of a sequence: of ours by its journal, of others by the content of all images."""
    files = [folder / name for name in _JOURNAL]
    sequence = StoredSequence(folder)
    if all(path.is_file() for path in files):
        missing = "".join(path.name for path in sequence.missing_images())  # not in the journal
        return sha256(("".join(sha256(path.read_bytes()) for path in files) + missing).encode())
    staged = StagedSequence.of(sequence)
    truth = sequence.truth_path
    parts = [
        staged.images_sha256,
        repr(staged.camera),
        sha256(read_bytes(truth)) if truth else "no ground truth",
    ]
    return sha256(" ".join(parts).encode())
