"""The registry of trajectory formats: detected by name and content, read, and for most formats
written.

All formats have one pose per line or block and are described by their columns. A new format is one
entry of FORMATS; the command line, the panel and the documentation list these entries.
"""

import os
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal

import numpy as np

from ..errors import InputError
from ..geometry import axes
from ..geometry.se3 import SE3
from ..geometry.trajectory import FRAME_RATE_HZ, Trajectory
from . import colmap, pose_folders, pov, trajectory_file
from .files import atomic_write_text, data_lines
from .trajectory_file import (
    OUR_WORLD,
    OWN_WORLD,
    FileOptions,
    LoadedTrajectory,
    ReadAs,
    Source,
    Table,
    read_table,
)

__all__ = ["ANCHORED_WORLD", "FORMATS", "TUM_HEADER", "FileOptions", "LoadedTrajectory", "ReadAs"]
__all__ += ["format_for_name", "read_trajectory", "trajectory_text", "write_trajectory"]

ANCHORED_WORLD = "the original's anchored frame made right-handed (the first camera's axes: x right, y down, z forward)"
#: Start of the official files: living room, office. Office kt0, whose first image is missing,
#: starts 9 mm away.
OFFICIAL_STARTS_Z_M = (-2.25, -2.5)
START_TOLERANCE_M = 0.02

#: Stamps or frame numbers (None if a format has none), and poses.
Given = tuple[Iterable | None, SE3]
#: Columns of the position, and of the orientation.
Columns = tuple[Sequence[int], Sequence[int]]


@dataclass(frozen=True)
class TrajectoryFormat:
    """A trajectory format: its columns, and the meaning of the stamps and poses in them.

    sniff: whether a file has this format. sentence: how a file was read; {rate} is replaced by the
    frame rate, {how} by the result of `how`. expected: description of a line, for errors. counts:
    allowed numbers of columns of a line; if 12 or 13 are allowed, the first of 13 is the frame
    number. columns: the columns of x y z, and of qx qy qz qw or r00 r01 ... r22. A column before
    them contains stamps with `ticks` per second (unless the rows set another number), or frame
    numbers if both are None. Without such a column, lines are counted from `first`. hint: for the
    error of invalid frame numbers. frame: the function that converts the file's poses to
    right-handed cv camera poses (None if they are that already), and the world of the trajectory.
    handedness: of the file's poses; default: left if `frame` has a function, else right. inverse:
    the file's poses are world to camera. rows: reads the columns of a file whose lines are not
    simple rows.

    Writing: line: a printf format of all columns in order; "" if the format is only read. given:
    stamps or frame numbers (None if the format has none), and poses to write. header: may contain
    {unit} or {symbol} of the positions. goes_to: description of the written file. endings, word:
    file names that select this format: endings, or a word in the name of a file that ends in
    `texts`.
    """

    name: str
    sniff: Callable[[Source], bool]
    sentence: str
    expected: str = "8 columns: timestamp tx ty tz qx qy qz qw"
    counts: tuple[int, ...] = (8,)
    columns: Columns = ((1, 2, 3), (4, 5, 6, 7))
    ticks: float | None = None
    first: int = 0
    hint: str | None = None
    frame: tuple[Callable[[SE3], SE3] | None, str] = (None, OWN_WORLD)
    handedness: str = ""
    inverse: bool = False
    rows: Callable[[Source], Table] | None = None
    how: Callable[[Source, Table, Trajectory], str] = lambda source, table, trajectory: ""
    line: str = ""
    given: Callable[[Trajectory, FileOptions], Given] = lambda t, options: (None, t.T_world_camera)
    header: str = ""
    parted: str = ""
    goes_to: str = ""
    endings: tuple[str, ...] = ()
    word: str = ""
    texts: tuple[str, ...] = (".txt",)

    def read(self, source: Source, options: FileOptions) -> LoadedTrajectory:
        """Read a file in this format. Raises InputError with the line for invalid content."""
        table = self.rows(source) if self.rows else read_table(source, self.counts, self.expected)
        numbered = table.values.shape[1] == 13
        position, orientation = ([c + numbered for c in columns] for columns in self.columns)
        poses = trajectory_file.poses_of(
            table, table.values[:, position] * options.unit_m, orientation
        )
        poses = poses.inverse() if self.inverse else poses
        right, world = self.frame
        counted = np.arange(len(poses)) + float(self.first)
        stamps = counted if 0 in (*position, *orientation) else table.values[:, 0]
        ticks = table.ticks or self.ticks
        stamps_s, rows = trajectory_file.seconds_of(
            table, stamps, ticks, options.rate_hz, self.hint
        )
        trajectory = Trajectory(stamps_s, (right(poses) if right else poses)[rows])
        sentence = self.sentence.format(
            rate=f"{options.rate_hz:g}", how=self.how(source, table, trajectory)
        )
        if repeated := len(poses) - len(rows):
            sentence += f"; {repeated} repeated stamp{'s' * (repeated > 1)} left out"
        handedness = self.handedness or ("left" if right else "right")
        return LoadedTrajectory(
            trajectory, ReadAs(self.name, handedness, world, sentence, repeated)
        )

    def write(self, trajectory: Trajectory, options: FileOptions) -> str:
        """The text of a file in this format.

        Raises InputError if the format cannot represent the trajectory.
        """
        stamps, poses = self.given(trajectory, options)
        position, orientation = self.columns
        quaternions = len(orientation) == 4
        columns = np.zeros((len(poses), max(*position, *orientation) + 1))
        columns[:, orientation] = poses.quat_xyzw if quaternions else poses.rotation.reshape(-1, 9)
        columns[:, position] = poses.translation / options.unit_m
        rows = (
            columns[:, 0 not in (*position, *orientation) :] + 0.0
        ).tolist()  # adding 0.0 changes -0.0 to 0.0
        if stamps is None:
            lines = [self.line % tuple(row) for row in rows]
        else:
            lines = [self.line % (stamp, *row) for stamp, row in zip(stamps, rows, strict=True)]
        return self._header(options.unit_m) + self.parted.join(lines)

    def _header(self, unit_m: float) -> str:
        """The header for positions in a unit of so many metres."""
        long, short = _UNITS.get(unit_m, (f"units of {unit_m:g} m", f"{unit_m:g} m"))
        return self.header.format(unit=long, symbol=short)


def read_trajectory(
    path: str | os.PathLike[str],
    format: str | None = None,
    *,
    rate_hz: float = FRAME_RATE_HZ,
    unit_m: float = 1.0,
) -> LoadedTrajectory:
    """Read a right-handed trajectory of cv camera poses (camera to world, metres), and how the file
    was read.

    `format` is a name of FORMATS; without it, the format is detected by name and content. `rate_hz`
    is used if a file has frame numbers. `unit_m` is the file's unit of length in metres (0.01 for
    the office's POV-Ray files).

    Raises InputError with file and line for a file that cannot be read.
    """
    options, source = FileOptions(rate_hz, unit_m), Source(path)
    return (_known(format) if format else _sniffed(source)).read(source, options)


def write_trajectory(
    path: str | os.PathLike[str],
    trajectory: Trajectory,
    format: str,
    options: FileOptions | None = None,
) -> None:
    """Write a trajectory file atomically.

    Raises InputError if the format cannot represent the trajectory.
    """
    atomic_write_text(path, trajectory_text(trajectory, format, options))


def trajectory_text(trajectory: Trajectory, format: str, options: FileOptions | None = None) -> str:
    """The text that write_trajectory writes."""
    if not _known(format).line:
        writable = ", ".join(name for name, known in FORMATS.items() if known.line)
        raise InputError(f"a format that can be written ({writable})", found=format)
    trajectory_file.check_writable(trajectory)
    return FORMATS[format].write(trajectory, options or FileOptions())


def _sniffed(source: Source) -> TrajectoryFormat:
    """The format of a file or folder. Raises InputError if it is not recognised."""
    for format in FORMATS.values():
        if format.sniff(source):
            return format
    expected = (
        "a trajectory: 8 columns (TUM), 12, 13 or 16 (matrix rows), blocks of 3 lines with 4, POV-Ray commands, CSV or "
        "COLMAP's images.txt"
    )
    if not source.columns:
        raise InputError(expected, path=source.path, found="comments alone")
    found, line = f"{source.columns} columns", data_lines(source.text)[0][0]
    raise InputError(expected, path=source.path, line=line, found=found, hint="{from} FORMAT")


def format_for_name(path: str | os.PathLike[str]) -> str:
    """The format of a file to be written, by its name.

    Raises InputError if no format has such names.
    """
    name = os.path.basename(os.fspath(path)).lower()
    for format, known in FORMATS.items():
        if name.endswith(known.endings) or (
            known.word and known.word in name and name.endswith(known.texts)
        ):
            return format
    endings = ".tum, .txt, .csv, .kitti, .gt.freiburg or .gt.sim"
    found = os.path.splitext(name)[1] or "no ending"
    raise InputError(f"a name ending in {endings}", path=path, found=found, hint="{to} FORMAT")


def _known(format: str) -> TrajectoryFormat:
    if format not in FORMATS:
        raise InputError(f"a trajectory format ({', '.join(FORMATS)})", found=format)
    return FORMATS[format]


def is_freiburg(source: Source) -> bool:
    """Whether a file is named `*.gt.freiburg`, or has frame ids and starts like the official files,
    unless its header contains "right-handed".

    No other file is read as left-handed: poses do not show their handedness, and whole-number
    stamps alone are not sufficient.
    """
    if source.name.endswith(".gt.freiburg"):
        return True
    if source.columns != 8 or "right-handed" in source.header:
        return False
    try:
        rows = [[float(field) for field in line.split()[:4]] for line in source.first_lines]
    except ValueError:
        return False
    return all(row[0].is_integer() for row in rows) and starts_as_official(np.array(rows[0][1:]))


def starts_as_official(position_m: np.ndarray) -> bool:
    """Whether a first position (3,) is that of the official living-room or office files, within 2
    cm on each axis.
    """
    return any(
        np.abs(position_m - (0.0, 0.0, z)).max() <= START_TOLERANCE_M for z in OFFICIAL_STARTS_Z_M
    )


def _anchored(trajectory: Trajectory, anchor: int, options: FileOptions) -> tuple[list[int], SE3]:
    """n frame numbers, starting at 1 or later, and their left-handed poses, with the pose of image
    `anchor` at (0, 0, start_z_m).

    T(i) = [I, (0, 0, start)] T_pov(anchor)^-1 T_pov(i). If image `anchor` is missing, the first
    written image is used instead. Poses that already start like the official files are not moved.
    """
    numbers = trajectory_file.frame_numbers(trajectory.stamps_s, options.rate_hz)
    kept = numbers >= 1
    if not kept.any():
        raise InputError(
            "poses of image 1 or later (image 0 has none in this format)", found="image 0 alone"
        )
    T = trajectory.T_world_camera
    shown = T[kept]
    if not starts_as_official(shown.translation[0]):
        at_anchor = np.flatnonzero(numbers == anchor)
        reference = T[int(at_anchor[0])] if at_anchor.size else shown[0]
        shown = (
            SE3(np.eye(3), np.array([0.0, 0.0, options.start_z_m])) @ reference.inverse() @ shown
        )
    return numbers[kept].tolist(), axes.mirrored_y(shown)


def _given_sim(trajectory: Trajectory, options: FileOptions) -> Given:
    """Left-handed poses without numbers.

    Raises InputError if frames are missing, because blocks have no frame number.
    """
    numbers, left = _anchored(trajectory, 0, options)
    if numbers[-1] != len(numbers):
        found = f"{len(numbers)} frames up to {numbers[-1]}"
        raise InputError("frames 1, 2, 3, ... without a gap to write gt.sim", found=found)
    return None, left


def _given_ns(trajectory: Trajectory, options: FileOptions) -> Given:
    """Stamps in nanoseconds, computed from the shortest decimal text of each stamp, and the poses."""
    stamps = [round(Decimal(repr(stamp_s)) * 10**9) for stamp_s in trajectory.stamps_s.tolist()]
    return stamps, trajectory.T_world_camera


def _given_pov(trajectory: Trajectory, options: FileOptions) -> Given:
    poses = axes.pov_from_world_cv(trajectory.T_world_camera)
    return trajectory_file.frame_numbers(trajectory.stamps_s, options.rate_hz).tolist(), poses


def _blocks(source: Source) -> Table:
    """(n, 12). Raises InputError for the first block that is not on three consecutive lines."""
    lines = read_table(source, (4,), _BLOCKS)
    numbers = [number for number, _ in data_lines(source.text)]
    for k in range(0, len(numbers), 3):
        if numbers[k : k + 3] != [numbers[k], numbers[k] + 1, numbers[k] + 2]:
            raise InputError(
                _BLOCKS, path=source.path, line=numbers[k], found="a block of another length"
            )
    return Table(lines.values.reshape(-1, 12), lambda k: (source.path, numbers[3 * k]))


def _tum_rows(source: Source) -> Table:
    """(n, 8); the stamps may be in nanoseconds, as in ORB-SLAM3's files for EuRoC."""
    table = read_table(source, (8,), TrajectoryFormat.expected)
    return replace(table, ticks=trajectory_file.stamp_ticks(table.values[:, 0]))


def _square_rows(source: Source) -> Table:
    """(n, 16). Raises InputError for a line that does not end in 0 0 0 1."""
    table = read_table(source, (16,), _SQUARE_ROW)
    wrong = np.flatnonzero(np.abs(table.values[:, 12:] - (0, 0, 0, 1)).max(axis=1) > 1e-6)
    if wrong.size:
        found = " ".join(f"{value:g}" for value in table.values[wrong[0], 12:])
        raise table.error(wrong[0], f"{_SQUARE_ROW}, ending in 0 0 0 1", found)
    return table


def _commented_first(source: Source) -> Source:
    """The same source with its first line of data, which contains the names of the columns, made a
    comment. Raises InputError without it.
    """
    number, names = next(iter(data_lines(source.text)), (0, ""))
    if not names.lower().startswith(_VSLAM_LAB_STAMP):
        found = names or "comments alone"
        raise InputError(
            f"the header {_VSLAM_LAB_STAMP}...", path=source.path, line=number or None, found=found
        )
    lines = source.text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    lines[number - 1] = "#" + lines[number - 1]
    return source.with_text("\n".join(lines))


def _vslam_lab_rows(source: Source) -> Table:
    """(n, 8) values of VSLAM-LAB's groundtruth.csv."""
    return read_table(_commented_first(source), (8,), _VSLAM_LAB, ",")


def _euroc_rows(source: Source) -> Table:
    """(n, 8) or (n, 17).

    Raises InputError for stamps that are not whole nanoseconds, and for names of columns that have
    qw last.
    """
    if re.search(r"q\w*x\b.*q\w*w\b", source.header):
        found = source.header.strip().splitlines()[-1]
        raise InputError(
            "columns qw, qx, qy, qz, as in EuRoC", path=source.path, found=found, hint=_NO_COMMAS
        )
    table = read_table(source, (8, 17), _EUROC_ROW, ",")
    parts = np.flatnonzero(table.values[:, 0] != np.rint(table.values[:, 0]))
    if parts.size:
        stamp = f"{table.values[parts[0], 0]:.12g}"
        raise table.error(parts[0], "stamps in whole nanoseconds, as in EuRoC", stamp, _NO_COMMAS)
    steps = np.diff(table.values[:, 0])
    if steps.size and abs(usual := float(np.median(steps))) < trajectory_file.SHORTEST_STEP_NS:
        found = f"stamps {usual:.12g} apart, as of frame numbers or seconds"
        raise table.error(0, "stamps in nanoseconds, as in EuRoC", found, _NO_COMMAS)
    return table


def _is_tartanair(source: Source) -> bool:
    """Whether the first line has seven numbers that end in a unit quaternion."""
    if source.columns != 7 or not source.starts_with_numbers:
        return False
    return bool(
        abs(np.linalg.norm([float(field) for field in source.first_lines[0].split()[3:]]) - 1)
        < 0.01
    )


def _numbering(source: Source, table: Table, trajectory: Trajectory) -> str:
    """The unit of a table's first column: frames, seconds or nanoseconds."""
    return {None: "frames", 1.0: "seconds"}.get(table.ticks, "nanoseconds")


def _tum_stamps(source: Source, table: Table, trajectory: Trajectory) -> str:
    """The unit of the stamps and the world; for whole seconds, a note that they may be frame
    numbers.
    """
    text = f"{_numbering(source, table, trajectory)}, right-handed camera-to-world poses in {OWN_WORLD}"
    stamps_s = trajectory.stamps_s
    if table.ticks == 1.0 and len(stamps_s) > 1 and (stamps_s == np.rint(stamps_s)).all():
        text += "; its whole numbers are read as seconds (the format tum-ids reads them as frame numbers)"
    return text


def _why_freiburg(source: Source, table: Table, trajectory: Trajectory) -> str:
    named = source.name.endswith(".gt.freiburg")
    return "by its name" if named else "by its start" if is_freiburg(source) else "as requested"


def _unit_warning(source: Source, table: Table, trajectory: Trajectory) -> str:
    """A warning for a POV-world file whose positions are probably in centimetres, else an empty
    text.
    """
    far_m = np.abs(trajectory.positions_m).max()
    far = far_m > trajectory_file.FAR_M
    return f"; positions reach {far_m:.0f} m: they may be centimetres (unit cm)" if far else ""


def _counted(source: Source, table: Table, trajectory: Trajectory) -> str:
    """The origin of the frame numbers of commands, and the warning about units."""
    counted = "of the image's name" if table.values.shape[1] == 13 else "of the line, from 0"
    return counted + _unit_warning(source, table, trajectory)


#: Names and symbols of units in metres, for headers.
_UNITS = {1.0: ("metres", "m"), 0.01: ("centimetres", "cm"), 0.001: ("millimetres", "mm")}
_TUM_HEADER = "# timestamp tx ty tz qx qy qz qw; seconds, {unit}, right-handed, camera (x right, y down, z forward) to world\n"
TUM_HEADER = _TUM_HEADER.format(unit="metres")
_EUROC_ROW = "8 or 17 columns separated by commas: stamp in ns, x, y, z, qw, qx, qy, qz"
#: A table of TUM's columns with commas has another order of the quaternion, and other stamps.
_NO_COMMAS = "blanks instead of commas, for a TUM file"
_EUROC_HEADER = "#timestamp [ns],p_RS_R_x [{symbol}],p_RS_R_y [{symbol}],p_RS_R_z [{symbol}],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n"
_POV_HEADER = (
    "# frame r00 r01 r02 tx r10 r11 r12 ty r20 r21 r22 tz ; T_pov_cam, LEFT-handed POV-Ray world (y up), "
    "camera x right y up z forward, {unit}\n"
)
#: The columns of the position and of r00 r01 ... r22 in the rows of a 3x4 matrix, and in val00
#: val01 ... val32 of POV-Ray.
_MATRIX_COLUMNS: Columns = (3, 7, 11), (0, 1, 2, 4, 5, 6, 8, 9, 10)
_POV_COLUMNS: Columns = (9, 10, 11), (0, 3, 6, 1, 4, 7, 2, 5, 8)
_ANCHORED, _POV = (axes.mirrored_y, ANCHORED_WORLD), (axes.world_cv_from_pov, OUR_WORLD)
_MATRIX_LINE = " ".join((["%.12f"] * 3 + ["%.9f"]) * 3) + "\n"
_MATRIX_ROW = "12 columns of a 3x4 matrix, or 13 with the frame number first"
_SQUARE_ROW = "16 columns of a 4x4 matrix, row by row"
_VSLAM_LAB_STAMP = "ts (ns),"
_VSLAM_LAB = "8 columns separated by commas: ts (ns), tx, ty, tz, qx, qy, qz, qw"
_TARTANAIR = "7 columns: tx ty tz qx qy qz qw"
_BLOCKS = "blocks of 3 lines with 4 columns: r00 r01 r02 tx"
_FROM_POV = f"converted to {OUR_WORLD}, stamps 1 + frame/{{rate}} s"

_ALL = (
    TrajectoryFormat(  # one 4x4 matrix per file
        name="scannet",
        sniff=pose_folders.is_scannet,
        rows=pose_folders.scannet_rows,
        columns=_MATRIX_COLUMNS,
        sentence=f"ScanNet's pose files: right-handed camera-to-world poses in {OWN_WORLD}, stamps 1 + number/{{rate}} s by the "
        "files' names",
    ),
    TrajectoryFormat(  # OpenGL cameras in JSON
        name="nerf",
        sniff=lambda source: (
            source.path.suffix.lower() == ".json" and source.text.lstrip().startswith("{")
        ),
        rows=pose_folders.nerf_rows,
        columns=_MATRIX_COLUMNS,
        frame=(axes.world_cv_from_world_blender, OWN_WORLD),
        handedness="right",
        sentence=f"transforms.json: OpenGL camera poses converted to right-handed cv camera poses in {OWN_WORLD}, stamps "
        "1 + number/{rate} s by the images' names",
    ),
    TrajectoryFormat(  # ICL-NUIM's own format, one file per frame
        name="pov-cameras",
        sniff=lambda source: (
            source.path.is_dir()
            or any(re.match(r"cam_\w+\s*=", line) for line in source.first_lines)
        ),
        rows=pov.camera_rows,
        columns=_POV_COLUMNS,
        sentence="pov-cameras: LEFT-handed poses of POV-Ray camera files (y up), "
        + _FROM_POV
        + " by the number in the file's name{how}",
        how=_unit_warning,
        frame=_POV,
    ),
    TrajectoryFormat(
        name="pov-commands",
        sniff=lambda source: any(
            re.search(r"(?i)declare\s*=\s*val\d\d", line) for line in source.first_lines
        ),
        rows=pov.command_rows,
        columns=_POV_COLUMNS,
        sentence="pov-commands: LEFT-handed poses in the POV world (y up), "
        + _FROM_POV
        + " by the number {how}",
        how=_counted,
        frame=_POV,
        line=pov.COMMAND_LINE,
        given=_given_pov,
        goes_to="pov-commands: LEFT-handed poses in the POV world (y up), the frame number in the image's name",
        word="command",
        texts=(".txt", ".sh"),
    ),
    TrajectoryFormat(  # ICL-NUIM's own format, anchored at image 1; image 0 has no pose
        name="gt.freiburg",
        sniff=is_freiburg,
        expected="8 columns: id tx ty tz qx qy qz qw",
        hint="{from} tum if these are seconds",
        sentence="gt.freiburg ({how}): LEFT-handed y-up poses made right-handed by mirroring y, stamps 1 + id/{rate} s, "
        f"in {ANCHORED_WORLD}",
        how=_why_freiburg,
        frame=_ANCHORED,
        line="%d %.9f %.9f %.9f %.12f %.12f %.12f %.12f\n",
        given=lambda t, options: _anchored(t, 1, options),
        goes_to="gt.freiburg: frame ids, LEFT-handed y-up poses, moved to the original's start, image 0 left out",
        endings=(".gt.freiburg",),
    ),
    # ICL-NUIM's own format, anchored at image 0, without an index: block k, from 0, belongs to
    # image k + 1
    TrajectoryFormat(
        name="gt.sim",
        sniff=lambda source: (
            source.name.endswith(".gt.sim") or (source.columns == 4 and source.starts_with_numbers)
        ),
        rows=_blocks,
        columns=_MATRIX_COLUMNS,
        first=1,
        sentence="gt.sim: LEFT-handed y-up poses made right-handed by mirroring y, block k taken as image k+1, "
        f"stamps 1 + (k+1)/{{rate}} s, in {ANCHORED_WORLD}; anchored at image 0, up to 8 mm off gt.freiburg",
        frame=_ANCHORED,
        line="%.12f %.12f %.12f %.9f\n" * 3,
        parted="\n",
        given=_given_sim,
        goes_to="gt.sim: blocks for images 1, 2, ..., LEFT-handed y-up poses, placed so that image 0 is the original's start",
        endings=(".gt.sim",),
    ),
    TrajectoryFormat(
        name="vslam-lab",
        sniff=lambda source: (
            bool(source.first_lines) and source.first_lines[0].lower().startswith(_VSLAM_LAB_STAMP)
        ),
        rows=_vslam_lab_rows,
        ticks=1e9,
        sentence=f"VSLAM-LAB: stamps in nanoseconds, right-handed camera-to-world poses in {OWN_WORLD}",
        line="%d,%.9f,%.9f,%.9f,%.12f,%.12f,%.12f,%.12f\n",
        given=_given_ns,
        header="ts (ns),tx ({symbol}),ty ({symbol}),tz ({symbol}),qx,qy,qz,qw\n",
        goes_to="VSLAM-LAB: nanoseconds, right-handed camera-to-world poses, world unchanged",
        word="vslam",
        texts=(".csv", ".txt"),
    ),
    TrajectoryFormat(  # quaternion scalar FIRST; more columns (velocity, biases) may follow
        name="euroc",
        sniff=lambda source: any("," in line for line in source.first_lines),
        rows=_euroc_rows,
        columns=((1, 2, 3), (5, 6, 7, 4)),
        ticks=1e9,
        sentence="EuRoC: stamps in nanoseconds, world <- body taken as right-handed camera-to-world poses in "
        + OWN_WORLD,
        line="%d,%.9f,%.9f,%.9f,%.12f,%.12f,%.12f,%.12f\n",
        given=_given_ns,
        header=_EUROC_HEADER,
        goes_to="EuRoC: nanoseconds, right-handed camera-to-world poses (as world <- body), world unchanged",
        endings=(".csv",),
    ),
    TrajectoryFormat(
        name="pov-matrix",
        sniff=lambda source: (
            source.columns in (12, 13) and ("pov" in source.name or "pov" in source.header)
        ),
        expected=_MATRIX_ROW,
        counts=(12, 13),
        columns=_MATRIX_COLUMNS,
        sentence="pov-matrix: LEFT-handed poses in the POV world (y up), " + _FROM_POV + "{how}",
        how=_unit_warning,
        frame=_POV,
        line="%d " + _MATRIX_LINE,
        given=_given_pov,
        header=_POV_HEADER,
        goes_to="pov-matrix: frame numbers, LEFT-handed poses in the POV world (y up)",
        word="pov",
    ),
    TrajectoryFormat(
        name="kitti",
        sniff=lambda source: source.columns in (12, 13),
        expected=_MATRIX_ROW,
        counts=(12, 13),
        columns=_MATRIX_COLUMNS,
        sentence=f"KITTI rows: right-handed camera-to-world poses in {OWN_WORLD}, stamps 1 + frame/{{rate}} s",
        line=_MATRIX_LINE,
        goes_to="KITTI: 12 columns, right-handed camera-to-world poses, world unchanged; stamps are not written",
        endings=(".kitti",),
        word="kitti",
    ),
    # rows of 4x4 matrices: the data set Replica as rendered for neural mapping systems
    TrajectoryFormat(
        name="replica",
        sniff=lambda source: source.columns == 16 and source.starts_with_numbers,
        counts=(16,),
        columns=_MATRIX_COLUMNS,
        rows=_square_rows,
        sentence=f"Replica rows: right-handed camera-to-world poses in {OWN_WORLD}, stamps 1 + line/{{rate}} s, lines from 0",
        line=_MATRIX_LINE.replace("\n", " 0 0 0 1\n"),
        goes_to="Replica: 16 columns of a 4x4 matrix, right-handed camera-to-world poses, world unchanged; stamps are not written",
        endings=(".replica",),
        word="replica",
    ),
    TrajectoryFormat(  # world to camera, scalar first, in a world without a unit
        name="colmap",
        sniff=lambda source: (
            bool(source.first_lines) and colmap.names_an_image(source.first_lines[0])
        ),
        rows=colmap.rows,
        inverse=True,
        sentence="COLMAP: world-to-camera poses inverted to right-handed camera-to-world poses, unit of length unknown "
        f"(align by sim3), in {OWN_WORLD}, stamps by the images' names ({{how}}; {{rate}} frames per second)",
        how=_numbering,
    ),
    TrajectoryFormat(  # x forward, y right, z down
        name="tartanair",
        sniff=_is_tartanair,
        expected=_TARTANAIR,
        counts=(7,),
        columns=((0, 1, 2), (3, 4, 5, 6)),
        frame=(axes.world_cv_from_ned, OUR_WORLD),
        handedness="right",
        sentence=f"TartanAir: poses in NED axes (x forward, y right, z down) converted to {OUR_WORLD}, stamps 1 + line/{{rate}} s, "
        "lines from 0",
        line="%.9f %.9f %.9f %.12f %.12f %.12f %.12f\n",
        given=lambda t, options: (None, axes.ned_from_world_cv(t.T_world_camera)),
        goes_to="TartanAir: 7 columns, poses in NED axes (x forward, y right, z down); stamps are not written",
        word="pose_left",
    ),
    TrajectoryFormat(
        name="tum",
        sniff=lambda source: source.columns == 8,
        rows=_tum_rows,
        sentence="TUM: stamps in {how}",
        how=_tum_stamps,
        line="%s %.9f %.9f %.9f %.12f %.12f %.12f %.12f\n",
        given=lambda t, options: (
            map(trajectory_file.stamp_text, t.stamps_s.tolist()),
            t.T_world_camera,
        ),
        header=_TUM_HEADER,
        goes_to="TUM: seconds, right-handed camera-to-world poses, world unchanged",
        endings=(".tum", ".txt"),
    ),
    # frame numbers as stamps, as written by odometers on ICL-NUIM; never detected, only used by
    # name
    TrajectoryFormat(
        name="tum-ids",
        sniff=lambda source: False,
        hint="{from} tum",
        sentence=f"TUM with frame numbers: stamps 1 + number/{{rate}} s, right-handed poses in {OWN_WORLD}",
    ),
    # as written by systems that estimate the world's pose in the camera; only used by name
    TrajectoryFormat(
        name="tum-inverse",
        sniff=lambda source: False,
        rows=_tum_rows,
        inverse=True,
        sentence="TUM with world-to-camera poses, which are inverted: stamps in {how}",
        how=_tum_stamps,
    ),
    TrajectoryFormat(  # only used by name
        name="tum-wxyz",
        sniff=lambda source: False,
        expected="8 columns: timestamp tx ty tz qw qx qy qz",
        columns=((1, 2, 3), (5, 6, 7, 4)),
        rows=_tum_rows,
        sentence="TUM with the quaternion's scalar first: stamps in {how}",
        how=_tum_stamps,
    ),
)
#: name -> format, in the order in which their `sniff` functions are called
FORMATS = {format.name: format for format in _ALL}
