"""ROS bags as input: files of ROS 1 (.bag), files (.mcap, .db3) and folders of ROS 2, read by the
optional package rosbags, without ROS. Which topics are the colour images, the depth images and
their camera is told by the types of messages, the encodings of the first images, and the coordinate
frames.
"""

import itertools
import os
import re
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ..errors import InputError, StrPath, WorkError
from .depth_units import check_units

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
IMU = "sensor_msgs/msg/Imu"
_INFO = "sensor_msgs/msg/CameraInfo"
#: Kinds of images by encoding, preferred ones first: 16-bit grey is depth where no other topic is.
_COLOURS = (("rgb8", "bgr8", "rgba8", "bgra8", "8UC3", "8UC4"), ("mono8", "8UC1"))
_DEPTHS = (("16UC1", "32FC1"), ("mono16",))
#: What the names of topics contain, if encodings do not decide.
_NAMES = {"colour": ("rgb", "color", "colour"), "depth": ("depth",)}
#: Infrared images have the encodings of depth.
_INFRARED = re.compile(r"(?<![a-z])(ir(?![a-z])|infra)", re.IGNORECASE)
_UNIT = "/option/Depth_Units/value"
_TRANSPORTS = ("/compressedDepth", "/compressed")
_FILES = (".bag", ".mcap", ".db3", ".active")
_STORAGES = ("*.mcap*", "*.db3*")
_DAMAGED = "`rosbag reindex` (ROS 1) or `ros2 bag reindex` (ROS 2), or copying the bag again"


def split_topics(path: StrPath) -> tuple[Path, tuple[str, ...]]:
    """The path of a bag, and the topics after it: X.bag:/camera/pose:/camera/depth."""
    text = os.fspath(path)
    found = re.search(r"(:/[^:]+)+$", text)
    if found is None or os.path.lexists(text):
        return Path(text), ()
    return Path(text[: found.start()]), tuple(found[0][1:].split(":"))


def is_bag(path: StrPath) -> bool:
    """Whether a path, which may end in topics, is a file named as a bag, or a folder that contains
    the files of one alone.
    """
    file = split_topics(path)[0]
    if not file.is_dir():
        return file.suffix.lower() in _FILES and file.is_file()
    stored = any(any(file.glob(pattern)) for pattern in _STORAGES)
    return stored and not any(child.is_dir() for child in file.iterdir())


def need_rosbags() -> None:
    """Raises WorkError without the package rosbags."""
    if find_spec("rosbags") is None:
        raise WorkError("bags need the package rosbags", hint="pip install rosbags")


class Bag:
    """A bag to be read. `path`: without the topics that `given` names. Opened as a context.

    Every method raises InputError for a damaged bag, because rosbags and the packages below it
    may raise anything then.
    """

    def __init__(self, path: StrPath) -> None:
        need_rosbags()
        self.path, self.given = split_topics(path)
        self._opened = ExitStack()

    def __enter__(self) -> "Bag":
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        with self._whole():
            store = get_typestore(Stores.ROS2_HUMBLE)  # for files without definitions of types
            self._reader = AnyReader([self.path], default_typestore=store)
            self._opened.enter_context(self._reader)
            #: type of messages by topic, without topics that have no message
            self.types = {c.topic: c.msgtype for c in self._reader.connections if c.msgcount}
        for topic in self.given:
            if topic not in self.types:
                self._opened.close()
                raise self.error(f"the topic {topic}", found=self.described(self.types))
        return self

    def __exit__(self, *error: object) -> None:
        self._opened.close()

    @contextmanager
    def _whole(self) -> Iterator[None]:
        try:
            yield
        except Exception as error:
            found = f"{type(error).__name__}: {error}"
            raise self.error("a whole ROS bag", found, hint=_DAMAGED) from None

    def error(self, expected: str, found: object, hint: str | None = None) -> InputError:
        return InputError(expected, path=self.path, found=found, hint=hint)

    def described(self, topics: Iterable[str]) -> str:
        """Topics with their types, in one line."""
        names = [f"{topic} ({self.types[topic].split('/')[-1]})" for topic in topics]
        return ", ".join(names) or "no messages"

    def topics_of(self, *types: str) -> list[str]:
        """The topics of these types."""
        return [topic for topic, type in self.types.items() if type in types]

    def only(self, topics: list[str], what: str) -> str:
        """The topic of a list, of several the given one. Raises InputError that names them if they
        are more.
        """
        topics = [topic for topic in topics if topic in self.given] or topics
        if len(topics) > 1:
            hint = f"{self.path}:{topics[0]}"
            raise self.error(f"one topic of {what}", self.described(topics), hint)
        return topics[0]

    def raw(self, topics: list[str]) -> Iterator[tuple[str, int, Any]]:
        """Topic, time of recording in nanoseconds, and serialized content of messages."""
        chosen = [c for c in self._reader.connections if c.topic in topics]
        if not chosen:  # rosbags would read all
            return
        found = self._reader.messages(chosen)
        while True:
            with self._whole():
                one = next(found, None)
            if one is None:
                return
            connection, time_ns, content = one
            yield connection.topic, time_ns, content

    def message(self, topic: str, content: Any) -> Any:
        """The message with this content. librealsense adds four bytes to images."""
        type = self.types[topic]
        if type == IMAGE and topic.startswith("/device_"):
            with suppress(Exception):
                return self._reader.deserialize(content[:-4], type)
        with self._whole():
            return self._reader.deserialize(content, type)

    def messages(self, topics: list[str]) -> Iterator[tuple[str, int, Any]]:
        """Topic, time of recording in nanoseconds, and message, in the order of recording."""
        for topic, time_ns, content in self.raw(topics):
            yield topic, time_ns, self.message(topic, content)

    def first(self, topic: str) -> Any:
        """The first message of a topic, read once."""
        if topic not in self._firsts:
            found = next(self.messages([topic]), None)
            if found is None:
                raise self.error(f"messages of {topic}", "none", _DAMAGED)
            self._firsts[topic] = found[2]
        return self._firsts[topic]

    def frame(self, topic: str) -> str:
        """The coordinate frame of a topic's first message. The number that librealsense gives
        instead is none: the name of the topic stands for it.
        """
        name = frame_of(self.first(topic).header.frame_id)
        return topic if name.isdecimal() else name

    @cached_property
    def _firsts(self) -> dict[str, Any]:
        return {}

    def count(self, topics: list[str]) -> int:
        """The number of messages of the topics."""
        return sum(c.msgcount for c in self._reader.connections if c.topic in topics)


def stamp_ns(header: Any, recorded_ns: int) -> int:
    """The stamp of a message in nanoseconds; the time of its recording if it has none (0)."""
    stamp: int = header.stamp.sec * 10**9 + header.stamp.nanosec
    return stamp or recorded_ns


def frame_of(name: str) -> str:
    """The name of a coordinate frame without the slash that older versions of ROS begin with."""
    return name.lstrip("/")


@dataclass(frozen=True)
class ImageTopics:
    """The topics of colour and depth, and of the camera of each (None without camera_info)."""

    colour: str
    depth: str
    colour_info: str | None
    depth_info: str | None


def image_topics(bag: Bag) -> ImageTopics:
    """The topics of the images. Raises InputError, with the topics, if none or several fit."""
    encodings = {topic: encoding_of(bag.first(topic)) for topic in bag.topics_of(IMAGE, COMPRESSED)}
    colours = _candidates(bag, encodings, "colour", _COLOURS)
    known = {topic: one for topic, one in encodings.items() if not _INFRARED.search(topic)}
    depths = _candidates(bag, known, "depth", _DEPTHS)
    pairs = list(itertools.product(colours, depths))
    together = [(c, d) for c, d in pairs if bag.frame(c) == bag.frame(d)]
    if len(together) == 1:
        colours = [together[0][0]]
        depths = [together[0][1]]
    colour = bag.only(colours, "colour images")
    depth = bag.only(depths, "depth images")
    return ImageTopics(colour, depth, _camera_of(bag, colour), _camera_of(bag, depth))


def encoding_of(image: Any) -> str:
    """The encoding of an image, of a JPEG or PNG that before compression. The whole text of its
    format for other compressed images, such as `16UC1; compressedDepth rvl`.
    """
    if hasattr(image, "encoding"):
        return str(image.encoding)
    encoding, _, how = image.format.partition(";")
    if re.search("jpe?g|png|compressedDepth$", how or encoding):
        return encoding.strip() if how else "rgb8"
    return str(image.format)


def depth_units(bag: Bag) -> float:
    """Units per metre of 16-bit depth: millimetres (ROS Enhancement Proposal 118), or the unit that
    librealsense has written.
    """
    for topic in bag.types:
        if topic.endswith(_UNIT):
            unit = str(bag.first(topic).data)
            try:
                return check_units(round(1 / float(unit), 3))
            except (ValueError, ZeroDivisionError, InputError):
                raise bag.error(f"metres per unit of depth in {topic}", unit) from None
    return 1000.0


def _candidates(
    bag: Bag, encodings: dict[str, str], what: str, kinds: tuple[tuple[str, ...], ...]
) -> list[str]:
    found: list[str] = []
    for kind in kinds:
        found = found or [topic for topic, encoding in encodings.items() if encoding in kind]
    if not found:
        others = [f"{topic} ({encoding})" for topic, encoding in encodings.items()]
        known = ", ".join(itertools.chain(*kinds))
        topics = ", ".join(others) or bag.described(bag.types)
        raise bag.error(f"a topic of {what} images ({known}, or those as JPEG or PNG)", topics)
    raw = [topic for topic in found if bag.types[topic] == IMAGE]
    found = [topic for topic in found if topic in raw or _without_transport(topic) not in raw]
    if len(found) == 1:
        return found
    named = [topic for topic in found if any(name in topic.lower() for name in _NAMES[what])]
    return [topic for topic in found if topic in bag.given] or named or found


def _without_transport(topic: str) -> str:
    for ending in _TRANSPORTS:
        topic = topic.removesuffix(ending)
    return topic


def _camera_of(bag: Bag, topic: str) -> str | None:
    """The topic of camera_info that shares most of its name with that of the images; of several
    those of the same coordinate frame.
    """
    parts = _without_transport(topic).split("/")
    shared: dict[str, int] = {}
    for info in bag.topics_of(_INFO):
        shared[info] = len(os.path.commonprefix([parts, info.split("/")]))
    nearest = [info for info, count in shared.items() if count == max(shared.values())]
    framed = [info for info in nearest if bag.frame(info) == bag.frame(topic)]
    if not nearest:
        return None
    return bag.only(framed or nearest, f"the camera of {topic}")
