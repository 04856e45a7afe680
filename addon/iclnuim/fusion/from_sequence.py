"""From a sequence in any TUM-like form and a trajectory to a surface."""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from ..dataset.frames import ImagePair, SequenceCamera
from ..errors import InputError
from ..evaluation.associate import AssociationSettings, associate
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory, frame_slice, sample
from ..odometry.run import Sequence
from .mesh import Mesh, extract
from .settings import FuseSettings
from .volume import BlockLimitError, Volume


@dataclass(frozen=True, eq=False)
class Surface:
    """The mesh, in the trajectory's world; the camera taken; what was left out and why; figures."""

    mesh: Mesh
    camera: SequenceCamera
    left_out: list[str]
    figures: dict


def fuse_sequence(
    folder: Path | str,
    trajectory: Trajectory,
    settings: FuseSettings | None = None,
    progress: Callable | None = None,
    camera: SequenceCamera | None = None,
) -> Surface:
    """Fuse all images that have a pose. `progress(total, label)` makes something with advance(); camera: default: the folder's.

    Raises InputError where there is nothing to fuse, BlockLimitError where one frame needs more memory than was allowed.
    """
    settings, sequence = settings or FuseSettings(), Sequence(folder, camera=camera)
    chosen = [sequence.pairs[i] for i in frame_slice(settings.frames, len(sequence))]
    posed, poses = _posed(chosen, trajectory, settings.max_difference_s)
    parts: list[Mesh] = []
    volume = Volume(settings.volume, lambda volume, leaves: parts.append(extract(volume, leaves, settings.min_weight)))
    bar = progress(len(posed), "fuse") if progress else None
    without = [p.stamp_s for p in chosen if p not in set(posed)]
    left_out = [f"{stamp_s:.6f} s: no pose within {settings.max_difference_s} s" for stamp_s in without]
    started, fusing_s = time.perf_counter(), 0.0
    for i, pair in enumerate(posed):
        try:
            rgb, depth_z_m = sequence.images(pair)
            before = time.perf_counter()
            volume.integrate(depth_z_m, sequence.camera.pinhole, poses[i], rgb)
            fusing_s += time.perf_counter() - before
        except BlockLimitError:
            raise
        except InputError as error:
            left_out.append(f"{pair.stamp_s:.6f} s: {error}")
        if bar:
            bar.advance()
    before = time.perf_counter()
    parts.append(extract(volume, min_weight=settings.min_weight))
    mesh = Mesh.joined([part for part in parts if len(part.triangles)])
    if not len(mesh.triangles):
        raise InputError("images that leave a surface", path=folder, found=f"none in {volume.frames} fused frames")
    figures = {
        "frames": volume.frames,
        "left_out": len(left_out),
        "seconds": time.perf_counter() - started,
        "fusing_ms_a_frame": 1e3 * fusing_s / max(volume.frames, 1),
        "meshing_s": time.perf_counter() - before,
        "blocks_at_most": volume.max_used,
        "memory_mb": volume.bytes_used / 1e6,
        "parts_that_left": len(parts) - 1,
        "vertices": len(mesh.points),
        "triangles": len(mesh.triangles),
        "camera": asdict(sequence.camera),
        "settings": asdict(settings),
    }
    return Surface(mesh, sequence.camera, left_out, figures)


def _posed(pairs: list[ImagePair], trajectory: Trajectory, max_difference_s: float) -> tuple[list[ImagePair], SE3]:
    """Those that have a pose near their stamp, and the poses (n,) at their stamps, between the neighbouring poses."""
    stamps_s = np.array([pair.stamp_s for pair in pairs])
    rule = AssociationSettings("nearest", max_difference_s)
    found = np.unique(associate(trajectory.stamps_s, stamps_s, rule).second) if len(pairs) else []
    if not len(found):
        own = f"{trajectory.stamps_s[0]:.3f}..{trajectory.stamps_s[-1]:.3f} s" if len(trajectory) else "no poses"
        images = f"{stamps_s.min():.3f}..{stamps_s.max():.3f} s" if len(pairs) else "none"
        raise InputError("images that have a pose", found=f"poses at {own}, images at {images}")
    if len(trajectory) == 1:
        return [pairs[i] for i in found], trajectory.T_world_camera[np.zeros(len(found), int)]
    at_s = np.clip(stamps_s[found], trajectory.stamps_s[0], trajectory.stamps_s[-1])
    return [pairs[i] for i in found], sample(trajectory, at_s)
