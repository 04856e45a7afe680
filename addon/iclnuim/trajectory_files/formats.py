"""The registry of trajectory formats, described by their columns: how each is read and, for most,
written. A new format is an entry here and, to be detected, one in sniffing.py.
"""

from typing import NamedTuple

import numpy as np

from ..errors import within
from ..geometry import axes
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory
from . import bag_poses, colmap, icl_nuim, matrices, named_rows, number_rows, phones
from .icl_nuim import ANCHORED_WORLD
from .number_rows import NumberRows
from .number_table import MATRIX, SCALAR_FIRST, SCALAR_LAST, NumberTable, PoseColumns
from .reader import TrajectoryReader
from .sniffing import is_freiburg
from .source import OUR_WORLD, OWN_WORLD, Source
from .stamps import Stamps
from .writer import TrajectoryWriter

#: Rooms are a few metres wide: a POV-world trajectory that is this far from the origin was probably
#: written in centimetres.
FAR_M = 50.0


_UNITS_OF_TICKS = {
    None: "frames",
    1.0: "seconds",
    1e3: "milliseconds",
    1e6: "microseconds",
    1e9: "nanoseconds",
}


class TrajectoryFormat(NamedTuple):
    """A trajectory format; writer: None if it is only read."""

    reader: TrajectoryReader
    writer: TrajectoryWriter | None = None

    def check(self, name: str) -> None:
        """Raises InputError if the parts of the entry do not fit each other."""
        with within(f"trajectory format {name}"):
            self.reader.check()
            if self.writer is not None:
                self.writer.check()


def _numbering(source: Source, table: NumberTable, trajectory: Trajectory) -> str:
    """The unit of a table's first column: frames or a unit of time."""
    return _UNITS_OF_TICKS[table.ticks]


def _stamps(source: Source, table: NumberTable, trajectory: Trajectory) -> str:
    """The stamps of a table with stamps, with frame numbers, or with neither."""
    if table.ticks is not None:
        return f"stamps in {_UNITS_OF_TICKS[table.ticks]}"
    columns = table.columns or MATRIX.shifted(int(table.is_numbered))
    if columns.leave_first:
        return "stamps 1 + frame number/{rate} s"
    return "stamps 1 + line/{rate} s, lines from 0"


def _named(source: Source, table: NumberTable, trajectory: Trajectory) -> str:
    """The stamps, and the names in the header."""
    return f"{' '.join(source.names)}; {_stamps(source, table, trajectory)}"


def _tum_stamps(source: Source, table: NumberTable, trajectory: Trajectory) -> str:
    """The unit of the stamps and the world; for whole seconds, a note that they may be frame
    numbers.
    """
    unit = _numbering(source, table, trajectory)
    text = f"{unit}, right-handed camera-to-world poses in {OWN_WORLD}"
    stamps_s = trajectory.stamps_s
    if table.ticks == 1.0 and len(stamps_s) > 1 and (stamps_s == np.rint(stamps_s)).all():
        text += "; its whole numbers are read as seconds"
        text += " (the format tum-ids reads them as frame numbers)"
    return text


def _why_freiburg(source: Source, table: NumberTable, trajectory: Trajectory) -> str:
    if source.name.endswith(".gt.freiburg"):
        return "by its name"
    return "by its start" if is_freiburg(source) else "as requested"


def _unit_warning(source: Source, table: NumberTable, trajectory: Trajectory) -> str:
    """A warning for a POV-world file whose positions are probably in centimetres, else an empty
    text.
    """
    far_m = np.abs(trajectory.positions_m).max()
    if far_m <= FAR_M:
        return ""
    return f"; positions reach {far_m:.0f} m: they may be centimetres (unit cm)"


def _counted(source: Source, table: NumberTable, trajectory: Trajectory) -> str:
    """The origin of the frame numbers of commands, and the warning about units."""
    origin = "of the image's name" if table.is_numbered else "of the line, from 0"
    return origin + _unit_warning(source, table, trajectory)


TUM_HEADER = (
    "# timestamp tx ty tz qx qy qz qw; seconds, {unit}, right-handed, "
    "camera (x right, y down, z forward) to world\n"
)
_EUROC_HEADER = (
    "#timestamp [ns],p_RS_R_x [{symbol}],p_RS_R_y [{symbol}],p_RS_R_z [{symbol}],"
    "q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []\n"
)
_POV_HEADER = (
    "# frame r00 r01 r02 tx r10 r11 r12 ty r20 r21 r22 tz ; T_pov_cam, "
    "LEFT-handed POV-Ray world (y up), camera x right y up z forward, {unit}\n"
)
#: val00 val01 ... val32 of POV-Ray: rows 0 to 2 are the camera's axes, row 3 is the position.
_POV = PoseColumns((9, 10, 11), (0, 3, 6, 1, 4, 7, 2, 5, 8))
_POSE = "%.9f %.9f %.9f %.12f %.12f %.12f %.12f\n"
_POSE_WITH_COMMAS = "%d," + _POSE.replace(" ", ",")
_MATRIX_LINE = " ".join((["%.12f"] * 3 + ["%.9f"]) * 3) + "\n"
_UNSTAMPED_ROWS = NumberRows((7,), "7 columns: tx ty tz qx qy qz qw", Stamps.NONE)
_TUM_ROWS = NumberRows((8,), number_rows.TUM, Stamps.SECONDS)
_UNSTAMPED = PoseColumns((0, 1, 2), (3, 4, 5, 6))
_MIRRORED = "LEFT-handed y-up poses made right-handed by mirroring y"
_FROM_POV = f"(y up), converted to {OUR_WORLD}, stamps 1 + frame/{{rate}} s"
_RIGHT_IN_OWN = f"right-handed camera-to-world poses in {OWN_WORLD}"
_UNCHANGED = "right-handed camera-to-world poses, world unchanged"
_FROM_OPENGL = f"OpenGL camera poses converted to right-handed cv camera poses in {OWN_WORLD}"
_NO_STAMPS = "; stamps are not written"

#: name -> format
FORMATS = {
    # the note of its table has the topic and the frames
    "rosbag": TrajectoryFormat(
        TrajectoryReader(bag_poses.rows, SCALAR_LAST, f"ROS bag: {_RIGHT_IN_OWN}")
    ),
    # one 4x4 matrix per file, also of 7-Scenes and BundleFusion
    "scannet": TrajectoryFormat(
        TrajectoryReader(
            matrices.scannet_rows,
            MATRIX,
            f"a pose file for each frame: {_RIGHT_IN_OWN}, "
            "stamps 1 + number/{rate} s by the files' names",
        )
    ),
    # OpenGL cameras in JSON
    "nerf": TrajectoryFormat(
        TrajectoryReader(
            matrices.nerf_rows,
            MATRIX,
            f"transforms.json: {_FROM_OPENGL}, {{how}} by the images' names",
            convert=axes.world_cv_from_world_blender,
            how=_stamps,
        )
    ),
    # of apps on phones: OpenGL cameras in JSON, of all frames or of one
    "record3d": TrajectoryFormat(
        TrajectoryReader(
            phones.record3d_rows,
            phones.QUATERNION_FIRST,
            f"Record3D's metadata.json: {_FROM_OPENGL}, {{how}}",
            convert=axes.world_cv_from_world_blender,
            how=_stamps,
        )
    ),
    "polycam": TrajectoryFormat(
        TrajectoryReader(
            phones.polycam_rows,
            MATRIX,
            f"Polycam's cameras: {_FROM_OPENGL}, {{how}} by the files' names",
            convert=axes.world_cv_from_world_blender,
            how=_stamps,
        )
    ),
    # PinholeCameraTrajectory in JSON, world to camera
    "open3d": TrajectoryFormat(
        TrajectoryReader(
            matrices.open3d_rows,
            MATRIX,
            "Open3D's camera trajectory: world-to-camera poses inverted to right-handed "
            f"camera-to-world poses in {OWN_WORLD}, {{how}}",
            convert=SE3.inverse,
            how=_stamps,
        )
    ),
    # any table whose header names its columns in an order of its own
    "named-columns": TrajectoryFormat(
        TrajectoryReader(
            named_rows.named_rows,
            SCALAR_LAST,
            f"columns as the header names them ({{how}}), {_RIGHT_IN_OWN}",
            how=_named,
        )
    ),
    # 4x4 matrices; with the line of frame numbers the .log of Redwood, the augmented ICL-NUIM data
    # set and Open3D
    "matrix-blocks": TrajectoryFormat(
        TrajectoryReader(
            matrices.block_rows,
            MATRIX,
            f"blocks of a 4x4 matrix (as in Redwood's .log): {_RIGHT_IN_OWN}, {{how}}",
            how=_stamps,
        )
    ),
    # ICL-NUIM's own format, one file per frame
    "pov-cameras": TrajectoryFormat(
        TrajectoryReader(
            icl_nuim.camera_rows,
            _POV,
            f"pov-cameras: LEFT-handed poses of POV-Ray camera files {_FROM_POV} "
            "by the number in the file's name{how}",
            convert=axes.world_cv_from_pov,
            world=OUR_WORLD,
            handedness="left",
            how=_unit_warning,
        )
    ),
    "pov-commands": TrajectoryFormat(
        TrajectoryReader(
            icl_nuim.command_rows,
            _POV,
            f"pov-commands: LEFT-handed poses in the POV world {_FROM_POV} by the number {{how}}",
            convert=axes.world_cv_from_pov,
            world=OUR_WORLD,
            handedness="left",
            how=_counted,
        ),
        TrajectoryWriter(
            icl_nuim.COMMAND_LINE,
            _POV,
            Stamps.FRAMES,
            "pov-commands: LEFT-handed poses in the POV world (y up), "
            "the frame number in the image's name",
            convert=axes.pov_from_world_cv,
            word="command",
            texts=(".txt", ".sh"),
        ),
    ),
    # ICL-NUIM's own format, anchored at image 1; image 0 has no pose
    "gt.freiburg": TrajectoryFormat(
        TrajectoryReader(
            NumberRows((8,), "8 columns: id tx ty tz qx qy qz qw", Stamps.FRAMES),
            SCALAR_LAST,
            f"gt.freiburg ({{how}}): {_MIRRORED}, stamps 1 + id/{{rate}} s, in {ANCHORED_WORLD}",
            convert=axes.mirrored_y,
            world=ANCHORED_WORLD,
            handedness="left",
            how=_why_freiburg,
            hint="{from} tum if these are seconds",
            first_pose=0,
        ),
        TrajectoryWriter(
            "%d " + _POSE,
            SCALAR_LAST,
            Stamps.FRAMES,
            "gt.freiburg: frame ids, LEFT-handed y-up poses, moved to the original's start, "
            "image 0 left out",
            convert=axes.mirrored_y,
            chosen=icl_nuim.at_image_1,
            endings=(".gt.freiburg",),
        ),
    ),
    # ICL-NUIM's own format, anchored at image 0, without an index: block k, from 0, belongs to
    # image k + 1
    "gt.sim": TrajectoryFormat(
        TrajectoryReader(
            icl_nuim.sim_rows,
            MATRIX,
            f"gt.sim: {_MIRRORED}, block k taken as image k+1, stamps 1 + (k+1)/{{rate}} s, "
            f"in {ANCHORED_WORLD}; anchored at image 0, up to 8 mm off gt.freiburg",
            convert=axes.mirrored_y,
            world=ANCHORED_WORLD,
            handedness="left",
        ),
        TrajectoryWriter(
            "%.12f %.12f %.12f %.9f\n" * 3,
            MATRIX,
            Stamps.NONE,
            "gt.sim: blocks for images 1, 2, ..., LEFT-handed y-up poses, "
            "placed so that image 0 is the original's start",
            convert=axes.mirrored_y,
            chosen=icl_nuim.at_image_0,
            separator="\n",
            endings=(".gt.sim",),
        ),
    ),
    "vslam-lab": TrajectoryFormat(
        TrajectoryReader(
            number_rows.vslam_lab_rows,
            SCALAR_LAST,
            f"VSLAM-LAB: stamps in nanoseconds, {_RIGHT_IN_OWN}",
            first_pose=1,  # after the names of the columns
        ),
        TrajectoryWriter(
            _POSE_WITH_COMMAS,
            SCALAR_LAST,
            Stamps.NANOSECONDS,
            f"VSLAM-LAB: nanoseconds, {_UNCHANGED}",
            header="ts (ns),tx ({symbol}),ty ({symbol}),tz ({symbol}),qx,qy,qz,qw\n",
            word="vslam",
            texts=(".csv", ".txt"),
        ),
    ),
    # quaternion scalar FIRST; more columns (velocity, biases) may follow
    "euroc": TrajectoryFormat(
        TrajectoryReader(
            number_rows.euroc_rows,
            SCALAR_FIRST,
            "EuRoC: stamps in {how}, world <- body taken as " + _RIGHT_IN_OWN,
            how=_numbering,
            first_pose=0,
        ),
        TrajectoryWriter(
            _POSE_WITH_COMMAS,
            SCALAR_FIRST,
            Stamps.NANOSECONDS,
            "EuRoC: nanoseconds, right-handed camera-to-world poses (as world <- body), "
            "world unchanged",
            header=_EUROC_HEADER,
            endings=(".csv",),
        ),
    ),
    "pov-matrix": TrajectoryFormat(
        TrajectoryReader(
            icl_nuim.pov_matrix_rows,
            MATRIX,
            f"pov-matrix: LEFT-handed poses in the POV world {_FROM_POV}{{how}}",
            convert=axes.world_cv_from_pov,
            world=OUR_WORLD,
            handedness="left",
            how=_unit_warning,
        ),
        TrajectoryWriter(
            "%d " + _MATRIX_LINE,
            MATRIX,
            Stamps.FRAMES,
            "pov-matrix: frame numbers, LEFT-handed poses in the POV world (y up)",
            convert=axes.pov_from_world_cv,
            header=_POV_HEADER,
            word="pov",
        ),
    ),
    "kitti": TrajectoryFormat(
        TrajectoryReader(
            number_rows.matrix_rows,
            MATRIX,
            f"KITTI rows: {_RIGHT_IN_OWN}, {{how}}",
            how=_stamps,
        ),
        TrajectoryWriter(
            _MATRIX_LINE,
            MATRIX,
            Stamps.NONE,
            f"KITTI: 12 columns, {_UNCHANGED}{_NO_STAMPS}",
            endings=(".kitti",),
            word="kitti",
        ),
    ),
    # rows of 4x4 matrices: the data set Replica as rendered for neural mapping systems
    "replica": TrajectoryFormat(
        TrajectoryReader(
            number_rows.square_rows,
            MATRIX,
            f"Replica rows: {_RIGHT_IN_OWN}, {{how}}",
            how=_stamps,
        ),
        TrajectoryWriter(
            _MATRIX_LINE.replace("\n", " 0 0 0 1\n"),
            MATRIX,
            Stamps.NONE,
            f"Replica: 16 columns of a 4x4 matrix, {_UNCHANGED}{_NO_STAMPS}",
            endings=(".replica",),
            word="replica",
        ),
    ),
    # world to camera, scalar first, in a world without a unit
    "colmap": TrajectoryFormat(
        TrajectoryReader(
            colmap.rows,
            SCALAR_LAST,
            "COLMAP: world-to-camera poses inverted to right-handed camera-to-world poses, "
            f"unit of length unknown (align by sim3), in {OWN_WORLD}, stamps by the images' names "
            "({how}; {rate} frames per second)",
            convert=SE3.inverse,
            how=_numbering,
        )
    ),
    # x forward, y right, z down
    "tartanair": TrajectoryFormat(
        TrajectoryReader(
            _UNSTAMPED_ROWS,
            _UNSTAMPED,
            "TartanAir: poses in NED axes (x forward, y right, z down) converted to "
            f"{OUR_WORLD}, stamps 1 + line/{{rate}} s, lines from 0",
            convert=axes.world_cv_from_ned,
            world=OUR_WORLD,
        ),
        TrajectoryWriter(
            _POSE,
            _UNSTAMPED,
            Stamps.NONE,
            "TartanAir: 7 columns, poses in NED axes (x forward, y right, z down)" + _NO_STAMPS,
            convert=axes.ned_from_world_cv,
            word="pose_left",
        ),
    ),
    "tum-unstamped": TrajectoryFormat(
        TrajectoryReader(
            _UNSTAMPED_ROWS,
            _UNSTAMPED,
            f"TUM without stamps: {_RIGHT_IN_OWN}, {{how}} (the format tartanair reads its 7 "
            "columns as poses in NED axes)",
            how=_stamps,
        )
    ),
    # positions alone, as of a laser tracker or a satellite receiver
    "positions": TrajectoryFormat(
        TrajectoryReader(
            number_rows.position_rows,
            SCALAR_LAST,
            f"positions without rotations, {{how}}, in {OWN_WORLD}",
            how=_stamps,
        )
    ),
    "tum": TrajectoryFormat(
        TrajectoryReader(
            _TUM_ROWS,
            SCALAR_LAST,
            "TUM: stamps in {how}",
            how=_tum_stamps,
            first_pose=0,
        ),
        TrajectoryWriter(
            "%s " + _POSE,
            SCALAR_LAST,
            Stamps.SECONDS,
            f"TUM: seconds, {_UNCHANGED}",
            header=TUM_HEADER,
            endings=(".tum", ".txt"),
        ),
    ),
    # frame numbers as stamps, as written by odometers on ICL-NUIM; never detected, only used by
    # name
    "tum-ids": TrajectoryFormat(
        TrajectoryReader(
            NumberRows((8,), number_rows.TUM, Stamps.FRAMES),
            SCALAR_LAST,
            "TUM with frame numbers: stamps 1 + number/{rate} s, "
            f"right-handed poses in {OWN_WORLD}",
            hint="{from} tum",
        )
    ),
    # as written by systems that estimate the world's pose in the camera; only used by name
    "tum-inverse": TrajectoryFormat(
        TrajectoryReader(
            _TUM_ROWS,
            SCALAR_LAST,
            "TUM with world-to-camera poses, which are inverted: stamps in {how}",
            convert=SE3.inverse,
            how=_tum_stamps,
        )
    ),
    # only used by name
    "tum-wxyz": TrajectoryFormat(
        TrajectoryReader(
            _TUM_ROWS,
            SCALAR_FIRST,
            "TUM with the quaternion's scalar first: stamps in {how}",
            how=_tum_stamps,
        )
    ),
}

for _name, _format in FORMATS.items():
    _format.check(_name)
