"""Bags with the topics of other recorders, written message by message."""

import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np

_TF = "tf2_msgs/msg/TFMessage"


class Recording:
    """A bag being written as a context: ROS 1 for names that end in .bag, else ROS 2."""

    def __init__(self, path: Path, **ros2: Any) -> None:
        from rosbags import rosbag1, rosbag2
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self.one = path.suffix == ".bag"
        self.store = get_typestore(Stores.ROS1_NOETIC if self.one else Stores.ROS2_HUMBLE)
        for name in (_TF, "tf/msg/tfMessage"):
            if name not in self.store.types:
                text = "geometry_msgs/TransformStamped[] transforms"
                self.store.register(get_types_from_msg(text, name))
        self.writer: Any
        if self.one:
            self.writer = rosbag1.Writer(path)
        else:
            storage = rosbag2.StoragePlugin[ros2.get("storage", "sqlite3").upper()]
            self.writer = rosbag2.Writer(path, version=8, storage_plugin=storage)
        self.connections: dict[str, Any] = {}

    def __enter__(self) -> "Recording":
        self.writer.open()
        return self

    def __exit__(self, *error: object) -> None:
        self.writer.close()

    def new(self, kind: str, **values: Any) -> Any:
        return self.store.types[kind](**values)

    def header(self, stamp_ns: int, frame: str) -> Any:
        stamp = self.new(
            "builtin_interfaces/msg/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9
        )
        more = {"seq": 0} if self.one else {}
        return self.new("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **more)

    def write(self, topic: str, message: Any, recorded_ns: int) -> None:
        kind = message.__msgtype__
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        serialize = self.store.serialize_ros1 if self.one else self.store.serialize_cdr
        self.writer.write(self.connections[topic], recorded_ns, serialize(message, kind))

    def image(
        self, topic: str, stamp_ns: int, pixels: np.ndarray, encoding: str, **more: Any
    ) -> None:
        """Pixels (h, w) or (h, w, c), in rows of `padding` further bytes; `big`: big-endian."""
        if more.get("big"):
            pixels = pixels.astype(pixels.dtype.newbyteorder(">"))
        rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(len(pixels), -1)
        rows = np.pad(rows, ((0, 0), (0, more.get("padding", 0))), constant_values=99)
        message = self.new(
            "sensor_msgs/msg/Image",
            header=self.header(stamp_ns, more.get("frame", "optical")),
            height=pixels.shape[0],
            width=pixels.shape[1],
            encoding=encoding,
            is_bigendian=int(more.get("big", False)),
            step=rows.shape[1],
            data=rows.reshape(-1),
        )
        self.write(topic, message, more.get("recorded_ns", stamp_ns or 5))

    def imu(self, topic: str, stamp_ns: int, reading: np.ndarray, frame: str = "optical") -> None:
        """A reading (6,): rotation rate and specific force."""
        vectors = [
            self.new("geometry_msgs/msg/Vector3", **dict(zip("xyz", part.tolist(), strict=True)))
            for part in (reading[:3], reading[3:])
        ]
        message = self.new(
            "sensor_msgs/msg/Imu",
            header=self.header(stamp_ns, frame),
            orientation=self.new("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
            orientation_covariance=np.zeros(9),
            angular_velocity=vectors[0],
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=vectors[1],
            linear_acceleration_covariance=np.zeros(9),
        )
        self.write(topic, message, stamp_ns)

    def compressed(
        self, topic: str, stamp_ns: int, data: bytes, format: str, frame: str = "optical"
    ) -> None:
        header = self.header(stamp_ns, frame)
        kind = "sensor_msgs/msg/CompressedImage"
        content = np.frombuffer(data, np.uint8)
        self.write(topic, self.new(kind, header=header, format=format, data=content), stamp_ns)

    def info(self, topic: str, stamp_ns: int, camera: Any, **more: Any) -> None:
        """The camera of the images as K; `d`: distortion, `p`: another camera as P."""
        roi = self.new(
            "sensor_msgs/msg/RegionOfInterest",
            x_offset=0,
            y_offset=0,
            height=0,
            width=0,
            do_rectify=False,
        )
        projection = np.hstack([more.get("p", camera).K, np.zeros((3, 1))])
        distortion = np.array(more.get("d", np.zeros(5)), float)
        matrices = {"d": distortion, "k": camera.K, "r": np.eye(3), "p": projection}
        message = self.new(
            "sensor_msgs/msg/CameraInfo",
            header=self.header(stamp_ns, more.get("frame", "optical")),
            height=camera.height,
            width=camera.width,
            distortion_model="plumb_bob",
            binning_x=0,
            binning_y=0,
            roi=roi,
            **{k.upper() if self.one else k: np.ravel(v).copy() for k, v in matrices.items()},
        )
        self.write(topic, message, stamp_ns)

    def pose_of(self, seven: Any) -> Any:
        x, y, z, *turn = map(float, seven)
        rotation = self.new("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", turn, strict=True)))
        point = self.new("geometry_msgs/msg/Point", x=x, y=y, z=z)
        return self.new("geometry_msgs/msg/Pose", position=point, orientation=rotation)

    def pose(
        self,
        topic: str,
        kind: str,
        stamp_ns: int,
        seven: Any,
        frame: str = "world",
        child: str = "",
    ) -> None:
        """x y z qx qy qz qw as a PoseStamped, PoseWithCovarianceStamped, Odometry or
        TransformStamped.
        """
        pose = self.pose_of(seven)
        values = {"header": self.header(stamp_ns, frame)}
        with_covariance = "geometry_msgs/msg/PoseWithCovariance"
        if kind == "TransformStamped":
            self.write(topic, self.transform(stamp_ns, frame, child, seven), stamp_ns)
            return
        if kind == "PoseStamped":
            values["pose"] = pose
        else:
            values["pose"] = self.new(with_covariance, pose=pose, covariance=np.zeros(36))
        if kind == "Odometry":
            zero = self.new("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
            twist = self.new("geometry_msgs/msg/Twist", linear=zero, angular=zero)
            name = "geometry_msgs/msg/TwistWithCovariance"
            values["twist"] = self.new(name, twist=twist, covariance=np.zeros(36))
            values["child_frame_id"] = child
        room = "nav_msgs" if kind == "Odometry" else "geometry_msgs"
        self.write(topic, self.new(f"{room}/msg/{kind}", **values), stamp_ns)

    def path(self, topic: str, stamps_ns: Any, poses: Any, frame: str = "world") -> None:
        """A path that grows by a pose in every message."""
        stamped = []
        for stamp_ns, seven in zip(stamps_ns, poses, strict=True):
            header = self.header(stamp_ns, frame)
            kind = "geometry_msgs/msg/PoseStamped"
            stamped.append(self.new(kind, header=header, pose=self.pose_of(seven)))
            path = self.new("nav_msgs/msg/Path", header=header, poses=list(stamped))
            self.write(topic, path, stamp_ns)

    def transform(self, stamp_ns: int, parent: str, child: str, seven: Any) -> Any:
        pose = self.pose_of(seven)
        place = pose.position
        move = self.new("geometry_msgs/msg/Vector3", x=place.x, y=place.y, z=place.z)
        kind = "geometry_msgs/msg/Transform"
        return self.new(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(stamp_ns, parent),
            child_frame_id=child,
            transform=self.new(kind, translation=move, rotation=pose.orientation),
        )

    def transforms(self, topic: str, stamp_ns: int, edges: Any, kind: str = _TF) -> None:
        """(parent, child, x y z qx qy qz qw) at one time."""
        messages = [self.transform(stamp_ns, *edge) for edge in edges]
        self.write(topic, self.new(kind, transforms=messages), stamp_ns)


def png_of(pixels: np.ndarray) -> bytes:
    return cv2.imencode(".png", pixels)[1].tobytes()


def compressed_depth(pixels: np.ndarray, a: float = 0.0, b: float = 0.0) -> bytes:
    """As compressed_depth_image_transport: an enumeration, the quantisation, a PNG."""
    return struct.pack("<iff", 0, a, b) + png_of(pixels)
