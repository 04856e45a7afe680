"""TUM: rgb/, depth/, their lists, and settings for ORB-SLAM3.

And the same with images named by their stamps, for RTAB-Map.
"""

from dataclasses import replace
from pathlib import Path

from ...channels import DEPTH, RGB
from ...formats.depth_units import UNITS_PER_METRE
from ...formats.files import atomic_write_text
from ...formats.image_names import files_in
from .. import slam_settings
from ..contents import Contents
from ..format import FormatLimits, Reader, SequenceFormat
from ..frames import Row, SequenceFrame
from ..imu import write_imu
from ..metadata_lines import write_contents
from . import listed


def _write(folder: Path, contents: Contents, format: SequenceFormat) -> None:
    """Write lists, camera.json, groundtruth.txt, metadata.jsonl, settings for ORB-SLAM3, and the
    readings of an IMU.
    """
    listed.write_lists(folder, contents, format)
    listed.write_camera(folder, contents)
    write_contents(folder, contents, format)
    settings = slam_settings.orb_slam3(
        contents.camera, contents.rate_hz, contents.depth_units_per_metre
    )
    if contents.imu is not None:
        write_imu(folder, contents.imu)
        settings += slam_settings.orb_slam3_imu(contents.imu.stream)
    atomic_write_text(folder / "orb_slam3.yaml", settings)


FORMAT = SequenceFormat(
    "tum",
    "rgb/, depth/, their lists, associations.txt, groundtruth.txt, camera.json, metadata.jsonl, "
    "orb_slam3.yaml",
    lambda f, kind: f.paths.get(kind) or f"{kind}/{f.number:06}.png",
    _write,
    listed.READER,
    FormatLimits(imu=True),
    keeps_names=True,
)


def read_only(name: str, description: str, reader: Reader) -> SequenceFormat:
    """A format that is only read; what is made of it without a format is TUM's."""
    return replace(FORMAT, name=name, description=description, reader=reader, keeps_names=False)


def _by_stamp(folder: Path) -> list[Row]:
    """The pairs of the lists, else of images with near stamps."""
    if listed.found(folder):
        return listed.rows(folder)
    rgb, depth = (files_in(folder / f"{kind}_sync", "*.png") for kind in (RGB, DEPTH))
    return listed.paired_by_stamp(rgb, depth)


RTABMAP = SequenceFormat(
    "rtabmap",
    "the format tum with rgb_sync/, depth_sync/ and stamps as the images' names, as RTAB-Map's "
    "tool reads them",
    lambda f, kind: f"{kind}_sync/{f.stamp_name()}.png",
    _write,
    replace(listed.READER, found=lambda folder: (folder / "rgb_sync").is_dir(), rows=_by_stamp),
    FormatLimits(depth_stamps=False, zero_stamp=False, fixed_units=UNITS_PER_METRE, imu=True),
    list_stamp=SequenceFrame.stamp_name,
    published_image=lambda f, kind: f"{kind}_sync/{f.stamp_text()}.png",
)
