"""A bag as a sequence: its images are unpacked once, into a folder of the cache with the lists, camera
and ground truth of a TUM sequence, which then is read.

Image messages are raw ones of sensor_msgs/Image, and JPEG and PNG of sensor_msgs/CompressedImage,
also those of compressed_depth_image_transport.
"""

import os
import shutil
import struct
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..channels import DEPTH, RGB
from ..console import Meter, advance_of
from ..errors import InputError, WorkError, within
from ..formats.bags import (
    Bag,
    ImageTopics,
    depth_units,
    encoding_of,
    image_topics,
    is_bag,
    split_topics,
    stamp_ns,
)
from ..formats.depth_units import UNITS_PER_METRE, metres_from_depth16
from ..formats.files import (
    locked,
    make_folder,
    not_written,
    read_json,
    sha256,
    whole_folder,
    write_json,
)
from ..formats.images import JPEG, image_header, read_colour8, seen_by, write_array
from ..formats.png import read_depth16, write_png
from ..geometry.camera import PinholeCamera
from ..shipped import cache_folder
from ..trajectory_files.bag_poses import NoPosesError
from ..trajectory_files.stamps import stamp_text_of_ns
from ..trajectory_files.trajectories import read_trajectory, write_trajectory
from ..version import __version__
from .associations import ImageList, write_image_list
from .bag_imu import bag_imu
from .camera_files import CAMERA, DISTORTED, SequenceCamera, camera_file
from .format import Reader
from .frames import Row
from .imu import SequenceImu, read_imu_files, write_imu
from .layouts import listed, tum

_NOTES = "bag.json"
_TRUTH = "groundtruth.txt"
#: What is unpacked: folders of the cache with less are not used.
_CONTENT = "images, poses, IMU"
#: Encoding -> type of a value, number of channels, and the channels of R, G and B or of depth.
_RGB = (0, 1, 2)
_BGR = (2, 1, 0)
_ENCODINGS: dict[str, tuple[str, int, tuple[int, ...]]] = {
    "rgb8": ("u1", 3, _RGB),
    "rgba8": ("u1", 4, _RGB),
    "bgr8": ("u1", 3, _BGR),
    "8UC3": ("u1", 3, _BGR),
    "bgra8": ("u1", 4, _BGR),
    "8UC4": ("u1", 4, _BGR),
    "mono8": ("u1", 1, (0, 0, 0)),
    "8UC1": ("u1", 1, (0, 0, 0)),
    "16UC1": ("u2", 1, (0,)),
    "mono16": ("u2", 1, (0,)),
    "32FC1": ("f4", 1, (0,)),
}
_MAX_PIXELS = 1 << 28
#: compressed_depth_image_transport: an enumeration and the quantisation a, b of 32-bit depth,
#: whose 16-bit values are a / depth + b.
_DEPTH_HEADER = struct.Struct("<iff")


def unpacked(path: Path, progress: Meter = None) -> tuple[Path, list[str]]:
    """The folder with the images of a bag, unpacked if it does not exist, and sentences on how the
    bag was read. `path` may end in topics: X.bag:/camera/depth/image. progress: as of
    render_frames().

    Raises InputError for a bag without colour and depth images, WorkError if the folder cannot be
    written.
    """
    file, topics = split_topics(path)
    state = [(one.name, one.stat().st_size, one.stat().st_mtime_ns) for one in _files(file)]
    identity = repr((__version__, _CONTENT, os.path.realpath(file), topics, state))
    key = sha256(identity.encode())
    folder = cache_folder() / "bags" / f"{file.name}-{key[:12]}"
    make_folder(folder.parent)
    if not folder.is_dir():
        with locked(folder.parent, wait=True):
            if not folder.is_dir():
                _unpack(path, folder, progress)
    return folder, read_json(folder / _NOTES)["notes"]


def _unpack(path: Path, folder: Path, progress: Meter) -> None:
    try:
        with whole_folder(folder) as new, Bag(path) as bag:
            _Unpacking(bag, image_topics(bag), new).run(progress)
            _write_truth(path, new)
    except OSError as error:
        raise not_written(folder, error) from None


def _files(bag: Path) -> list[Path]:
    return sorted(bag.iterdir()) if bag.is_dir() else [bag]


@dataclass
class _Unpacking:
    """A bag being unpacked into `folder`. `written`: the images by stamp in nanoseconds; `sizes`:
    the bytes that all images of a kind will need.
    """

    bag: Bag
    topics: ImageTopics
    folder: Path
    written: dict[str, dict[int, Path]] = field(default_factory=lambda: {RGB: {}, DEPTH: {}})
    sizes: dict[str, int] = field(default_factory=dict)
    unreadable: list[str] = field(default_factory=list)
    unstamped: int = 0
    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    @cached_property
    def units(self) -> float:
        """Depth units per metre: of 16-bit images; where depth is in metres, our usual ones."""
        if encoding_of(self.bag.first(self.topics.depth)) == "32FC1":
            return UNITS_PER_METRE
        return depth_units(self.bag)

    def run(self, progress: Meter) -> None:
        """Write images, lists, camera and notes. Raises InputError without an image of a kind."""
        kinds = {self.topics.colour: RGB, self.topics.depth: DEPTH}
        total = self.bag.count(list(kinds))
        done = advance_of(progress, total, f"reading {self.bag.path}", "images")
        for kind in self.written:
            (self.folder / kind).mkdir()
        for topic, time_ns, message in self.bag.messages(list(kinds)):
            self._save(kinds[topic], time_ns, message)
            done()
        for kind, images in self.written.items():
            if not images:
                found = (self.unreadable or ["none"])[0]
                raise self.bag.error(f"{kind} images that can be read", found)
        self._note_topics()
        self._write_camera()
        for kind, images in self.written.items():
            self._write_list(kind, images)
        self._write_imu()
        write_json(self.folder / _NOTES, {"notes": self.notes, "warnings": self.warnings})

    def _save(self, kind: str, time_ns: int, message: Any) -> None:
        stamp = stamp_ns(message.header, time_ns)
        self.unstamped += message.header.stamp.sec == message.header.stamp.nanosec == 0
        place = self.folder / kind / stamp_text_of_ns(stamp)
        try:
            if kind == RGB:
                image = save_colour(message, place)
            else:
                image = save_depth(message, place, self.units)
        except InputError as error:
            for left in place.parent.glob(f"{place.name}.*"):
                left.unlink()
            what = InputError(error.expected, found=error.found)
            self.unreadable.append(f"{kind} of {place.name} s: {what}")
            return
        self.written[kind][stamp] = image
        if kind not in self.sizes:
            self._check_space(kind, image)

    def _check_space(self, kind: str, image: Path) -> None:
        """Raises WorkError if the disk has no space for as many images like the first ones."""
        topic = {RGB: self.topics.colour, DEPTH: self.topics.depth}[kind]
        self.sizes[kind] = image.stat().st_size * self.bag.count([topic])
        needed = sum(self.sizes.values())
        free = shutil.disk_usage(self.folder).free
        if needed > free:
            where = f"{self.bag.path} unpacked in {self.folder.parent}"
            text = f"{where} needs {needed / 1e9:.1f} GB, and {free / 1e9:.1f} GB are free"
            raise WorkError(text, hint="ICLNUIM_CACHE=FOLDER on another disk")

    def _write_camera(self) -> None:
        """Write the camera of the depth images, if there is a camera_info, and see colour as it
        does. Depth of the frame and the size of colour is registered to it, and has its camera.
        """
        topics = self.topics
        depth = self._camera(topics.depth, topics.depth_info)
        colour = self._camera(topics.colour, topics.colour_info) or depth
        depth = depth or colour
        if depth is None or colour is None:
            return
        if self._registered and (colour.width, colour.height) == (depth.width, depth.height):
            if colour != depth:
                self.warnings.append(
                    "the camera_info of depth differs from that of colour, which is used"
                )
            depth = colour
        write_json(self.folder / CAMERA, SequenceCamera(depth, self.units).to_dict())
        if colour != depth:
            self.notes.append("colour is resampled to the camera of the depth images")
            for stamp, path in self.written[RGB].items():
                self.written[RGB][stamp] = _resampled(path, colour, depth)

    @cached_property
    def _registered(self) -> bool:
        return self.bag.frame(self.topics.colour) == self.bag.frame(self.topics.depth)

    def _camera(self, topic: str, info_topic: str | None) -> PinholeCamera | None:
        """The camera of images: of rectified ones P, of others K. None if it was not calibrated."""
        if info_topic is None:
            return None
        info = self.bag.first(info_topic)
        rectified = "rect" in topic
        name = "p" if rectified else "k"
        matrix = np.reshape(_entry(info, name), (3, -1))
        if matrix[0, 0] == 0:
            return None
        if not rectified and np.any(_entry(info, "d")) and DISTORTED not in self.warnings:
            self.warnings.append(DISTORTED)
        numbers = (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
        with within(f"{self.bag.path}:{info_topic}"):
            return PinholeCamera(info.width, info.height, *map(float, numbers))

    def _note_topics(self) -> None:
        bag = self.bag
        encoding = encoding_of(bag.first(self.topics.depth))
        unit = "metres" if encoding == "32FC1" else f"{self.units:g} units per metre"
        cameras = {self.topics.colour_info, self.topics.depth_info} - {None}
        infos = " and ".join(sorted(map(str, cameras))) or "of no topic"
        colour = f"colour {self.topics.colour} ({encoding_of(bag.first(self.topics.colour))})"
        depth = f"depth {self.topics.depth} ({encoding}, {unit})"
        self.notes.append(f"{colour}, {depth}, camera {infos}")
        if not self._registered:
            frames = [bag.frame(topic) for topic in (self.topics.colour, self.topics.depth)]
            self.warnings.append(
                f"the frames of colour and depth differ ({' and '.join(frames)}): depth is not "
                "registered to colour, and both are read as of one place"
            )
        if self.unstamped:
            self.warnings.append(
                f"{self.unstamped} images without a stamp get that of their recording"
            )
        if self.unreadable:
            self.warnings.append(f"{len(self.unreadable)} images left out: {self.unreadable[0]}")

    def _write_imu(self) -> None:
        found = bag_imu(self.bag, self.bag.frame(self.topics.depth))
        self.notes += found.notes
        self.warnings += found.warnings
        if found.imu is not None:
            write_imu(self.folder, found.imu)

    def _write_list(self, kind: str, images: dict[int, Path]) -> None:
        stamps = sorted(images)
        texts = tuple(map(stamp_text_of_ns, stamps))
        paths = tuple(f"{kind}/{images[stamp].name}" for stamp in stamps)
        list_of_kind = ImageList(tuple(map(float, texts)), paths, texts)
        write_image_list(self.folder / f"{kind}.txt", list_of_kind)


def _entry(info: Any, name: str) -> Any:
    """An array of a camera_info, whose name is upper-case in ROS 1."""
    return getattr(info, name, None) if hasattr(info, name) else getattr(info, name.upper())


def _resampled(path: Path, own: PinholeCamera, other: PinholeCamera) -> Path:
    """Replace a colour image by what another camera at the same place sees. Returns its path."""
    image = seen_by(read_colour8(path), own.K, other.K, other.width, other.height)
    path.unlink()
    write_png(path.with_suffix(".png"), image)
    return path.with_suffix(".png")


def _write_truth(path: Path, folder: Path) -> None:
    """Write the poses of a bag, if it has any, and how they were read."""
    notes = read_json(folder / _NOTES)
    try:
        loaded = read_trajectory(path, "rosbag")
        write_trajectory(folder / _TRUTH, loaded.trajectory, "tum")
        notes["notes"].append(loaded.read_as.sentence)
    except NoPosesError as error:
        notes["notes"] += [str(error)] if error.moves_others else []
    except InputError as error:
        notes["refused"] = True
        notes["notes"].append(str(error))
    write_json(folder / _NOTES, notes)


def _rows(path: Path) -> list[Row]:
    return listed.rows(unpacked(path)[0])


def _camera(path: Path, image: Path) -> SequenceCamera | None:
    folder = unpacked(path)[0]
    camera = camera_file(folder)
    return camera and replace(camera, notes=tuple(read_json(folder / _NOTES)["warnings"]))


def _truth(path: Path) -> Path | None:
    """The poses of the bag; the bag itself if it does not say which they are, whose reader then
    raises the error.
    """
    folder = unpacked(path)[0]
    return path if read_json(folder / _NOTES).get("refused") else listed.truth(folder)


def _imu(path: Path) -> SequenceImu | None:
    return read_imu_files(unpacked(path)[0])


def save_colour(message: Any, place: Path) -> Path:
    """Write a colour image as `place`.png, or as it is compressed. Returns the path.

    Raises InputError for an image that cannot be read.
    """
    if hasattr(message, "encoding"):
        path = place.with_name(place.name + ".png")
        write_png(path, np.ascontiguousarray(_pixels(message, 3)))
        return path
    data = message.data.tobytes()
    path = place.with_name(place.name + (".png" if data.startswith(b"\x89PNG") else JPEG))
    path.write_bytes(data)
    image_header(path, whole=True)
    return path


def save_depth(message: Any, place: Path, units_per_metre: float) -> Path:
    """Write a depth image as `place`.npy in metres, 0 = missing. Returns the path.
    `units_per_metre` of 16-bit depth.

    Raises InputError for an image that cannot be read.
    """
    path = place.with_name(place.name + ".npy")
    if hasattr(message, "encoding"):
        depth = _pixels(message, 1)[..., 0]
        depth_m = depth if depth.dtype.kind == "f" else metres_from_depth16(depth, units_per_metre)
    else:
        scratch = place.with_name(place.name + ".png")
        depth_m = _decompressed(message, scratch, units_per_metre)
    write_array(path, np.where(np.isfinite(depth_m) & (depth_m > 0), depth_m, 0))
    return path


def _pixels(image: Any, wanted: int) -> np.ndarray:
    """(h, w, wanted channels) of a raw image, whose rows may be padded."""
    kind, channels, order = _ENCODINGS.get(image.encoding, ("", 0, ()))
    if len(order) != wanted:
        raise InputError("the encoding of the first image", found=image.encoding)
    row_bytes = image.width * channels * int(kind[1])
    height = image.height
    step = image.step
    pixels = height * image.width
    whole = row_bytes <= step and height * step <= len(image.data)
    if not 0 < pixels <= _MAX_PIXELS or not whole:
        found = f"{len(image.data)} bytes, {step} in a row"
        raise InputError(f"{image.width} x {height} pixels of {image.encoding}", found=found)
    rows = image.data[: height * step].reshape(height, step)[:, :row_bytes]
    values = np.ascontiguousarray(rows).view((">" if image.is_bigendian else "<") + kind)
    return values.reshape(height, image.width, channels)[..., order]


def _decompressed(message: Any, scratch: Path, units_per_metre: float) -> np.ndarray:
    """Metres (h, w) of a compressed depth image; `scratch`: a path for its PNG."""
    data = message.data.tobytes()
    a = b = 0.0
    if "compressedDepth" in message.format:
        if len(data) < _DEPTH_HEADER.size:
            raise InputError("a compressed depth image", found=f"{len(data)} bytes")
        _, a, b = _DEPTH_HEADER.unpack_from(data)
        data = data[_DEPTH_HEADER.size :]
    scratch.write_bytes(data)
    values = read_depth16(scratch)
    scratch.unlink()
    if not message.format.startswith("32FC1"):
        return metres_from_depth16(values, units_per_metre)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth_m = np.float32(a) / (values.astype(np.float32) - np.float32(b))
    return np.where(values > 0, depth_m, 0)


#: Read only; images of a bag have no names to keep.
FORMAT = tum.read_only(
    "rosbag", "ROS bags, which are unpacked", Reader(is_bag, _rows, _camera, _truth, imu=_imu)
)
