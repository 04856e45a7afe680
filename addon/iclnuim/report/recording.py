"""Recordings for the Rerun viewer (.rrd): what all of them share, and that of a sequence.

Recordings of one sequence (`of`) carry one id, so that the viewer shows them together: `rerun sequence.rrd run.rrd`.
"""

import warnings
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from ..dataset.frames import find_pairs, read_camera, read_depth_m, read_truth
from ..dataset.layout import posed
from ..errors import InputError, WorkError
from ..formats.files import atomic_write, check_file, read_bytes, sha256
from ..formats.images import ARRAY, read_colour8
from ..formats.png import read_depth16
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from ..geometry.trajectory import Trajectory, sample

ENDING = ".rrd"
#: The colour of what is true.
TRUTH = (220, 220, 220)
_WORLD, _CAMERA = "world", "world/camera"
#: An image plane in 3D stands so far before the camera, metres.
_PLANE_M = 0.3


class Recorder:
    """A recording being written. Entities lie below world/, in metres, z up; the timelines are `time` (stamps, seconds) and `frame`.

    `rerun`: the package, for its archetypes.
    """

    def __init__(self, stream: Any, rerun: Any) -> None:
        self._stream, self.rerun = stream, rerun
        self.static(_WORLD, rerun.ViewCoordinates.RIGHT_HAND_Z_UP)

    def at(self, stamp_s: float, frame: int) -> None:
        """What follows is of this moment."""
        self._stream.set_time("time", duration=stamp_s)
        self._stream.set_time("frame", sequence=frame)

    def log(self, entity: str, *parts: Any) -> None:
        """At the moment of `at`."""
        self._stream.log(entity, *parts)

    def static(self, entity: str, *parts: Any) -> None:
        """At all moments."""
        self._stream.log(entity, *parts, static=True)

    def pose(self, entity: str, T_world_camera: SE3) -> None:
        """Camera to world."""
        R, t = T_world_camera.rotation, T_world_camera.translation
        # not a quaternion, which rerun 0.23 does not take with numpy < 2
        self.log(entity, self.rerun.Transform3D(translation=t, mat3x3=R))

    def camera(self, entity: str, camera: PinholeCamera) -> None:
        """The pinhole below a pose, at all moments."""
        size = [camera.width, camera.height]
        axes = self.rerun.ViewCoordinates.RDF
        pinhole = self.rerun.Pinhole(
            image_from_camera=camera.K, resolution=size, camera_xyz=axes, image_plane_distance=_PLANE_M
        )
        self.static(entity, pinhole)

    def trajectory(self, entity: str, positions_m: np.ndarray, colour: tuple[int, int, int]) -> None:
        """A line through positions (n, 3), at all moments."""
        self.static(entity, self.rerun.LineStrips3D([positions_m], colors=[colour]))

    def curve(self, entity: str, name: str, colour: tuple[int, int, int]) -> None:
        """How the curve of an entity's scalars is shown."""
        self.static(entity, self.rerun.SeriesLines(names=name, colors=[colour]))

    def scalar(self, entity: str, value: float) -> None:
        """NaN and infinity are left out."""
        if np.isfinite(value):
            self.log(entity, self.rerun.Scalars(float(value)))


def check_recording(path: Path) -> None:
    """Before long work. Raises InputError for a name without .rrd or a folder that is not there, WorkError without the package rerun-sdk."""
    if path.suffix != ENDING:
        raise InputError(f"a recording's name ending in {ENDING}", path=path, found=path.suffix or "no ending")
    check_file(path)
    _package()


def _package() -> Any:
    try:
        import rerun
    except ImportError as error:
        raise WorkError(f"recordings need the package rerun-sdk ({error}); try: pip install iclnuim[rerun]") from None
    return rerun


def record(path: Path | str, of: Path | str, fill: Callable[[Recorder], None]) -> None:
    """A recording filled by `fill`, whole or absent; `of`: what it belongs to, a sequence's folder or a file. Raises as check_recording does,
    and WorkError where it cannot be written.
    """
    check_recording(path := Path(path))
    rerun, number = _package(), sha256(str(Path(of).resolve()).encode())[:32]

    def write(temporary: Path) -> None:
        stream = rerun.RecordingStream("iclnuim", recording_id=number)
        with warnings.catch_warnings():  # rerun warns, and leaves out what it cannot log
            warnings.simplefilter("error", rerun.error_utils.RerunWarning)
            try:
                stream.save(temporary)
                fill(Recorder(stream, rerun))
            except rerun.error_utils.RerunWarning as warning:
                raise WorkError(
                    f"{path}: rerun {rerun.__version__}: {warning}", hint="another version of rerun-sdk"
                ) from None
            finally:
                stream.disconnect()

    atomic_write(path, write)


def record_sequence(
    path: Path | str, folder: Path | str, progress: Callable[[int], Callable[[], object]] = lambda count: lambda: None
) -> None:
    """Colour and depth of a sequence in any format, its camera, and the true poses where there are any. The PNG and JPEG files of colour go in
    as they are, depth in its own units. progress(count) returns what is called after each frame. Raises InputError for what cannot be
    read, WorkError without rerun-sdk.
    """
    path, folder = Path(path), Path(folder)
    pairs = find_pairs(folder)
    camera, truth = read_camera(folder, pairs[0].rgb), read_truth(folder)
    on_frame = progress(len(pairs))
    poses = poses_at(np.array([pair.stamp_s for pair in pairs]), truth)

    def fill(recorder: Recorder) -> None:
        recorder.camera(f"{_CAMERA}/image", camera.pinhole)
        if truth is not None:
            recorder.trajectory(f"{_WORLD}/truth", truth.positions_m, TRUTH)
        for pair, pose in zip(pairs, poses, strict=True):
            recorder.at(pair.stamp_s, pair.number)
            if pose is not None:
                recorder.pose(_CAMERA, pose)
            _images(recorder, pair.rgb, pair.depth, camera.depth_units_per_metre)
            on_frame()

    record(path, folder, fill)


def _images(recorder: Recorder, rgb: Path, depth: Path, units: float) -> None:
    read_colour8(rgb)  # what is broken is refused
    kind = "image/png" if read_bytes(rgb).startswith(b"\x89PNG") else "image/jpeg"
    recorder.log(f"{_CAMERA}/image/rgb", recorder.rerun.EncodedImage(contents=read_bytes(rgb), media_type=kind))
    metres = depth.suffix == ARRAY
    image = read_depth_m(depth, units) if metres else read_depth16(depth)
    recorder.log(f"{_CAMERA}/image/depth", recorder.rerun.DepthImage(image, meter=1.0 if metres else units))


def poses_at(stamps_s: np.ndarray, truth: Trajectory | None) -> Iterable[SE3 | None]:
    """The true pose of each of the frames at stamps (n,), None where there is none within half a frame's time."""
    if truth is None or len(truth) < 2:
        return [None] * len(stamps_s)
    poses = sample(truth, stamps_s.clip(*truth.stamps_s[[0, -1]]))
    return [poses[k] if there else None for k, there in enumerate(posed(stamps_s, truth).tolist())]
