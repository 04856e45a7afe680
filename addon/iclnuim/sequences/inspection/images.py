"""Inspection of a sequence's images: their files, colour, camera and range of depth."""

import contextlib
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from ...errors import InputError, WorkError
from ...formats.depth_units import LARGEST_UNIT
from ...formats.files import is_file
from ...formats.images import ARRAY, image_header, read_array, read_colour8
from ...formats.png import PngHeader
from ..camera_files import SequenceCamera
from ..frames import ImagePair
from ..stored_sequence import read_depth_m
from .findings import Inspection

#: Number of colour and of depth images whose pixels are read.
_SAMPLES = 24
#: How the images of a kind may be stored.
_EXPECTED = {"rgb": ("8-bit RGB",), "depth": ("16-bit grey", "32-bit grey, metres")}


def inspect_images(result: Inspection, pairs: list[ImagePair]) -> list[PngHeader]:
    """Headers of all valid images; every file is read and its checksums are verified."""
    checked = []
    with ThreadPoolExecutor(4) as pool:
        for pair in pairs:
            for kind, path in (("rgb", pair.rgb), ("depth", pair.depth)):
                if is_file(path):
                    checked.append((kind, pool.submit(image_header, path, True)))
    broken = [str(work.exception()) for _, work in checked if work.exception()]
    result.errors += broken[:5]
    if len(broken) > 5:
        result.errors.append(f"{len(broken) - 5} more damaged images")
    headers = [(kind, work.result()) for kind, work in checked if not work.exception()]
    for kind, expected in _EXPECTED.items():
        of_kind = [header for k, header in headers if k == kind]
        found = Counter(map(str, of_kind))
        result.figures[f"{kind}_format"] = ", ".join(found)
        if len(found) > 1:
            counts = ", ".join(f"{count} of {each}" for each, count in found.items())
            result.errors.append(f"{kind} images differ: {counts}")
        if wrong := [each for each in found if not each.endswith(expected)]:
            unreadable = kind == "depth" or any(header.bits != 8 for header in of_kind)
            where = result.errors if unreadable else result.warnings
            where.append(f"{kind} images are {wrong[0]}, not {expected[0]}")
    return [header for _, header in headers]


def _sampled(pairs: list[ImagePair]) -> list[ImagePair]:
    """Pairs at equal distances, of which the images are read."""
    return [pairs[i] for i in sorted({int(i) for i in np.linspace(0, len(pairs) - 1, _SAMPLES)})]


def inspect_brightness(result: Inspection, pairs: list[ImagePair]) -> None:
    """Report black colour images: an error if all inspected ones are."""
    bright: list[tuple[str, bool]] = []
    for pair in _sampled(pairs):
        # reported already, or no package reads JPEG
        with contextlib.suppress(InputError, WorkError):
            bright.append((pair.rgb.name, bool(read_colour8(pair.rgb).any())))
    if black := [name for name, light in bright if not light]:
        where = result.errors if len(black) == len(bright) else result.warnings
        where.append(
            f"{len(black)} of {len(bright)} inspected colour images are black, the first {black[0]}"
        )


def inspect_camera(result: Inspection, camera: SequenceCamera, headers: list[PngHeader]) -> None:
    c = camera.pinhole
    result.figures["camera"] = c.to_dict()
    if camera.assumed:
        units = f"{camera.depth_units_per_metre:g} depth units per metre"
        result.warnings.append(f"no camera.json: the benchmark's camera and {units} are used")
    result.warnings += camera.notes
    known = {(camera.width, camera.height) for camera in (c, camera.colour or c)}
    if others := {(h.width, h.height) for h in headers} - known:
        sizes = ", ".join(f"{w} x {h}" for w, h in sorted(others))
        result.errors.append(f"the camera is {c.width} x {c.height}, images are {sizes}")
    if (c.cx, c.cy) == (c.width / 2, c.height / 2):
        result.warnings.append(
            "principal point at half the image size: "
            "half a pixel off if pixel centres are at whole numbers"
        )


def inspect_depth(
    result: Inspection, pairs: list[ImagePair], camera: SequenceCamera
) -> list[tuple[float, np.ndarray]]:
    """Check the range and holes of depth in some frames.

    Returns these depth images with their stamps.
    """
    c = camera.pinhole
    depths: list[tuple[float, np.ndarray]] = []
    others: list[str] = []
    not_finite = 0
    for pair in _sampled(pairs):
        with contextlib.suppress(InputError):  # reported already
            depth = read_depth_m(pair.depth, camera.depth_units_per_metre)
            not_finite += _not_finite(pair.depth)
            if depth.shape == (c.height, c.width):
                depths.append((pair.stamp_s, depth))
            else:
                others.append(f"{pair.depth.name} is {depth.shape[1]} x {depth.shape[0]}")
    if others:
        several = f"{len(others)} of {len(depths) + len(others)} inspected depth images"
        size = f"the camera's size {c.width} x {c.height}"
        result.errors.append(f"{several} are not of {size}: {others[0]}")
        if not depths:
            return []
    if not_finite:
        count = f"{not_finite} depths of {len(depths)} inspected images"
        result.warnings.append(f"{count} are NaN or infinite: they are read as missing")
    largest_m = np.float32(LARGEST_UNIT) / np.float32(camera.depth_units_per_metre)
    if pairs[0].depth.suffix == ARRAY:
        largest_m = np.float32(np.inf)
    seen = [depth[depth > 0] for _, depth in depths]
    if not any(len(one) for one in seen):
        result.errors.append("no depth in any of the inspected images")
        return []
    pixels = len(depths) * c.width * c.height
    _range(result, np.concatenate(seen), pixels, camera.depth_units_per_metre, largest_m)
    return depths


def _not_finite(path: Path) -> int:
    """The number of depths of an array of metres that are NaN or infinite."""
    if path.suffix != ARRAY:
        return 0
    return int(np.count_nonzero(~np.isfinite(read_array(path))))


def _range(
    result: Inspection, seen: np.ndarray, pixels: int, per_metre: float, largest_m: np.floating
) -> None:
    """Check the depths `seen` (n,) in metres of this number of pixels."""
    low, middle, high = np.percentile(seen, (0.1, 50, 99.9)).tolist()
    missing = 1 - seen.size / pixels
    result.figures["depth_m"] = {
        "nearest": round(low, 3),
        "median": round(middle, 3),
        "farthest": round(high, 3),
    }
    result.figures["depth_missing_share"] = round(missing, 4)
    if not 0.25 <= middle <= 25:
        found = f"median depth of {middle:.3f} m with {per_metre:g} units per metre"
        for units in (1000.0, 5000.0):
            other_m = middle * per_metre / units
            if 0.25 <= other_m <= 25 and units != per_metre:
                found += f": {units:g} units per metre would give {other_m:.2f} m"
                break
        result.errors.append(found)
    if (at_end := float((seen == largest_m).mean())) > 1e-4:
        result.errors.append(
            f"{at_end:.2%} of the depths are 65535: depth was clipped at the end of the range"
        )
    if missing > 0.5:
        result.warnings.append(f"{missing:.0%} of the depth is missing")
