"""The list of a sequence's images for the imagefolder of Hugging Face datasets."""

import json
from pathlib import Path
from typing import Any

from ..errors import StrPath
from ..formats.files import atomic_write_text
from .frames import poses_at
from .stored_sequence import StoredSequence

FILE = "metadata.jsonl"


def write_metadata(folder: StrPath) -> Path:
    """Write metadata.jsonl into the folder of a sequence, and return its path: for each frame the
    names of its images, its stamp, the camera (pixels, units per metre) and T_world_camera (4, 4)
    in metres of the OpenCV camera, null for a frame without a pose.

    Raises InputError for a folder without a sequence, WorkError if the file cannot be written.
    """
    folder = Path(folder)
    sequence = StoredSequence(folder)
    camera = sequence.camera.to_dict()
    poses = poses_at(sequence.stamps_s, sequence.truth)
    lines = []
    for pair, pose in zip(sequence.pairs, poses, strict=True):
        line: dict[str, Any] = {
            "file_name": pair.rgb.relative_to(folder).as_posix(),
            "depth_file_name": pair.depth.relative_to(folder).as_posix(),
            "stamp_s": pair.stamp_s,
            **camera,
            "T_world_camera": None if pose is None else pose.matrix.tolist(),
        }
        lines.append(json.dumps(line) + "\n")
    atomic_write_text(folder / FILE, "".join(lines))
    return folder / FILE
