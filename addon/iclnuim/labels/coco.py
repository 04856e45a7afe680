"""The ground truth of a sequence as COCO's annotations: a mask of every object in every image, as
uncompressed run lengths (counts of pixels by columns, from a run outside on).
"""

import json
from pathlib import Path
from typing import Any

import numpy as np

from ..console import Meter, advance_of
from ..errors import InputError, StrPath
from ..formats.files import atomic_write_text
from ..sequences.recipe import sequence_name
from .classes import ClassMap
from .frames import LabelFrame, label_frames, read_ids, true_classes


def write_coco(
    path: StrPath,
    folder: StrPath,
    progress: Meter = None,
) -> None:
    """Write the annotations of a sequence with class and instance images as JSON, which pycocotools
    reads. Names of images are relative to the sequence's folder, categories are those of its
    classes.csv, and pixels without a class are in no mask. progress: as of render_frames().

    Raises InputError if the sequence has no such images, WorkError if the file cannot be written.
    """
    folder = Path(folder)
    frames = label_frames(folder)
    classes = true_classes(folder)
    on_frame = advance_of(progress, len(frames), "annotations")
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for number, frame in enumerate(frames, 1):
        found = _annotations(frame, classes)
        height, width = found[0]["segmentation"]["size"] if found else read_ids(frame.classes).shape
        name = frame.pair.rgb.relative_to(folder).as_posix()
        images.append({"id": number, "file_name": name, "width": width, "height": height})
        for annotation in found:
            order = {"id": len(annotations) + 1, "image_id": number}
            annotations.append(order | annotation)
        on_frame()
    categories = []
    for kind in classes.classes:
        parent = kind.nyu40 or kind.name
        categories.append({"id": kind.id, "name": kind.name, "supercategory": parent})
    content = {
        "info": {"description": sequence_name(folder)},
        "images": images,
        "categories": categories,
        "annotations": annotations,
    }
    atomic_write_text(path, json.dumps(content, separators=(",", ":")) + "\n")


def _annotations(frame: LabelFrame, classes: ClassMap) -> list[dict[str, Any]]:
    """One for each instance of each class in a frame."""
    if frame.instance is None:
        expected = "an instance image for each class image"
        raise InputError(expected, path=frame.classes, found="none")
    kinds = read_ids(frame.classes).astype(np.int64)
    instances = read_ids(frame.instance)
    if kinds.shape != instances.shape:
        expected = "an instance image of the class image's size"
        raise InputError(expected, path=frame.instance, found=instances.shape)
    listed = {kind.id for kind in classes.classes}
    segments = kinds << 16 | instances
    found = []
    for segment in np.unique(segments).tolist():
        kind, instance = divmod(segment, 1 << 16)
        if kind in listed:
            mask = segments == segment
            found.append({"category_id": kind, "instance_id": instance, **_mask(mask)})
    return found


def _mask(mask: np.ndarray) -> dict[str, Any]:
    """Run lengths, area and box of a mask (h, w) that is not empty."""
    columns = mask.T.ravel()
    changes = np.flatnonzero(columns[1:] != columns[:-1]) + 1
    starts = [0, 0] if columns[0] else [0]
    counts = np.diff(np.concatenate([starts, changes, [columns.size]]))
    u = np.flatnonzero(mask.any(axis=0))
    v = np.flatnonzero(mask.any(axis=1))
    box = (u[0], v[0], u[-1] - u[0] + 1, v[-1] - v[0] + 1)
    return {
        "segmentation": {"size": list(mask.shape), "counts": counts.tolist()},
        "area": int(mask.sum()),
        "bbox": [int(value) for value in box],
        "iscrowd": 0,
    }
