"""Poses in bags: of a topic of poses, odometry or a path, or of /tf; composed along the tree of
coordinate frames until that of the depth images.
"""

from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..errors import InputError, within
from ..formats.bags import Bag, frame_of, image_topics, stamp_ns
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory, sample
from .number_table import NumberTable
from .source import Source

_PATH = "nav_msgs/msg/Path"
_TRANSFORM = "geometry_msgs/msg/TransformStamped"
_POSES = (
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    _TRANSFORM,
    "nav_msgs/msg/Odometry",
    _PATH,
)
_TREES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_AS_CAMERA = "taken as the camera (x right, y down, z forward)"


class NoPosesError(InputError):
    """The error for a bag without poses of the camera. moves_others: whether /tf moves frames that
    no transforms lead from to the camera's.
    """

    moves_others = False


@dataclass(eq=False)
class _Edge:
    """Poses of a coordinate frame in its parent: (stamp in nanoseconds, x y z qx qy qz qw)."""

    parent: str
    child: str
    rows: list[tuple[int, tuple[float, ...]]] = field(default_factory=list)
    lost: int = 0

    def add(self, stamp: int, translation: Any, rotation: Any) -> None:
        quaternion = (rotation.x, rotation.y, rotation.z, rotation.w)
        if any(quaternion):
            self.rows.append((stamp, (translation.x, translation.y, translation.z, *quaternion)))
        else:
            self.lost += 1

    @property
    def values(self) -> np.ndarray:
        """(n, 7) in the order of time."""
        return np.array([pose for _, pose in sorted(self.rows)]).reshape(-1, 7)

    @property
    def stamps_s(self) -> np.ndarray:
        return np.array([stamp / 1e9 for stamp, _ in sorted(self.rows)])

    @property
    def moves(self) -> bool:
        return bool(len(self.rows) > 1 and np.ptp(self.values, axis=0).max() > 0)

    def trajectory(self) -> Trajectory:
        stamps_s, first = np.unique(self.stamps_s, return_index=True)
        values = self.values[first]
        return Trajectory(stamps_s, SE3.from_quat_xyzw(values[:, 3:], values[:, :3]))


def rows(source: Source) -> NumberTable:
    """(n, 8) of a bag. Raises InputError, with the topics, if none or several fit; NoPosesError if
    nothing in it moves.
    """
    with Bag(source.path) as bag, within(bag.path):
        topics = bag.topics_of(*_POSES)
        if not topics or set(bag.given).intersection(bag.topics_of(*_TREES)):
            return _of_tree(bag)
        return _of_topic(bag, bag.only(topics, "poses"))


def _of_topic(bag: Bag, topic: str) -> NumberTable:
    edge = _edge_of(bag, topic)
    name = f"{topic} ({bag.types[topic].split('/')[-1]})"
    camera = _camera_frame(bag)
    if edge.child and camera and edge.child != camera:
        edges = [edge, *_edges(bag, but=edge.child)]
        chain = _chain(bag, edges, camera, edge.parent)
        if edge in chain:
            said = f"{name} of {edge.child} in {edge.parent}, moved to {camera} by /tf"
            return _table(bag, chain, said)
    body = f"of {edge.child or 'a frame that is not named'} in {edge.parent}"
    if not edge.child or edge.child != camera:
        body += f", {_AS_CAMERA}"
    if edge.child and camera and edge.child != camera:
        body += f": /tf has no transforms from {edge.child} to {camera}, the frame of the images"
    return _table(bag, [edge], f"{name} {body}")


def _edge_of(bag: Bag, topic: str) -> _Edge:
    """The poses of a topic; of a path, which grows from message to message, the last one."""
    first = bag.first(topic)
    if bag.types[topic] == _PATH:
        _, time_ns, content = deque(bag.raw([topic]), maxlen=1)[0]
        path = bag.message(topic, content)
        edge = _Edge(frame_of(path.header.frame_id), "")
        for one in path.poses:
            edge.add(stamp_ns(one.header, time_ns), one.pose.position, one.pose.orientation)
        return edge
    edge = _Edge(bag.frame(topic), frame_of(getattr(first, "child_frame_id", "")))
    for _, time_ns, message in bag.messages([topic]):
        stamp = stamp_ns(message.header, time_ns)
        if bag.types[topic] == _TRANSFORM:
            edge.add(stamp, message.transform.translation, message.transform.rotation)
        else:
            pose = getattr(message.pose, "pose", message.pose)
            edge.add(stamp, pose.position, pose.orientation)
    return edge


def _camera_frame(bag: Bag) -> str:
    """The coordinate frame of the depth images; "" if it is not known."""
    with suppress(InputError):
        return bag.frame(image_topics(bag).depth)
    return ""


def _edges(bag: Bag, but: str = "") -> list[_Edge]:
    """The transforms of the tree, without those that place the frame `but`."""
    found: dict[tuple[str, str], _Edge] = {}
    for _, time_ns, message in bag.messages(bag.topics_of(*_TREES)):
        for one in message.transforms:
            key = (frame_of(one.header.frame_id), frame_of(one.child_frame_id))
            edge = found.setdefault(key, _Edge(*key))
            move = one.transform
            edge.add(stamp_ns(one.header, time_ns), move.translation, move.rotation)
    return [edge for edge in found.values() if edge.rows and edge.child != but]


def _chain(bag: Bag, edges: Sequence[_Edge], frame: str, root: str = "") -> list[_Edge]:
    """The edges from `root`, or from the frame without a parent, to `frame`."""
    chain: list[_Edge] = []
    while frame != root:
        above = [edge for edge in edges if edge.child == frame]
        if len(above) > 1 or len(chain) > len(edges):
            parents = ", ".join(edge.parent for edge in above)
            raise bag.error(f"one parent of the frame {frame} in /tf", parents)
        if not above:
            break
        chain.insert(0, above[0])
        frame = above[0].parent
    return chain


def constant_transform(bag: Bag, frame: str, other: str) -> SE3 | None:
    """The pose of a frame in another one by the transforms of /tf and /tf_static that do not change;
    None if they do not lead there. Raises InputError if they are no tree.
    """
    if frame == other:
        return SE3.identity()
    still = [edge for edge in _edges(bag) if not edge.moves]
    poses, roots = [], []
    for each in (other, frame):
        chain = _chain(bag, still, each)
        T = SE3.identity()
        for edge in chain:
            T = T @ edge.trajectory().T_world_camera[0]
        poses.append(T)
        roots.append(chain[0].parent if chain else each)
    return poses[0].inverse() @ poses[1] if roots[0] == roots[1] else None


def _of_tree(bag: Bag) -> NumberTable:
    edges = _edges(bag)
    camera = _camera_frame(bag)
    leaves = {edge.child for edge in edges} - {edge.parent for edge in edges}
    if not camera and len(leaves) > 1:
        expected = "images, or one last frame of /tf, to know the camera's frame"
        raise bag.error(expected, ", ".join(sorted(leaves)))
    chain = _chain(bag, edges, camera or next(iter(leaves), ""))
    if not any(edge.moves for edge in chain):
        found = f"{bag.described(bag.types)}, and no transform that moves the camera {camera}"
        moved = ", ".join(edge.child for edge in edges if edge.moves)
        if moved:
            found = f"/tf moves {moved}, and has no transforms from there to {camera}"
        expected = f"poses: a topic of {', '.join(one.split('/')[-1] for one in _POSES)}, or /tf"
        error = NoPosesError(expected, path=bag.path, found=found)
        error.moves_others = bool(moved)
        raise error
    frames = " > ".join([chain[0].parent, *(edge.child for edge in chain)])
    return _table(bag, chain, f"/tf: {frames}" + ("" if camera else f", {_AS_CAMERA}"))


def _table(bag: Bag, chain: Sequence[_Edge], said: str) -> NumberTable:
    """The poses of the last frame in the first one, at the stamps of the edge with most stamps of
    those that move; the others are interpolated.
    """
    moving = [edge for edge in chain if edge.moves] or list(chain[:1])
    leading = max(moving, key=lambda edge: len(edge.rows))
    if not leading.rows:
        raise bag.error("poses", "none with a rotation")
    stamps_s = leading.stamps_s
    values = leading.values
    if len(chain) > 1:
        for edge in moving:
            first, last = edge.stamps_s[[0, -1]]
            stamps_s = stamps_s[(stamps_s >= first) & (stamps_s <= last)]
        if not len(stamps_s):
            raise bag.error("transforms that overlap in time", said)
        T = SE3.identity((len(stamps_s),))
        for edge in chain:
            poses = edge.trajectory()
            T = T @ (sample(poses, stamps_s) if edge in moving else poses.T_world_camera[:1])
        values = np.hstack([T.translation, T.quat_xyzw])
    note = f"; {said}"
    if lost := sum(edge.lost for edge in chain):
        note += f"; {lost} poses without a rotation are left out"
    rows = np.column_stack([stamps_s, values])
    return NumberTable(rows, lambda row: (bag.path, None), 1.0, note=note)
