"""The lines of metadata.jsonl: a frame's images, stamp, camera and pose, as the imagefolder of
Hugging Face datasets and other loaders read them.
"""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ..channels import DEPTH, RGB
from ..formats.files import atomic_write_text
from ..geometry.se3 import SE3
from .camera_files import SequenceCamera
from .contents import Contents
from .format import SequenceFormat
from .frames import poses_at

FILE = "metadata.jsonl"


def metadata_of(
    rgb: str, depth: str, stamp_s: float, camera: SequenceCamera, pose: SE3 | None
) -> dict[str, Any]:
    """What a line says, for the names of a frame's images in the folder; pose: T_world_camera."""
    return {
        "file_name": rgb,
        "depth_file_name": depth,
        "stamp_s": stamp_s,
        **camera.to_dict(),
        "T_world_camera": None if pose is None else pose.matrix.tolist(),
    }


def write_lines(folder: Path, frames: Iterable[dict[str, Any]]) -> Path:
    """Write metadata.jsonl, a line for each frame; returns its path."""
    lines = [json.dumps(frame) + "\n" for frame in frames]
    atomic_write_text(folder / FILE, "".join(lines))
    return folder / FILE


def write_contents(folder: Path, contents: Contents, format: SequenceFormat) -> None:
    """Write metadata.jsonl of a sequence that is being written."""
    poses = poses_at(contents.stamps_s, contents.truth)
    frames = []
    for frame, pose in zip(contents.frames, poses, strict=True):
        rgb = format.image(frame, RGB)
        depth = format.image(frame, DEPTH)
        frames.append(metadata_of(rgb, depth, frame.stamp_s, contents.full_camera, pose))
    write_lines(folder, frames)
