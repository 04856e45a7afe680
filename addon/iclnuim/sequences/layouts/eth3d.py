"""ETH3D SLAM: TUM's lists with images named by stamps, associated.txt, and calibration.txt with fx
fy cx cy on one line.

Pixel centres are at whole numbers; depth has 5000 units per metre
(https://www.eth3d.net/slam_documentation).
"""

from pathlib import Path

from ...formats.depth_units import UNITS_PER_METRE
from ...formats.files import atomic_write_text
from ..contents import Contents
from ..format import FormatLimits, SequenceFormat
from ..frames import SequenceFrame
from . import listed


def _write(folder: Path, contents: Contents, format: SequenceFormat) -> None:
    listed.write_lists(folder, contents, format, "associated.txt")
    c = contents.camera
    atomic_write_text(folder / "calibration.txt", f"{c.fx!r} {c.fy!r} {c.cx!r} {c.cy!r}\n")


FORMAT = SequenceFormat(
    "eth3d",
    "ETH3D SLAM: rgb/ and depth/ named by stamps, associated.txt, calibration.txt (fx fy cx cy), "
    "groundtruth.txt",
    lambda f, kind: f"{kind}/{f.stamp_name()}.png",
    _write,
    listed.READER,
    FormatLimits(fixed_units=UNITS_PER_METRE),
    list_stamp=SequenceFrame.stamp_name,
    published_image=lambda f, kind: f"{kind}/{f.stamp_text()}.png",
)
