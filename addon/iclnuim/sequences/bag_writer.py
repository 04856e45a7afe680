"""A sequence in one file: ROS 1 and ROS 2 bags, written by the optional package rosbags (no ROS
needed).

Topics of bags: colour (rgb8) and depth, a camera_info for each, and with ground truth
/ground_truth/pose (world <- camera, x right, y down, z forward) and /tf; with an IMU /camera/imu, and
in /tf_static where it is. Stamps are those of each image and reading of the sequence, to the
nanosecond.
"""

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from ..errors import InputError, WorkError
from ..formats.depth_units import depth16_from_metres
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory
from ..sensor.imu import ImuStream
from ..settings import Settings, setting
from ..trajectory_files.stamps import nanoseconds_of
from .frames import ImagePair
from .stored_sequence import StoredSequence

_REALSENSE = "realsense"
#: Names of topics -> those of colour and depth, and the coordinate frame of the camera.
_TOPICS = {
    "tum": ("/camera/rgb/image_color", "/camera/depth/image", "camera_rgb_optical_frame"),
    _REALSENSE: (
        "/camera/color/image_raw",
        "/camera/aligned_depth_to_color/image_raw",
        "camera_color_optical_frame",
    ),
}
_IMU = "/camera/imu"
_IMU_FRAME = "camera_imu_optical_frame"
_WORLD = "world"
_TRANSFORMS = "tf2_msgs/msg/TFMessage"


@dataclass(frozen=True)
class BagSettings(Settings):
    """Bags that are written in addition to a sequence OUT."""

    group: ClassVar[str] = "bags"

    rosbag: bool = setting(False, "also write OUT.bag (ROS 1) and OUT_ros2 (needs rosbags)")
    bag_storage: str = setting(
        "sqlite3",
        "storage format of the ROS 2 bag",
        choices={
            "sqlite3": "a database, the default of ROS 2 up to Humble",
            "mcap": "MCAP, the default after Humble",
        },
    )
    bag_names: str = setting(
        "tum",
        "topics of the bags",
        choices={
            "tum": "/camera/rgb/image_color, /camera/depth/image (32FC1, metres, NaN = missing)",
            _REALSENSE: "/camera/color/image_raw, /camera/aligned_depth_to_color/image_raw "
            "(16UC1, whole millimetres, 0 = missing)",
        },
    )
    compress_bags: bool = setting(False, "compress the bags: ROS 1 by LZ4, ROS 2 by Zstandard")

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Self:
        """Also of a mapping with `klg`, a log for ElasticFusion. Raises InputError if it is wanted,
        because such logs are not written.
        """
        if content.get("klg"):
            raise InputError(
                "bags alone", found="klg", hint="running its command again without this log"
            )
        return super().from_dict({name: content[name] for name in content if name != "klg"})

    def write(
        self, folder: Path, out: Path, note: Callable[[str], object] = lambda text: None
    ) -> list[Path]:
        """Write bags next to `out` from the sequence in `folder`.

        Returns their paths. Existing ones stay, which `note` says.
        """
        if not self.rosbag:
            return []
        beside = out.resolve()
        ros1 = beside.with_name(f"{beside.name}.bag")
        ros2 = beside.with_name(f"{beside.name}_ros2")
        written = []
        for path in (ros1, ros2):
            if path.exists():
                again = "remove it to have it written from the present frames"
                note(f"{path} exists already and is not changed; {again}")
                continue
            written.append(path)
            note(f"{path} is written")
            write_rosbag(folder, path, 1 if path == ros1 else 2, self)
            if path == ros1 and StoredSequence(folder).stamps_s.min() == 0:
                note("note: ROS 1 treats the first stamp, 0 s, as missing")
        return written


def write_rosbag(folder: Path, out: Path, ros: int, settings: BagSettings | None = None) -> int:
    """Write the pairs of a sequence as a bag: a file for `ros` 1, a folder for `ros` 2. Returns the
    number of pairs.

    Raises InputError if `out` exists already, WorkError without the package rosbags.
    """
    sequence = StoredSequence(folder)
    pairs = sequence.pairs
    truth = sequence.truth
    if out.exists():
        raise InputError("a path that does not exist yet", path=out, found="a file or folder")
    try:
        with tempfile.TemporaryDirectory(
            prefix=".bag-", dir=out.parent
        ) as scratch:  # the bag is moved when it is complete
            bag = _BagWriter(Path(scratch) / out.name, ros, settings or BagSettings())
            with bag.writer:
                for pair in pairs:
                    bag.pair(pair, sequence)
                if truth is not None:
                    bag.truth(truth)
                if sequence.imu is not None:
                    bag.imu(sequence.imu.stream)
            (Path(scratch) / out.name).rename(out)
    except OSError as error:
        raise WorkError(f"{out}: cannot write: {error.strerror or error}") from None
    return len(pairs)


class _BagWriter:
    """A bag being written: message types and connections of ROS 1 or 2."""

    def __init__(self, path: Path, ros: int, settings: BagSettings) -> None:
        try:
            from rosbags import rosbag1, rosbag2
            from rosbags.typesys import Stores, get_types_from_msg, get_typestore
        except ImportError:
            raise WorkError("bags need the package rosbags; try: pip install rosbags") from None
        self.ros = ros
        self.store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
        if _TRANSFORMS not in self.store.types:  # the store of ROS 1 does not contain it
            self.store.register(
                get_types_from_msg("geometry_msgs/TransformStamped[] transforms", _TRANSFORMS)
            )
        self.writer: Any
        if ros == 1:
            self.writer = rosbag1.Writer(path)
            if settings.compress_bags:
                self.writer.set_compression(rosbag1.Writer.CompressionFormat.LZ4)
        else:
            mcap = settings.bag_storage == "mcap"
            self.writer = rosbag2.Writer(
                path, version=8, storage_plugin=rosbag2.StoragePlugin[settings.bag_storage.upper()]
            )
            if settings.compress_bags:
                mode = rosbag2.CompressionMode.STORAGE if mcap else rosbag2.CompressionMode.MESSAGE
                self.writer.set_compression(mode, rosbag2.CompressionFormat.ZSTD)
        self.connections: dict[str, Any] = {}
        *self.topics, self.frame = _TOPICS[settings.bag_names]
        self.millimetres = settings.bag_names == _REALSENSE

    def pair(self, pair: ImagePair, sequence: StoredSequence) -> None:
        """Write both images and their camera."""
        rgb, depth = sequence.images(pair)
        stored = ("32FC1", np.where(depth > 0, depth, np.nan).astype("<f4"))
        if self.millimetres:
            stored = ("16UC1", depth16_from_metres(depth, 1000).astype("<u2"))
        images = zip(self.topics, (("rgb8", rgb), stored), pair.written, strict=True)
        for topic, (encoding, pixels), text in images:
            stamp_ns = nanoseconds_of(text or pair.stamp_s)
            data = np.ascontiguousarray(pixels).reshape(-1).view(np.uint8)
            image = self._new(
                "sensor_msgs/msg/Image",
                **self._size(stamp_ns, pixels.shape),
                encoding=encoding,
                is_bigendian=0,
                step=data.size // pixels.shape[0],
                data=data,
            )
            self._write(topic, image, stamp_ns)
            info = self._camera_info(stamp_ns, sequence.camera.pinhole)
            self._write(f"{topic.rpartition('/')[0]}/camera_info", info, stamp_ns)

    def _size(self, stamp_ns: int, shape: tuple[int, ...]) -> dict[str, Any]:
        return {"header": self._header(stamp_ns, self.frame), "height": shape[0], "width": shape[1]}

    def truth(self, truth: Trajectory) -> None:
        """Write poses, and the same poses as transforms."""
        for i, stamp_s in enumerate(truth.stamps_s.tolist()):
            stamp_ns = nanoseconds_of(stamp_s)
            T = truth.T_world_camera[i]
            header = self._header(stamp_ns, _WORLD)
            point = self._new("geometry_msgs/msg/Point", **_named("xyz", T.translation))
            rotation = self._new("geometry_msgs/msg/Quaternion", **_named("xyzw", T.quat_xyzw))
            pose = self._new("geometry_msgs/msg/Pose", position=point, orientation=rotation)
            posed = self._new("geometry_msgs/msg/PoseStamped", header=header, pose=pose)
            self._write("/ground_truth/pose", posed, stamp_ns)
            self._transform("/tf", _WORLD, self.frame, T, stamp_ns)

    def imu(self, imu: ImuStream) -> None:
        """Write the readings, with the variance of their white noise if it is known, and where the
        IMU is.
        """
        stamps_ns = imu.stamps_ns.tolist()
        T_camera_imu = imu.T_imu_camera.inverse()
        self._transform("/tf_static", self.frame, _IMU_FRAME, T_camera_imu, stamps_ns[0])
        names = ("gyroscope_noise_density", "accelerometer_noise_density")
        variances = [imu.noise.get(name, 0.0) ** 2 * imu.rate_hz for name in names]
        no_orientation = np.array([-1.0, *[0.0] * 8])
        facing = self._new("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
        for stamp_ns, reading in zip(stamps_ns, imu.readings, strict=True):
            rate, force = (
                self._new("geometry_msgs/msg/Vector3", **_named("xyz", values))
                for values in (reading[:3], reading[3:])
            )
            message = self._new(
                "sensor_msgs/msg/Imu",
                header=self._header(stamp_ns, _IMU_FRAME),
                orientation=facing,
                orientation_covariance=no_orientation,
                angular_velocity=rate,
                angular_velocity_covariance=variances[0] * np.eye(3).ravel(),
                linear_acceleration=force,
                linear_acceleration_covariance=variances[1] * np.eye(3).ravel(),
            )
            self._write(_IMU, message, stamp_ns)

    def _transform(self, topic: str, parent: str, child: str, T: SE3, stamp_ns: int) -> None:
        """Write the pose T of the frame `child` in `parent`."""
        move = self._new("geometry_msgs/msg/Vector3", **_named("xyz", T.translation))
        turn = self._new("geometry_msgs/msg/Quaternion", **_named("xyzw", T.quat_xyzw))
        named = {"header": self._header(stamp_ns, parent), "child_frame_id": child}
        transform = self._new("geometry_msgs/msg/Transform", translation=move, rotation=turn)
        stamped = self._new("geometry_msgs/msg/TransformStamped", **named, transform=transform)
        self._write(topic, self._new(_TRANSFORMS, transforms=[stamped]), stamp_ns)

    def _camera_info(self, stamp_ns: int, c: PinholeCamera) -> Any:
        sides = dict.fromkeys(("x_offset", "y_offset", "height", "width"), 0)
        roi = self._new("sensor_msgs/msg/RegionOfInterest", **sides, do_rectify=False)
        projection = np.hstack([c.K, np.zeros((3, 1))])
        matrices = {"d": np.zeros(5), "k": c.K, "r": np.eye(3), "p": projection}
        if self.ros == 1:  # their names are upper-case
            matrices = {name.upper(): matrix for name, matrix in matrices.items()}
        return self._new(
            "sensor_msgs/msg/CameraInfo",
            **self._size(stamp_ns, (c.height, c.width)),
            distortion_model="plumb_bob",
            binning_x=0,
            binning_y=0,
            roi=roi,
            **{name: matrix.ravel() for name, matrix in matrices.items()},
        )

    def _header(self, stamp_ns: int, frame: str) -> Any:
        stamp = self._new(
            "builtin_interfaces/msg/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9
        )
        more = {"seq": 0} if self.ros == 1 else {}
        return self._new("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **more)

    def _new(self, kind: str, **values: Any) -> Any:
        return self.store.types[kind](**values)

    def _write(self, topic: str, message: Any, stamp_ns: int) -> None:
        kind = message.__msgtype__
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        serialize = self.store.serialize_ros1 if self.ros == 1 else self.store.serialize_cdr
        self.writer.write(self.connections[topic], stamp_ns, serialize(message, kind))


def _named(names: str, values: np.ndarray) -> dict[str, float]:
    return dict(zip(names, values.tolist(), strict=True))
