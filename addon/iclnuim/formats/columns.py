"""Trajectory formats of one pose a line, each described by its columns: TUM, EuRoC, KITTI, and ICL-NUIM's own.

A new format of this kind is one entry of COLUMNS; the command line, the panel and the pages list what stands there.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..geometry import axes
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory
from . import trajectory_file
from .table import Table, data_lines, read_table
from .trajectory_file import LoadedTrajectory, ReadAs, ReadOptions, Source, TrajectoryFormat, WriteOptions

ANCHORED_WORLD = "the original's anchored frame made right-handed (the first camera's axes: x right, y down, z forward)"
#: Where the official files start: living room, office. Office kt0, whose first image is missing, is 9 mm off.
OFFICIAL_STARTS_Z_M = (-2.25, -2.5)
START_TOLERANCE_M = 0.02

#: Where r00 r01 ... r22 and the position stand in the rows of a 3x4 matrix.
_ROTATION, _POSITION = [0, 1, 2, 4, 5, 6, 8, 9, 10], [3, 7, 11]
_MATRIX_LINE = " ".join((["%.12f"] * 3 + ["%.9f"]) * 3) + "\n"

#: The trajectory of a table and its poses.
ReadStamps = Callable[[Table, SE3, ReadOptions], Trajectory]
#: Stamps or numbers, None where a format has none, and poses.
Given = tuple[Iterable | None, SE3]


@dataclass(frozen=True)
class Columns:
    """A format of one pose a line: its columns, and what stamps and poses in them mean.

    sniff: whether a file is of it. expected: what a line is, for errors. counts: how many columns a line may have; of 13, where 12 would
    do, the first is the frame's number. position, orientation: columns of x y z, and of qx qy qz qw or r00 r01 ... r22. stamps: the
    trajectory of a table and its poses. right: the file's poses as right-handed cv camera poses. sentence: how a file was read, with
    {rate} for the frame rate and {how} for what `how` says. left_handed, world: of the file, and of the trajectory.
    line: for printf, all columns in order; "" where the format is only read. given: what is written of a trajectory: stamps or numbers
    (None where the format has none), and poses. goes_to: the same in a sentence. endings, word: names of files that mean this format.
    """

    name: str
    sniff: Callable[[Source], bool]
    stamps: ReadStamps
    sentence: str
    expected: str = "8 columns: timestamp tx ty tz qx qy qz qw"
    counts: tuple[int, ...] = (8,)
    position: Sequence[int] = (1, 2, 3)
    orientation: Sequence[int] = (4, 5, 6, 7)
    right: Callable[[SE3], SE3] = lambda poses: poses
    left_handed: bool = False
    world: str = trajectory_file.OWN_WORLD
    delimiter: str | None = None
    rows: "Callable[[Source, Columns], Table]" = lambda source, self: read_table(
        source.path, source.text, self.counts, self.expected, self.delimiter
    )
    how: Callable[[Source, Trajectory], str] = lambda source, trajectory: ""
    line: str = ""
    given: Callable[[Trajectory, WriteOptions], Given] = lambda t, options: (None, t.T_world_camera)
    header: Callable[[WriteOptions], str] = lambda options: ""
    parted: str = ""
    goes_to: str = ""
    endings: tuple[str, ...] = ()
    word: str = ""

    @property
    def format(self) -> TrajectoryFormat:
        """As it stands in the registry."""
        write = self.write if self.line else None
        return TrajectoryFormat(self.sniff, self.read, write, self.goes_to, self.endings, self.word)

    def read(self, source: Source, options: ReadOptions) -> LoadedTrajectory:
        """Raises InputError, naming the line, for what is not of this format."""
        table = self.rows(source, self)
        numbered = table.values.shape[1] == 13
        orientation, position = ([c + numbered for c in columns] for columns in (self.orientation, self.position))
        poses = self.right(trajectory_file.poses_of(table, table.values[:, position] * options.unit_m, orientation))
        trajectory = self.stamps(table, poses, options)
        sentence = self.sentence.format(rate=f"{options.rate_hz:g}", how=self.how(source, trajectory))
        handedness = "left" if self.left_handed else "right"
        return LoadedTrajectory(trajectory, ReadAs(self.name, handedness, self.world, sentence))

    def write(self, trajectory: Trajectory, options: WriteOptions) -> str:
        """The text of a file. Raises InputError where the format cannot hold the trajectory."""
        stamps, poses = self.given(trajectory, options)
        quaternions = len(self.orientation) == 4
        columns = np.zeros((len(poses), max(*self.position, *self.orientation) + 1))
        columns[:, self.orientation] = poses.quat_xyzw if quaternions else poses.rotation.reshape(-1, 9)
        columns[:, self.position] = poses.translation / options.unit_m
        rows = (columns[:, 1 if quaternions else 0 :] + 0.0).tolist()  # adding 0.0 turns -0.0 into 0.0
        if stamps is None:
            lines = [self.line % tuple(row) for row in rows]
        else:
            lines = [self.line % (stamp, *row) for stamp, row in zip(stamps, rows, strict=True)]
        return self.header(options) + self.parted.join(lines)


def is_freiburg(source: Source) -> bool:
    """Named `*.gt.freiburg`, or frame ids and a start as in the official files, unless a header says right-handed.

    Nothing else makes a file left-handed: handedness cannot be seen in poses; whole-number stamps alone decide nothing.
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
    """Whether a first position (3,) is that of the official living-room or office files, each axis to 2 cm."""
    return any(np.abs(position_m - (0.0, 0.0, z)).max() <= START_TOLERANCE_M for z in OFFICIAL_STARTS_Z_M)


def _anchored(trajectory: Trajectory, anchor: int, options: WriteOptions) -> tuple[list[int], SE3]:
    """n frame numbers from 1 on and their left-handed poses, with the pose of image `anchor` at (0, 0, start_z_m).

    T(i) = [I, (0, 0, start)] T_pov(anchor)^-1 T_pov(i). Without that image the first one written serves. Poses that already start as the
    official files do stay as they are.
    """
    numbers = trajectory_file.frame_numbers(trajectory, options.rate_hz)
    kept = numbers >= 1
    if not kept.any():
        raise InputError("poses of image 1 or later (image 0 has none in this format)", found="image 0 alone")
    T = trajectory.T_world_camera
    shown = T[kept]
    if not starts_as_official(shown.translation[0]):
        at_anchor = np.flatnonzero(numbers == anchor)
        reference = T[int(at_anchor[0])] if at_anchor.size else shown[0]
        shown = SE3(np.eye(3), np.array([0.0, 0.0, options.start_z_m])) @ reference.inverse() @ shown
    return numbers[kept].tolist(), axes.mirrored_y(shown)


def _given_sim(trajectory: Trajectory, options: WriteOptions) -> Given:
    """Raises InputError where frames are missing, since blocks carry no number."""
    numbers, left = _anchored(trajectory, 0, options)
    if numbers[-1] != len(numbers):
        found = f"{len(numbers)} frames up to {numbers[-1]}"
        raise InputError("frames 1, 2, 3, ... without a gap to write gt.sim", found=found)
    return None, left


def _pov_header(options: WriteOptions) -> str:
    unit = {1.0: "metres", 0.01: "centimetres"}.get(options.unit_m, f"units of {options.unit_m:g} m")
    return (
        "# frame r00 r01 r02 tx r10 r11 r12 ty r20 r21 r22 tz ; T_pov_cam, LEFT-handed POV-Ray world (y up), "
        f"camera x right y up z forward, {unit}\n"
    )


def _blocks(source: Source, sim: Columns) -> Table:
    """(n, 12). Raises InputError for the first block that does not stand on three lines one below the other."""
    lines = read_table(source.path, source.text, (4,), sim.expected)
    numbers = [number for number, _ in data_lines(source.text)]
    for k in range(0, len(numbers), 3):
        if numbers[k : k + 3] != [numbers[k], numbers[k] + 1, numbers[k] + 2]:
            raise InputError(sim.expected, path=source.path, line=numbers[k], found="a block of another length")
    return Table(lines.values.reshape(-1, 12), lambda k: (source.path, numbers[3 * k]))


def _numbered_from(first: int) -> ReadStamps:
    """Of 13 columns the first is the frame's number; else lines are counted."""

    def read(table: Table, poses: SE3, options: ReadOptions) -> Trajectory:
        numbers = table.values[:, 0] if table.values.shape[1] == 13 else np.arange(len(poses)) + float(first)
        return trajectory_file.trajectory_of_frames(table, numbers, poses, options.rate_hz)

    return read


def _ids(hint: str) -> ReadStamps:
    return lambda table, poses, options: trajectory_file.trajectory_of_frames(
        table, table.values[:, 0], poses, options.rate_hz, hint
    )


def _whole_seconds(source: Source, trajectory: Trajectory) -> str:
    stamps_s = trajectory.stamps_s
    if len(stamps_s) > 1 and (stamps_s == np.rint(stamps_s)).all():
        return "; its whole numbers are taken as seconds (the format tum-ids takes them as frame numbers)"
    return ""


def _why_freiburg(source: Source, trajectory: Trajectory) -> str:
    named = source.name.endswith(".gt.freiburg")
    return "by its name" if named else "by its start" if is_freiburg(source) else "as told"


TUM_HEADER = (
    "# timestamp tx ty tz qx qy qz qw; seconds, metres, right-handed, camera (x right, y down, z forward) to world\n"
)
_EUROC_HEADER = "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n"
_MATRIX_COLUMNS = "12 columns of a 3x4 matrix, or 13 with the frame number first"

#: In the order in which they are asked whether a file is theirs.
COLUMNS = (
    Columns(  # ICL-NUIM's own, anchored at image 1; image 0 has no pose
        name="gt.freiburg",
        sniff=is_freiburg,
        expected="8 columns: id tx ty tz qx qy qz qw",
        stamps=_ids("{from} tum if these are seconds"),
        sentence="gt.freiburg ({how}): LEFT-handed y-up poses made right-handed by mirroring y, stamps id/{rate} s, "
        f"in {ANCHORED_WORLD}",
        how=_why_freiburg,
        right=axes.mirrored_y,
        left_handed=True,
        world=ANCHORED_WORLD,
        line="%d %.9f %.9f %.9f %.12f %.12f %.12f %.12f\n",
        given=lambda t, options: _anchored(t, 1, options),
        goes_to="gt.freiburg: frame ids, LEFT-handed y-up poses, moved to the original's start, image 0 left out",
        endings=(".gt.freiburg",),
    ),
    Columns(  # ICL-NUIM's own, anchored at image 0, without an index: block k, from 0, belongs to image k + 1
        name="gt.sim",
        sniff=lambda source: source.name.endswith(".gt.sim") or (source.columns == 4 and source.starts_with_numbers),
        expected="blocks of 3 lines with 4 columns: r00 r01 r02 tx",
        counts=(4,),
        rows=_blocks,
        position=_POSITION,
        orientation=_ROTATION,
        stamps=_numbered_from(1),
        sentence="gt.sim: LEFT-handed y-up poses made right-handed by mirroring y, block k taken as image k+1, "
        f"stamps (k+1)/{{rate}} s, in {ANCHORED_WORLD}; anchored at image 0, up to 8 mm off gt.freiburg",
        right=axes.mirrored_y,
        left_handed=True,
        world=ANCHORED_WORLD,
        line="%.12f %.12f %.12f %.9f\n" * 3,
        parted="\n",
        given=_given_sim,
        goes_to="gt.sim: blocks for images 1, 2, ..., LEFT-handed y-up poses, placed so that image 0 is the original's start",
        endings=(".gt.sim",),
    ),
    Columns(  # quaternion scalar FIRST; more columns (velocity, biases) may follow
        name="euroc",
        sniff=lambda source: any("," in line for line in source.first_lines),
        expected="8 or 17 columns parted by commas: stamp in ns, x, y, z, qw, qx, qy, qz",
        counts=(8, 17),
        delimiter=",",
        orientation=(5, 6, 7, 4),
        stamps=lambda table, poses, options: trajectory_file.trajectory_at(table, table.values[:, 0] / 1e9, poses),
        sentence="EuRoC: stamps in nanoseconds, world <- body taken as right-handed camera-to-world poses in "
        + trajectory_file.OWN_WORLD,
        line="%d,%.9f,%.9f,%.9f,%.12f,%.12f,%.12f,%.12f\n",
        given=lambda t, options: (np.rint(t.stamps_s * 1e9).astype(np.int64).tolist(), t.T_world_camera),
        header=lambda options: _EUROC_HEADER,
        goes_to="EuRoC: nanoseconds, right-handed camera-to-world poses (as world <- body), world as it was",
        endings=(".csv",),
    ),
    Columns(
        name="pov-matrix",
        sniff=lambda source: source.columns in (12, 13) and ("pov" in source.name or "pov" in source.header),
        expected=_MATRIX_COLUMNS,
        counts=(12, 13),
        position=_POSITION,
        orientation=_ROTATION,
        stamps=_numbered_from(0),
        sentence=f"pov-matrix: LEFT-handed poses in the POV world (y up), turned into {trajectory_file.OUR_WORLD}, stamps frame/{{rate}} s{{how}}",
        how=lambda source, trajectory: trajectory_file.unit_warning(trajectory),
        right=axes.world_cv_from_pov,
        left_handed=True,
        world=trajectory_file.OUR_WORLD,
        line="%d " + _MATRIX_LINE,
        given=lambda t, options: (
            trajectory_file.frame_numbers(t, options.rate_hz).tolist(),
            axes.pov_from_world_cv(t.T_world_camera),
        ),
        header=_pov_header,
        goes_to="pov-matrix: frame numbers, LEFT-handed poses in the POV world (y up)",
        word="pov",
    ),
    Columns(
        name="kitti",
        sniff=lambda source: source.columns in (12, 13),
        expected=_MATRIX_COLUMNS,
        counts=(12, 13),
        position=_POSITION,
        orientation=_ROTATION,
        stamps=_numbered_from(0),
        sentence=f"KITTI rows: right-handed camera-to-world poses in {trajectory_file.OWN_WORLD}, stamps frame/{{rate}} s",
        line=_MATRIX_LINE,
        goes_to="KITTI: 12 columns, right-handed camera-to-world poses, world as it was; stamps are not kept",
        endings=(".kitti",),
        word="kitti",
    ),
    Columns(
        name="tum",
        sniff=lambda source: source.columns == 8,
        stamps=lambda table, poses, options: trajectory_file.trajectory_at(table, table.values[:, 0], poses),
        sentence=f"TUM: stamps in seconds, right-handed camera-to-world poses in {trajectory_file.OWN_WORLD}{{how}}",
        how=_whole_seconds,
        line="%.9f %.9f %.9f %.9f %.12f %.12f %.12f %.12f\n",
        given=lambda t, options: (t.stamps_s.tolist(), t.T_world_camera),
        header=lambda options: TUM_HEADER,
        goes_to="TUM: seconds, right-handed camera-to-world poses, world as it was",
        endings=(".tum", ".txt"),
    ),
    Columns(  # frame numbers for stamps, as odometers run on ICL-NUIM write them; only where it is named
        name="tum-ids",
        sniff=lambda source: False,
        stamps=_ids("{from} tum"),
        sentence=f"TUM with frame numbers: stamps number/{{rate}} s, right-handed poses in {trajectory_file.OWN_WORLD}",
    ),
)
