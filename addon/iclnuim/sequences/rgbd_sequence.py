"""A sequence of RGB-D frames in Python: its frames by number, slice or iteration, its camera and
its ground truth.
"""

import base64
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from pathlib import Path
from typing import NamedTuple, overload

import numpy as np

from ..errors import InputError, StrPath
from ..evaluation.associate import nearest
from ..formats.depth_units import UNITS_PER_METRE, check_units
from ..formats.png import png_bytes
from ..geometry.camera import CameraOrText, PinholeCamera
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory
from ..sensor.imu import ImuStream
from ..sensor.transfer import srgb8
from ..shown import depth_colours, depth_range, plot_images
from .camera_files import SequenceCamera
from .frames import ImagePair, depth_stamps_s, poses_at, usual_step_s
from .stored_sequence import StoredSequence, opened

#: In place of the matrix of a pose, where arrays must have one shape.
_NO_POSE = np.full((4, 4), np.nan)


class _Images(NamedTuple):
    stamp_s: float
    rgb: np.ndarray
    depth_z_m: np.ndarray
    T_world_camera: SE3 | None


class PosedFrame(_Images):
    """One frame, unpacked as its stamp_s in seconds, rgb (h, w, 3) uint8 sRGB, depth_z_m (h, w)
    float32 planar depth in metres with 0 = missing, and T_world_camera, the true pose of the cv
    camera at the stamp, None without one. Beside them: its camera, and T_world_depth, the same pose
    at the depth image's own stamp, which sensors may take some milliseconds beside colour.
    """

    camera: PinholeCamera
    T_world_depth: SE3 | None

    @classmethod
    def of(cls, images: _Images, camera: PinholeCamera, T_world_depth: SE3 | None) -> "PosedFrame":
        """The frame of a camera."""
        frame = cls(*images)
        frame.camera = camera
        frame.T_world_depth = T_world_depth
        return frame

    def points(self, coordinates: str = "world", step: int = 1) -> np.ndarray:
        """(n, 3) metres: the surface points of the pixels with depth, row by row, of every step-th
        row and column. coordinates: world, or camera (x right, y down, z forward).

        Raises InputError for other coordinates, and in the world for a frame without a pose.
        """
        if coordinates not in ("world", "camera"):
            raise InputError("coordinates world or camera", found=coordinates)
        points = self.camera.unproject(self.depth_z_m)[::step, ::step]
        points = points[self.depth_z_m[::step, ::step] > 0]
        if coordinates == "camera":
            return points
        if self.T_world_depth is None:
            hint = 'points("camera")'
            raise InputError("a frame with a true pose", found="none", hint=hint)
        return self.T_world_depth.apply(points)

    def plot(self) -> np.ndarray:
        """Matplotlib axes (2,) of a new figure: colour, and depth with its scale."""
        return plot_images([(f"{self.stamp_s:.3f} s", self.rgb, self.depth_z_m)])[:, 0]

    def __repr__(self) -> str:
        size = "x".join(map(str, self.depth_z_m.shape[::-1]))
        return f"PosedFrame({self.stamp_s:.6f} s, {size}, {self.T_world_camera})"

    def _repr_html_(self) -> str:
        return f"{escape(repr(self))}<br>{pictures(self.rgb, self.depth_z_m)}"


@dataclass(frozen=True, eq=False, repr=False)
class RgbdSequence:
    """A sequence on disk. `sequence[i]` and iteration read the images of one frame and give it as
    (stamp_s, rgb, depth_z_m, T_world_camera); `sequence[10:20]` and `sequence[[0, 5]]` are parts,
    of which nothing is read yet. A DataLoader of PyTorch takes it as a data set.

    camera: the pinhole camera. Further: stamps_s (n,) in seconds, and the ground truth.
    """

    stored: StoredSequence
    pairs: tuple[ImagePair, ...]

    def __len__(self) -> int:
        return len(self.pairs)

    def __fspath__(self) -> str:
        """The folder, where one is taken. Raises InputError for a part of the sequence, as the
        folder has all of it.
        """
        if len(self) != len(self.stored.pairs):
            hint = "make_sequence, which writes the part into a folder"
            raise InputError("a folder", found="a part of a sequence", hint=hint)
        return str(self.folder)

    @property
    def folder(self) -> Path:
        """The folder of all frames, or the bag."""
        return self.stored.folder

    @property
    def camera(self) -> PinholeCamera:
        """The camera of depth and colour."""
        return self.stored.camera.pinhole

    @cached_property
    def imu_stream(self) -> ImuStream | None:
        """The IMU around the frames: its readings, stamps and mounting; None without any."""
        imu = self.stored.imu
        return None if imu is None else imu.around(self.stamps_s).stream

    @property
    def imu(self) -> np.ndarray | None:
        """(n, 6) readings of the IMU from before the first to after the last frame: rotation rate in
        rad/s, specific force in m/s^2; None without any.
        """
        return None if self.imu_stream is None else self.imu_stream.readings

    @property
    def imu_stamps_s(self) -> np.ndarray | None:
        """(n,) seconds of the readings; None without any."""
        return None if self.imu_stream is None else self.imu_stream.stamps_s

    @cached_property
    def poses(self) -> list[SE3 | None]:
        """The true pose of the cv camera of each frame, None for a frame without one."""
        return poses_at(self.stamps_s, self.stored.truth, self._step_s)

    @cached_property
    def depth_poses(self) -> list[SE3 | None]:
        """The same at the stamp of each frame's depth image."""
        return poses_at(depth_stamps_s(self.pairs), self.stored.truth, self._step_s)

    @property
    def _step_s(self) -> float:
        return usual_step_s(self.stored.stamps_s)

    @cached_property
    def stamps_s(self) -> np.ndarray:
        """(n,) seconds."""
        return np.array([pair.stamp_s for pair in self.pairs])

    @cached_property
    def truth(self) -> Trajectory | None:
        """The ground truth of these frames at its own rate, right-handed, of the cv camera; None
        without one.
        """
        whole = self.stored.truth
        if whole is None or not len(self):
            return None
        off_s = nearest(whole.stamps_s, self.stamps_s)[1]
        rows = np.flatnonzero(off_s <= 0.5 * self._step_s + 1e-6)
        return whole[rows] if len(rows) else None

    @overload
    def __getitem__(self, index: int | np.integer) -> PosedFrame: ...

    @overload
    def __getitem__(self, index: slice | Sequence[int] | np.ndarray) -> "RgbdSequence": ...

    def __getitem__(
        self, index: int | np.integer | slice | Sequence[int] | np.ndarray
    ) -> "PosedFrame | RgbdSequence":
        """A frame, or a part of the sequence: a slice, numbers of frames, or a mask (n,).

        Raises InputError for images that cannot be read, IndexError beyond the last frame.
        """
        if isinstance(index, slice):
            return replace(self, pairs=self.pairs[index])
        try:
            chosen = np.arange(len(self))[index if np.ndim(index) else int(index)]  # type: ignore[arg-type]
        except IndexError:
            raise IndexError(f"no frame {index}: the sequence has {len(self)} frames") from None
        except (TypeError, ValueError):
            raise InputError(
                "a number of a frame, a slice, numbers or a mask", found=index
            ) from None
        if np.ndim(chosen):
            return replace(self, pairs=tuple(self.pairs[i] for i in chosen))
        pair = self.pairs[chosen]
        rgb, depth_z_m = self.stored.images(pair)
        images = _Images(pair.stamp_s, rgb, depth_z_m, self.poses[chosen])
        return PosedFrame.of(images, self.camera, self.depth_poses[chosen])

    def __getitems__(self, indices: Sequence[int]) -> list[tuple]:
        """What a DataLoader of PyTorch asks for, which joins arrays: (stamp_s, rgb, depth_z_m,
        matrix of the pose (4, 4)) of each frame, NaN where there is no pose.
        """
        frames = (self[i] for i in indices)
        return [(*one[:3], _NO_POSE if one[3] is None else one[3].matrix) for one in frames]

    def points(self, coordinates: str = "world", step: int = 8) -> np.ndarray:
        """(n, 3) metres: PosedFrame.points() of all frames, one after the other; in the world, of
        those with a pose. Raises InputError if there is none.
        """
        rows = list(range(len(self)))
        if coordinates == "world":
            rows = [i for i in rows if self.depth_poses[i] is not None]
        if not rows:
            expected, hint = "frames with true poses", 'points("camera")'
            raise InputError(expected, path=self.folder, found="none", hint=hint)
        return np.concatenate([self[i].points(coordinates, step) for i in rows])

    def plot(self, count: int = 4) -> np.ndarray:
        """Matplotlib axes (2, count) of a new figure: colour above depth of frames that are evenly
        chosen. Raises InputError for a sequence without frames.
        """
        if not len(self):
            raise InputError("a sequence with frames", path=self.folder, found="none")
        rows = np.unique(np.linspace(0, len(self) - 1, count).round().astype(int))
        frames = [(i, self[i]) for i in rows]
        return plot_images([(f"{i}: {f.stamp_s:.3f} s", f.rgb, f.depth_z_m) for i, f in frames])

    def __iter__(self) -> Iterator[PosedFrame]:
        return (self[i] for i in range(len(self)))

    def __repr__(self) -> str:
        camera = self.camera
        words = [str(self.folder), f"{len(self)} frames of {camera.width}x{camera.height}"]
        if len(self):
            words.append(f"{self.stamps_s[0]:.3f}..{self.stamps_s[-1]:.3f} s")
        words.append("no ground truth" if self.truth is None else f"{len(self.truth)} true poses")
        return f"RgbdSequence({', '.join(words)})"

    def _repr_html_(self) -> str:
        """The description, and the first frame."""
        shown = self[0]._repr_html_() if len(self) else ""
        return f"<b>{escape(repr(self))}</b><br>{shown}"


def pictures(rgb: np.ndarray, depth_z_m: np.ndarray) -> str:
    """HTML of colour (h, w, 3), uint8 or scene-linear, beside depth (h, w) in metres by colour,
    with a bar below; black is missing.
    """
    colour = rgb if rgb.dtype == np.uint8 else srgb8(rgb)
    near_m, far_m = depth_range(depth_z_m)
    bar = depth_colours(np.linspace(near_m or 1e-6, far_m, 160)[None].repeat(8, 0), near_m, far_m)
    images = np.hstack([colour, depth_colours(depth_z_m, near_m, far_m)])
    return f"{_img(images)}<br>depth {near_m:.2f} m {_img(bar)} {far_m:.2f} m"


def _img(image: np.ndarray) -> str:
    data = base64.b64encode(png_bytes(np.ascontiguousarray(image))).decode()
    return f'<img src="data:image/png;base64,{data}">'


def open_sequence(
    folder: StoredSequence | StrPath,
    camera: CameraOrText | None = None,
    depth_units_per_metre: float = UNITS_PER_METRE,
) -> RgbdSequence:
    """Open a sequence in any known format, also a ROS bag, or one that is stored: its frames are
    read when they are asked for.

    camera: where no file contains it, a PinholeCamera or its text `WIDTHxHEIGHT,FX,FY,CX,CY`;
    depth_units_per_metre belongs to it. Raises InputError if there are no pairs of images, no
    camera, or a ground truth that cannot be read.
    """
    sequence = opened(folder)
    pairs = tuple(sequence.pairs)
    if camera is not None:
        pinhole = PinholeCamera.of(camera)
        given = SequenceCamera(pinhole, check_units(depth_units_per_metre))
        sequence = sequence.with_camera(given)
    elif depth_units_per_metre != UNITS_PER_METRE:
        raise InputError("a camera with depth_units_per_metre", found="none")
    sequence.check()
    return RgbdSequence(sequence, pairs)
