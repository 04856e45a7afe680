"""Inspection of a user-provided sequence: errors and warnings as sentences."""

import numpy as np

from ...errors import StrPath
from ...geometry.trajectory import frame_rate_hz
from ..frames import ImagePair
from ..stored_sequence import StoredSequence
from .findings import Inspection
from .images import inspect_brightness, inspect_camera, inspect_depth, inspect_images
from .poses import inspect_depth_against_poses, inspect_distances, inspect_poses


def inspect_sequence(folder: StrPath) -> Inspection:
    """Inspect a sequence in any known format.

    It never raises an error because of a file's content.
    """
    sequence = StoredSequence(folder)
    result = Inspection(sequence.folder)
    pairs = result.attempt(lambda: sequence.pairs)
    if pairs is None:
        return result
    _count(result, sequence)
    _time(result, pairs)
    headers = inspect_images(result, pairs)
    inspect_brightness(result, pairs)
    camera = result.attempt(lambda: sequence.camera)
    if camera is not None:
        inspect_camera(result, camera, headers)
        depths = inspect_depth(result, pairs, camera)
    loaded = result.attempt(lambda: sequence.loaded_truth)
    if loaded is None:
        if sequence.truth_path is None:
            result.warnings.append("no ground truth")
        return result
    truth = loaded.trajectory
    inspect_poses(result, pairs, loaded)
    if camera is not None and depths:
        inspect_distances(result, depths, truth, camera.pinhole)
        inspect_depth_against_poses(result, pairs, camera, truth)
    return result


def _count(result: Inspection, sequence: StoredSequence) -> None:
    pairs = sequence.pairs
    result.figures["pairs"] = len(pairs)
    unused = sequence.unused_images()
    result.images(
        result.warnings, sequence.missing_images(), "{} images in the lists do not exist: {}"
    )
    for kind, paths in (("rgb", {p.rgb for p in pairs}), ("depth", {p.depth for p in pairs})):
        result.figures[f"{kind}_images"] = len(paths) + len(unused[kind])
        alone = f"{{}} images in {kind}/ have no partner or are in no list: {{}}"
        result.images(result.warnings, unused[kind], alone)


def _time(result: Inspection, pairs: list[ImagePair]) -> None:
    steps = np.diff([p.stamp_s for p in pairs])
    if not len(steps):
        return
    usual = float(np.median(steps))
    rate_hz = frame_rate_hz([p.stamp_s for p in pairs]) if usual > 0 else None
    result.figures["rate_hz"] = rate_hz
    result.figures["duration_s"] = round(pairs[-1].stamp_s - pairs[0].stamp_s, 3)
    if back := int((steps <= 0).sum()):
        result.errors.append(f"{back} stamps are not after the previous stamp")
    gaps = np.flatnonzero(steps > 1.5 * usual)
    if gaps.size:
        where = pairs[int(gaps[0])].rgb.name
        result.warnings.append(
            f"{gaps.size} gaps in time, the longest {steps.max():.3f} s, the first after {where}"
        )
