"""Which topics of a bag are the colour images, the depth images and their camera: by the types of
their messages, the encodings of the first images, and the coordinate frames.
"""

import itertools
import os
import re
from dataclasses import dataclass
from typing import Any

from ..errors import InputError
from .bags import IMAGE, Bag
from .depth_units import check_units

COMPRESSED = "sensor_msgs/msg/CompressedImage"
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
