"""The list of a sequence's images for the imagefolder of Hugging Face datasets."""

from pathlib import Path

from ..errors import StrPath
from .frames import poses_at
from .metadata_lines import metadata_of, write_lines
from .stored_sequence import StoredSequence


def write_metadata(folder: StrPath) -> Path:
    """Write metadata.jsonl into the folder of a sequence, and return its path: for each frame the
    names of its images, its stamp, the camera (pixels, units per metre) and T_world_camera (4, 4)
    in metres of the OpenCV camera, null for a frame without a pose.

    Raises InputError for a folder without a sequence, WorkError if the file cannot be written.
    """
    folder = Path(folder)
    sequence = StoredSequence(folder)
    poses = poses_at(sequence.stamps_s, sequence.truth)
    frames = []
    for pair, pose in zip(sequence.pairs, poses, strict=True):
        rgb = pair.rgb.relative_to(folder).as_posix()
        depth = pair.depth.relative_to(folder).as_posix()
        frames.append(metadata_of(rgb, depth, pair.stamp_s, sequence.camera, pose))
    return write_lines(folder, frames)
