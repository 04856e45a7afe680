"""The surface of a sequence in any supported format and a trajectory: its images are fused, and the
volume is meshed.
"""

import os
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from iclnuim.console import Meter, advance_of
from iclnuim.errors import InputError
from iclnuim.evaluation.associate import AssociationSettings, associate
from iclnuim.geometry.se3 import SE3, Poses
from iclnuim.geometry.trajectory import Trajectory, frame_slice, sample
from iclnuim.sequences.camera_files import SequenceCamera
from iclnuim.sequences.frames import ImagePair, depth_stamps_s
from iclnuim.sequences.rgbd_sequence import RgbdSequence
from iclnuim.sequences.stored_sequence import StoredSequence
from iclnuim.shown import Shown

from ..odometry.compiling import WorkClock
from ..odometry.run import Sequence
from .mesh import Mesh, extract
from .settings import FuseSettings
from .volume import BlockLimitError, Volume

#: A share of the depth beyond the limit that is more than some of a room.
_NOTED_BEYOND = 0.5


@dataclass(frozen=True, eq=False, repr=False)
class FusedSurface(Shown):
    """The mesh, in the trajectory's world; the camera that was used; the frames left out, with
    reasons; counts and times; notes on depth that was not used, settings as `{name}`.
    """

    mesh: Mesh
    camera: SequenceCamera
    left_out: list[str]
    figures: dict
    notes: list[str] = field(default_factory=list)

    def summary(self) -> str:
        counts = f"{len(self.mesh.points)} vertices, {len(self.mesh.triangles)} triangles"
        return f"{counts} of {self.figures['frames']} frames, {len(self.left_out)} left out"

    def to_dict(self) -> dict[str, Any]:
        """Counts, times, camera and settings."""
        return self.figures


def fuse_sequence(
    folder: RgbdSequence | StoredSequence | Path | str,
    trajectory: Trajectory | Poses | None = None,
    settings: FuseSettings | None = None,
    progress: Meter = None,
) -> FusedSurface:
    """Fuse all images of a sequence or of its folder that have a pose. The trajectory, by default
    the ground truth of the folder, can be poses or matrices (n, 4, 4), one for each image.
    progress: as of render_frames().

    Raises InputError if there is nothing to fuse, BlockLimitError if one frame needs more than
    max_blocks.
    """
    if isinstance(trajectory, str | os.PathLike):
        hint = "iclnuim.read_trajectory(file).trajectory"
        raise InputError("a Trajectory", found=type(trajectory).__name__, hint=hint)
    settings = settings or FuseSettings()
    sequence = Sequence(folder)
    if trajectory is None:
        trajectory = sequence.stored.truth
    if trajectory is None:
        raise InputError("a sequence with ground truth, or a trajectory", found="neither")
    if not isinstance(trajectory, Trajectory):
        stamps_s = np.array([pair.stamp_s for pair in sequence.pairs])
        trajectory = Trajectory(stamps_s, SE3.of(trajectory))
    chosen = [sequence.pairs[i] for i in frame_slice(settings.frames, len(sequence))]
    posed, poses = _posed(chosen, trajectory, settings.max_difference_s)
    fusion = _Fusion(sequence, settings)
    for pair in chosen:
        if pair not in posed:
            reason = f"no pose within {settings.max_difference_s} s"
            fusion.left_out.append(f"{pair.stamp_s:.6f} s: {reason}")
    advance = advance_of(progress, len(posed), "fuse")
    with fusion.clock as clock:
        for i, pair in enumerate(posed):
            fusion.add(pair, poses[i])
            advance()
        started_s = clock()
        mesh = fusion.mesh()
        if not len(mesh.triangles):
            raise fusion.no_surface(sequence.folder)
        figures = {**fusion.figures(), "meshing_s": clock() - started_s}
    figures |= {"vertices": len(mesh.points), "triangles": len(mesh.triangles)}
    figures |= {"camera": asdict(sequence.camera), "settings": asdict(settings)}
    return FusedSurface(mesh, sequence.camera, fusion.left_out, figures, fusion.notes())


@dataclass(eq=False)
class _Fusion:
    """The fusion of a sequence so far: meshes of the parts that left the volume, frames left out
    with reasons, errors of images, and the time that fusing took.
    """

    sequence: Sequence
    settings: FuseSettings
    parts: list[Mesh] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)
    refused: list[InputError] = field(default_factory=list)
    beyond_far: list[float] = field(default_factory=list)
    fusing_s: float = 0.0
    clock: WorkClock = field(default_factory=WorkClock)

    def __post_init__(self) -> None:
        self.started_s = self.clock()
        self.volume = Volume(self.settings.volume, self._mesh_part)

    def _mesh_part(self, volume: Volume, leaves: np.ndarray | None = None) -> None:
        self.parts.append(extract(volume, leaves, self.settings.min_weight))

    def add(self, pair: ImagePair, T_world_camera: SE3) -> None:
        """Fuse one frame, or leave it out if its images are invalid."""
        try:
            rgb, depth_z_m = self.sequence.images(pair)
            started_s = self.clock()
            self.beyond_far.append(self._beyond_far(depth_z_m))
            self.volume.integrate(depth_z_m, self.sequence.camera.pinhole, T_world_camera, rgb)
            self.fusing_s += self.clock() - started_s
        except BlockLimitError:
            raise
        except InputError as error:
            self.left_out.append(f"{pair.stamp_s:.6f} s: {error}")
            self.refused.append(error)

    def mesh(self) -> Mesh:
        """Mesh what remains in the volume, and join all parts."""
        self._mesh_part(self.volume)
        return Mesh.joined([part for part in self.parts if len(part.triangles)])

    def figures(self) -> dict:
        """Counts and times so far; parts_out_of_window: without what remained in the volume."""
        return {
            "frames": self.volume.frames,
            "left_out": len(self.left_out),
            "seconds": self.clock() - self.started_s,
            "fusing_ms_per_frame": 1e3 * self.fusing_s / max(self.volume.frames, 1),
            "max_blocks_used": self.volume.max_used,
            "memory_mb": self.volume.bytes_used / 1e6,
            "parts_out_of_window": len(self.parts) - 1,
        }

    def _beyond_far(self, depth_z_m: np.ndarray) -> float:
        """The share of the measured depth that is too far away to be used."""
        measured = depth_z_m[depth_z_m > 0]
        return float((measured >= self.settings.volume.far_m).mean()) if measured.size else 0.0

    def notes(self) -> list[str]:
        """A sentence if most depth is too far away to be used."""
        beyond = float(np.mean(self.beyond_far)) if self.beyond_far else 0.0
        if beyond <= _NOTED_BEYOND:
            return []
        far = f"{self.settings.volume.far_m:g} m"
        return [
            f"{beyond:.0%} of the depth is {far} or more away and is not fused: beyond the limit"
        ]

    def no_surface(self, folder: Path | str) -> InputError:
        """The error for no surface, with the number of frames left out, and the reason of the first
        whose images were refused, if any was.
        """
        found = f"no triangle in {self.volume.frames} fused frames"
        hint = None
        for note in self.notes():
            found += f"; {note}"
            hint = "a larger {far_m}"
        if self.left_out:
            first = self.left_out[0]
            if self.refused:
                first = str(self.refused[0]).partition("; try ")[0]
                hint = self.refused[0].hint
            first = first.removeprefix(f"{folder}/")
            found += f"; {len(self.left_out)} left out, the first: {first}"
        return InputError("images that produce a surface", path=folder, found=found, hint=hint)


def _posed(
    pairs: list[ImagePair], trajectory: Trajectory, max_difference_s: float
) -> tuple[list[ImagePair], SE3]:
    """The pairs with a pose near the stamp of their depth image, and the poses (n,) at these
    stamps, interpolated between neighbouring poses.
    """
    stamps_s = depth_stamps_s(pairs)
    found = np.zeros(0, int)
    if len(pairs):
        rule = AssociationSettings("nearest", max_difference_s)
        found = np.unique(associate(trajectory.stamps_s, stamps_s, rule).second)
    if not len(found):
        poses = _covered(trajectory.stamps_s) or "no poses"
        images = _covered(stamps_s) or "none"
        raise InputError("images that have a pose", found=f"poses at {poses}, images at {images}")
    posed = [pairs[i] for i in found]
    if len(trajectory) == 1:
        return posed, trajectory.T_world_camera[np.zeros(len(found), int)]
    at_s = np.clip(stamps_s[found], trajectory.stamps_s[0], trajectory.stamps_s[-1])
    return posed, sample(trajectory, at_s)


def _covered(stamps_s: np.ndarray) -> str:
    """`0.000..29.300 s`, empty without stamps."""
    return f"{stamps_s.min():.3f}..{stamps_s.max():.3f} s" if len(stamps_s) else ""
