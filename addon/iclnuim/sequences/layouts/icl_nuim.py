"""The format of the original: depth first with integer ids, left-handed anchored poses without
image 0, K with negative fy.
"""

import re
from pathlib import Path

import numpy as np

from ...channels import DEPTH, RGB
from ...errors import InputError
from ...formats.depth_units import UNITS_PER_METRE
from ...formats.files import atomic_write_text
from ...geometry.trajectory import FRAME_RATE_HZ, frames_of_stamps
from ..associations import Associations, write_associations
from ..contents import Contents, write_truth
from ..format import FormatLimits, SequenceFormat
from . import listed


def _write(folder: Path, contents: Contents, format: SequenceFormat) -> None:
    rgb, depth = (format.images(contents, kind) for kind in (RGB, DEPTH))
    pairs = Associations(rgb, depth, "icl-nuim")
    write_associations(folder / "associations.txt", pairs, "icl-nuim")
    c = contents.camera
    rows = ((c.fx, 0, c.cx), (0, -c.fy, c.cy), (0, 0, 1))
    calibration = [" ".join(f"{value:.6f}" for value in row) + "\n" for row in rows]
    atomic_write_text(folder / "calibration.txt", "".join(calibration))
    truth = contents.truth
    if truth is None:
        return
    numbers = np.rint(frames_of_stamps(truth.stamps_s))
    numbers = numbers[numbers >= 1]
    name = _name_of_truth(folder)
    if len(numbers):
        write_truth(folder / f"{name}.gt.freiburg", contents, "gt.freiburg")
    if len(numbers) and np.array_equal(numbers, np.arange(1, len(numbers) + 1)):
        write_truth(folder / f"{name}.gt.sim", contents, "gt.sim")


def _name_of_truth(folder: Path) -> str:
    """The name of the ground truth in a folder named as the official ones, where gradslam looks for
    it: livingRoom2n in living_room_traj2_frei_png.
    """
    official = re.fullmatch(r"(living_room_)?traj([0-3])n?_frei_png", folder.resolve().name)
    if official is None:
        return "groundtruth"
    return f"livingRoom{official[2]}n" if official[1] else f"traj{official[2]}n"


def _check(contents: Contents) -> None:
    units = contents.depth_units_per_metre
    if units != UNITS_PER_METRE:  # no file of this format contains the units
        expected = f"{UNITS_PER_METRE:g} depth units per metre for the format icl-nuim"
        raise InputError(expected, found=f"{units:g}")
    numbers = np.array([frame.number for frame in contents.frames])
    if np.abs(frames_of_stamps(contents.stamps_s) - numbers).max() > 0.01:
        stamps = f"stamps of whole frame numbers, 1 + number / {FRAME_RATE_HZ:g} s"
        expected = f"{stamps}, for the format icl-nuim"
        raise InputError(expected, found="other stamps", hint="the format tum")


FORMAT = SequenceFormat(
    "icl-nuim",
    "as the original: integer ids, depth first, left-handed *.gt.freiburg, calibration.txt",
    lambda f, kind: f"{kind}/{f.number:06}.png",
    _write,
    listed.READER,
    FormatLimits("ids", check=_check),
    keeps_names=True,
    published_image=lambda f, kind: f"{kind}/{f.number}.png",
)
