"""A sequence in TUM form and anybody's trajectory become a surface."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from ..dataset.images import ImagePair, SequenceCamera, find_pairs, read_camera
from ..errors import InputError
from ..evaluation.associate import AssociationSettings, associate
from ..formats.png import read_depth16, read_rgb8
from ..geometry.trajectory import Trajectory, frame_slice, sample
from .mesh import Mesh, extract
from .volume import Volume, VolumeSettings


@dataclass(frozen=True)
class FuseSettings:
    """least_weight: how often a voxel must have been seen to be meshed; frames: a slice of the images, A:B:S."""

    volume: VolumeSettings
    least_weight: float = 0.25
    frames: str = "::"
    max_difference_s: float = 0.02


@dataclass(frozen=True, eq=False)
class Surface:
    """The mesh, in the trajectory's world; the camera taken; what was left out and why; figures."""

    mesh: Mesh
    camera: SequenceCamera
    left_out: list[str]
    figures: dict


def fuse_sequence(
    folder: Path,
    trajectory: Trajectory,
    settings: FuseSettings,
    progress: Callable | None = None,
    camera: SequenceCamera | None = None,
) -> Surface:
    """Fuse all images that have a pose. `progress(total, label)` makes something with advance(); camera: default: the folder's.

    Raises InputError where there is nothing to fuse, or more than the memory that was allowed holds.
    """
    pairs = find_pairs(folder)
    chosen = [pairs[i] for i in frame_slice(settings.frames, len(pairs))]
    posed, poses = _posed(chosen, trajectory, settings.max_difference_s)
    camera = camera or read_camera(folder, next((p.rgb for p in posed if p.rgb.is_file()), posed[0].rgb))
    parts: list[Mesh] = []
    volume = Volume(
        settings.volume, lambda volume, leaves: parts.append(extract(volume, leaves, settings.least_weight))
    )
    bar = progress(len(posed), "fuse") if progress else None
    left_out = [
        f"{p.stamp_s:.6f} s: no pose within {settings.max_difference_s} s" for p in chosen if p not in set(posed)
    ]
    started, fusing_s = time.perf_counter(), 0.0
    for pair, T_world_camera in zip(posed, poses, strict=True):
        try:
            depth_z_m, rgb = _read(pair, camera.depth_units_per_metre)
            before = time.perf_counter()
            volume.integrate(depth_z_m, camera.pinhole, T_world_camera, rgb)
            fusing_s += time.perf_counter() - before
        except InputError as error:
            if "blocks" in str(error):
                raise
            left_out.append(f"{pair.stamp_s:.6f} s: {error}")
        if bar:
            bar.advance()
    before = time.perf_counter()
    parts.append(extract(volume, least_weight=settings.least_weight))
    mesh = Mesh.joined([part for part in parts if len(part.triangles)])
    if not len(mesh.triangles):
        raise InputError("images that leave a surface", path=folder, found=f"none in {volume.frames} fused frames")
    figures = {
        "frames": volume.frames,
        "left_out": len(left_out),
        "seconds": time.perf_counter() - started,
        "fusing_ms_a_frame": 1e3 * fusing_s / max(volume.frames, 1),
        "meshing_s": time.perf_counter() - before,
        "blocks_at_most": volume.most_used,
        "memory_mb": volume.bytes_used / 1e6,
        "parts_that_left": len(parts) - 1,
        "vertices": len(mesh.points),
        "triangles": len(mesh.triangles),
        "camera": asdict(camera),
        "settings": asdict(settings),
    }
    return Surface(mesh, camera, left_out, figures)


def _posed(
    pairs: list[ImagePair], trajectory: Trajectory, max_difference_s: float
) -> tuple[list[ImagePair], np.ndarray]:
    """Those that have a pose near their stamp, and the poses (n, 4, 4) at their stamps, between the neighbouring poses."""
    stamps_s = np.array([pair.stamp_s for pair in pairs])
    rule = AssociationSettings("nearest", max_difference_s)
    found = np.unique(associate(trajectory.stamps_s, stamps_s, rule).second) if len(pairs) else []
    if not len(found):
        own = f"{trajectory.stamps_s[0]:.3f}..{trajectory.stamps_s[-1]:.3f} s" if len(trajectory) else "no poses"
        images = f"{stamps_s.min():.3f}..{stamps_s.max():.3f} s" if len(pairs) else "none"
        raise InputError("images that have a pose", found=f"poses at {own}, images at {images}")
    if len(trajectory) == 1:
        return [pairs[i] for i in found], np.repeat(trajectory.T_world_camera.matrix, len(found), axis=0)
    at_s = np.clip(stamps_s[found], trajectory.stamps_s[0], trajectory.stamps_s[-1])
    return [pairs[i] for i in found], sample(trajectory, at_s).matrix


def _read(pair: ImagePair, units_per_metre: float) -> tuple[np.ndarray, np.ndarray]:
    return read_depth16(pair.depth).astype(np.float32) / np.float32(units_per_metre), read_rgb8(pair.rgb)
