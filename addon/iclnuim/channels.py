"""The registry of rendered channels: the images of every frame, how they are stored, and how two
renders of them are compared.

A new channel is an entry here, and a function that computes it in blender/render/passes.py.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .formats.depth_units import depth16_from_metres
from .formats.images import ARRAY, JPEG

#: Colour and depth, which every frame has. Depth is planar, in metres; 0 where nothing is hit.
RGB = "rgb"
DEPTH = "depth"
#: How sure a sensor is of each pixel of depth, (h, w) uint8: 0 low, 1 medium, 2 high. It comes from a
#: noise model, and is no channel of a render.
CONFIDENCE = "confidence"
#: Names in a frame's EXR. Where a ray hits nothing, instance is 0 and normal (0, 0, 0). Normals are
#: in the cv camera's frame.
INSTANCE = "instance"
NORMAL = ("normal.X", "normal.Y", "normal.Z")
#: A component c of a normal is stored as NORMAL_ZERO + c * NORMAL_STEPS; 0 0 0 where nothing is
#: seen. Rounding rotates it by at most 0.0015 degrees.
NORMAL_ZERO = 32768
NORMAL_STEPS = 32767

#: The channels of a frame's EXR by name, (h, w) each.
Exr = Mapping[str, np.ndarray]
#: Returns (65536,) class numbers by instance number.
ClassNumbers = Callable[[], np.ndarray]


@dataclass(frozen=True)
class Channel:
    """One image of every frame.

    name: kind of image, and its folder in a sequence. exr: name -> type of what it is made of in a
    frame's EXR; exr_name: its name there in messages, if it is another. cycles_pass: the attribute
    of Blender's view layer that makes Cycles compute it.

    read(exr, class numbers): the image, (h, w) or (h, w, 3). encode(image, depth units per metre):
    the pixels of its PNG; decode(pixels, depth units per metre): the values that are compared.
    displayed(image): these values of an image from EXR. tolerance: how far rounding moves them on
    another processor. png_bytes: bytes per pixel of its PNG, the mean of clean and noisy sequences
    of both rooms (640 x 480). loss(ending of the file, depth units per metre, those of the source):
    what a format loses that stores it in this way, "" if nothing. ground_truth: whether a job with
    `ground_truth` has it.
    """

    name: str
    description: str
    exr: Mapping[str, type[np.floating]]
    cycles_pass: str
    read: Callable[[Exr, ClassNumbers], np.ndarray]
    png_bytes: float
    exr_name: str = ""
    encode: Callable[[np.ndarray, float], np.ndarray] = lambda image, units: image
    decode: Callable[[np.ndarray, float], np.ndarray] = lambda pixels, units: pixels.astype(float)
    displayed: Callable[[np.ndarray], np.ndarray] = lambda image: image.astype(float)
    tolerance: float = 0.0
    loss: Callable[[str, float, float], str] = lambda ending, units, source_units: ""
    ground_truth: bool = False


def stacked(*names: str) -> Callable[[Exr, ClassNumbers], np.ndarray]:
    """A reader of the image (h, w, n) whose channels have these names."""
    return lambda exr, class_numbers: np.stack([exr[name] for name in names], -1)


def normal16(normal: np.ndarray) -> np.ndarray:
    """Encode unit normals (h, w, 3), (0, 0, 0) where there is none, as (h, w, 3) uint16."""
    steps = np.rint(normal.astype(float) * NORMAL_STEPS) + NORMAL_ZERO
    return np.where(np.any(normal != 0, -1, keepdims=True), steps, 0).astype(np.uint16)


def _instance(exr: Exr, class_numbers: ClassNumbers) -> np.ndarray:
    return exr[INSTANCE].astype(np.uint16)


def _class(exr: Exr, class_numbers: ClassNumbers) -> np.ndarray:
    return class_numbers()[_instance(exr, class_numbers)]


def _rgb_loss(ending: str, units: float, source_units: float) -> str:
    return "colour is stored as JPEG, with loss" if ending == JPEG else ""


def _depth_loss(ending: str, units: float, source_units: float) -> str:
    if ending == ARRAY or units >= source_units:
        return ""
    return f"depth is stored in {units:g} units per metre; the source has {source_units:g}"


_ALL = (
    # The noise model has converted it to 8 bits. As displayed: a curve close to that of sRGB.
    Channel(
        RGB,
        "colour: scene-linear in EXR, 8-bit sRGB in a sequence",
        exr=dict.fromkeys("RGB", np.float16),
        exr_name="RGB",
        cycles_pass="use_pass_combined",
        read=stacked(*"RGB"),
        decode=lambda pixels, units: pixels.astype(np.float32),
        displayed=lambda image: 255 * np.clip(image.astype(np.float32), 0, 1) ** (1 / 2.2),
        png_bytes=1.5,
        tolerance=3.0,
        loss=_rgb_loss,
    ),
    Channel(
        DEPTH,
        "planar depth in metres",
        exr={"Z": np.float32},
        exr_name="Z",
        cycles_pass="use_pass_z",
        read=lambda exr, class_numbers: exr["Z"],
        encode=depth16_from_metres,
        decode=lambda pixels, units: pixels / units,
        png_bytes=0.5,
        tolerance=0.001,
        loss=_depth_loss,
    ),
    Channel(
        "instance",
        "number of the object in objects.json",
        exr={INSTANCE: np.float32},
        cycles_pass="use_pass_object_index",
        read=_instance,
        png_bytes=0.024,
        ground_truth=True,
    ),
    Channel(
        "class",
        "number of the object's class in classes.csv",
        exr={INSTANCE: np.float32},
        cycles_pass="use_pass_object_index",
        read=_class,
        png_bytes=0.024,
        ground_truth=True,
    ),
    Channel(
        "normal",
        "unit normal of the surface in the camera's frame",
        exr=dict.fromkeys(NORMAL, np.float32),
        cycles_pass="use_pass_normal",
        read=stacked(*NORMAL),
        encode=lambda image, units: normal16(image),
        decode=lambda pixels, units: (pixels - float(NORMAL_ZERO)) / NORMAL_STEPS,
        png_bytes=1.3,
        tolerance=0.01,
        ground_truth=True,
    ),
)
#: name -> channel
CHANNELS = {channel.name: channel for channel in _ALL}
#: Colour and depth.
BASE = (CHANNELS[RGB], CHANNELS[DEPTH])
#: The channels besides colour and depth.
FURTHER = {name: channel for name, channel in CHANNELS.items() if name not in (RGB, DEPTH)}


def further_of(job: Mapping[str, Any]) -> tuple[Channel, ...]:
    """The channels besides colour and depth of a job, given as in a recipe."""
    wanted = job.get("channels") or ()
    truth = bool(job.get("ground_truth"))
    return tuple(c for c in FURTHER.values() if c.name in wanted or (truth and c.ground_truth))


def exr_types(channels: tuple[Channel, ...]) -> dict[str, type[np.floating]]:
    """Name -> type of everything in a frame's EXR."""
    found: dict[str, type[np.floating]] = {}
    for channel in channels:
        found |= channel.exr
    return found


def exr_bytes(channels: tuple[Channel, ...]) -> int:
    """Bytes per pixel of a frame's EXR, not compressed."""
    return sum(np.dtype(kind).itemsize for kind in exr_types(channels).values())
