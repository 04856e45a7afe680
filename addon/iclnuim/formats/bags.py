"""ROS bags as input: files of ROS 1 (.bag), files (.mcap, .db3) and folders of ROS 2, read by the
optional package rosbags, without ROS.
"""

import os
import re
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ..errors import InputError, StrPath, WorkError

IMAGE = "sensor_msgs/msg/Image"
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
