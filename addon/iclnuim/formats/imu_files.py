"""The readings of an IMU as text, in the columns of EuRoC and VSLAM-LAB: nanoseconds, rotation rate
in rad/s, specific force in m/s^2.
"""

from pathlib import Path

import numpy as np

from ..errors import InputError
from .files import data_lines, read_text

EUROC = (
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n"
)
VSLAM_LAB = (
    "ts (ns),wx (rad s^-1),wy (rad s^-1),wz (rad s^-1),ax (m s^-2),ay (m s^-2),az (m s^-2)\n"
)
#: Written digits after the point: what a reading lacks moves nothing by a nanometre in ten seconds,
#: and the last bits of a processor do not show.
_DIGITS = 9


def imu_text(stamps_ns: np.ndarray, readings: np.ndarray, header: str = EUROC) -> str:
    """The text of stamps (n,) and readings (n, 6), below the names of a format's columns."""
    line = f"%d{f',%.{_DIGITS}f' * 6}\n"
    rows = (np.round(readings, _DIGITS) + 0.0).tolist()
    stamped = zip(stamps_ns.tolist(), rows, strict=True)
    return header + "".join(line % (stamp, *row) for stamp, row in stamped)


def read_imu(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Stamps (n,) in nanoseconds and readings (n, 6) of a file in these columns, of which further
    ones are not read.

    Raises InputError, with the line, for anything else.
    """
    lines = data_lines(read_text(path))
    if lines and lines[0][1][:1].isalpha():
        del lines[0]
    if not lines:
        raise InputError("readings of an IMU", path=path, found="none")
    stamps, rows = [], []
    for number, line in lines:
        stamp, *values = line.split(",")
        try:
            stamps.append(int(stamp))
            rows.append([float(value) for value in values[:6]])
        except ValueError:
            rows.append([])
        if len(rows[-1]) < 6 or not np.isfinite(rows[-1]).all() or not 0 <= stamps[-1] < 2**63:
            expected = "nanoseconds, and six finite numbers in rad/s and m/s^2, between commas"
            raise InputError(expected, path=path, line=number, found=line[:80])
        if len(stamps) > 1 and stamps[-1] <= stamps[-2]:
            raise InputError("increasing stamps", path=path, line=number, found=stamp)
    return np.array(stamps, np.int64), np.array(rows)
