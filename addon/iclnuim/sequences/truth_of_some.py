"""The ground truth of some frames of a sequence, as poses and as the bytes of its file."""

from pathlib import Path

import numpy as np

from ..evaluation.associate import nearest
from ..formats.files import data_lines, read_bytes, read_text
from ..geometry.trajectory import Trajectory
from ..trajectory_files.trajectories import FORMATS
from .frame_source import TruthFile
from .layout import usual_step_s
from .sequence_formats import format_of
from .sequence_poses import find_truth, load_truth


class TruthOfSome:
    """The ground truth of all frames of a sequence, or of some frames: the poses within half a step
    of one of them.
    """

    def __init__(self, folder: Path, stamps_s: dict[int, float]) -> None:
        self.stamps_s = stamps_s
        self._path = find_truth(folder)
        self._loaded = load_truth(folder)
        self._is_mounted = format_of(folder).reader.mount(folder) is not None
        self._reach_s = 0.5 * usual_step_s(np.array(list(stamps_s.values())))

    def _rows(self, numbers: tuple[int, ...]) -> np.ndarray:
        """The indices of the poses that belong to the frames; of all frames, all poses."""
        assert self._loaded is not None
        own = self._loaded.trajectory.stamps_s
        if len(numbers) == len(self.stamps_s):
            return np.arange(len(own))
        chosen = np.sort([self.stamps_s[number] for number in numbers])
        return np.flatnonzero(nearest(own, chosen)[1] <= self._reach_s + 1e-6)

    def poses(self, numbers: tuple[int, ...]) -> Trajectory | None:
        if not self._loaded:
            return None
        rows = self._rows(numbers)
        return self._loaded.trajectory[rows] if len(rows) else None

    def file(self, numbers: tuple[int, ...]) -> TruthFile | None:
        """Format and bytes of the ground-truth file; of some frames, its comments and their lines.

        None if it does not have one pose of the camera per line.
        """
        if self._loaded is None or self._path is None or self._is_mounted:
            return None
        format = self._loaded.read_as.format
        rows = self._rows(numbers)
        first_pose = FORMATS[format].reader.first_pose
        if first_pose is None or not len(rows):
            return None
        data = read_bytes(self._path)
        if len(rows) == len(self._loaded.trajectory):
            return format, data
        text = read_text(self._path).replace("\r\n", "\n").replace("\r", "\n")
        lines = [number for number, _ in data_lines(text)][first_pose:]
        if len(lines) != len(self._loaded.trajectory):  # lines that repeat a stamp were left out
            return None
        dropped = set(lines).difference(lines[row] for row in rows)
        lines_of_text = text.removesuffix("\n").split("\n")  # as data_lines() counts them
        kept = [f"{line}\n" for k, line in enumerate(lines_of_text, 1) if k not in dropped]
        return format, "".join(kept).encode()
