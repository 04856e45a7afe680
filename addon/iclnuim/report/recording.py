"""Recordings for the Rerun viewer (.rrd): the common parts, and the recording of a sequence.

All recordings of one sequence (`of`) have the same id, so that the viewer shows them together:
`rerun sequence.rrd run.rrd`.
"""

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..console import Meter, advance_of
from ..errors import InputError, StrPath, WorkError
from ..formats.files import atomic_write, check_file, read_bytes, sha256
from ..formats.images import METRES, read_colour8
from ..formats.png import read_depth16
from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3
from ..sequences.frames import poses_at
from ..sequences.stored_sequence import StoredSequence, opened, read_depth_m

ENDING = ".rrd"
#: The colour of ground truth.
TRUTH = (220, 220, 220)
_WORLD = "world"
_CAMERA = "world/camera"
#: Distance in metres of the image plane from the camera in the 3D view.
_PLANE_M = 0.3


class Recorder:
    """Writes a recording. 3D entities are below world/, in metres, z up; the timelines are `time`
    (stamps, seconds) and `frame`.

    `rerun`: the package, for its archetypes.
    """

    def __init__(self, stream: Any, rerun: Any) -> None:
        self._stream = stream
        self.rerun = rerun
        self.static(_WORLD, rerun.ViewCoordinates.RIGHT_HAND_Z_UP)

    def at(self, stamp_s: float, frame: int) -> None:
        """Set the time of the following entries."""
        self._stream.set_time("time", duration=stamp_s)
        self._stream.set_time("frame", sequence=frame)

    def log(self, entity: str, *parts: Any) -> None:
        """Log an entry at the time set by `at`."""
        self._stream.log(entity, *parts)

    def static(self, entity: str, *parts: Any) -> None:
        """Log an entry that is valid at all times."""
        self._stream.log(entity, *parts, static=True)

    def pose(self, entity: str, T_world_camera: SE3) -> None:
        """Log a pose, camera to world."""
        R = T_world_camera.rotation
        t = T_world_camera.translation
        # not a quaternion, which rerun 0.23 does not accept with numpy < 2
        self.log(entity, self.rerun.Transform3D(translation=t, mat3x3=R))

    def camera(self, entity: str, camera: PinholeCamera) -> None:
        """Log the pinhole camera below a pose, valid at all times."""
        pinhole = self.rerun.Pinhole(
            image_from_camera=camera.K,
            resolution=[camera.width, camera.height],
            camera_xyz=self.rerun.ViewCoordinates.RDF,
            image_plane_distance=_PLANE_M,
        )
        self.static(entity, pinhole)

    def trajectory(
        self, entity: str, positions_m: np.ndarray, colour: tuple[int, int, int]
    ) -> None:
        """Log a line through positions (n, 3), valid at all times."""
        self.static(entity, self.rerun.LineStrips3D([positions_m], colors=[colour]))

    def curve(self, entity: str, name: str, colour: tuple[int, int, int]) -> None:
        """Set the name and colour of the curve of an entity's scalars."""
        self.static(entity, self.rerun.SeriesLines(names=name, colors=[colour]))

    def scalar(self, entity: str, value: float) -> None:
        """Log a value; NaN and infinity are left out."""
        if np.isfinite(value):
            self.log(entity, self.rerun.Scalars(float(value)))


def check_recording(path: Path) -> None:
    """Check a path before long work.

    Raises InputError for a name without .rrd or a missing folder, WorkError without the package
    rerun-sdk.
    """
    if path.suffix != ENDING:
        raise InputError(
            f"a recording's name ending in {ENDING}", path=path, found=path.suffix or "no ending"
        )
    check_file(path)
    _package()


def _package() -> Any:
    try:
        import rerun
    except ImportError as error:
        raise WorkError(
            f"recordings need the package rerun-sdk ({error}); try: pip install rerun-sdk"
        ) from None
    return rerun


def record(path: StrPath, of: StrPath, fill: Callable[[Recorder], None]) -> None:
    """Write a recording, filled by `fill`, atomically. `of`: the folder of a sequence or the file
    that it belongs to. Raises the same errors as check_recording, and WorkError if it cannot be
    written.
    """
    check_recording(path := Path(path))
    rerun = _package()
    number = sha256(str(Path(of).resolve()).encode())[:32]

    def write(temporary: Path) -> None:
        stream = rerun.RecordingStream("iclnuim", recording_id=number)
        with warnings.catch_warnings():  # rerun only warns about entries that it cannot log
            warnings.simplefilter("error", rerun.error_utils.RerunWarning)
            try:
                stream.save(temporary)
                fill(Recorder(stream, rerun))
            except rerun.error_utils.RerunWarning as warning:
                hint = "another version of rerun-sdk"
                found = f"{path}: rerun {rerun.__version__}: {warning}"
                raise WorkError(found, hint=hint) from None
            finally:
                stream.disconnect()

    atomic_write(path, write)


def record_sequence(
    path: StrPath,
    folder: StoredSequence | StrPath,
    progress: Meter = None,
) -> None:
    """Record colour and depth of a sequence in any format, its camera, and the ground-truth poses,
    if any. The PNG and JPEG files of colour are included unchanged, depth in its units.
    progress: as of render_frames(). Raises InputError if a file cannot be read, WorkError without
    rerun-sdk.
    """
    path = Path(path)
    sequence = opened(folder)
    pairs = sequence.pairs
    camera = sequence.camera
    truth = sequence.truth
    on_frame = advance_of(progress, len(pairs), "recording")
    poses = poses_at(sequence.stamps_s, truth)

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

    record(path, sequence.folder, fill)


def _images(recorder: Recorder, rgb: Path, depth: Path, units: float) -> None:
    read_colour8(rgb)  # raises InputError for a broken image
    content = read_bytes(rgb)
    kind = "image/png" if content.startswith(b"\x89PNG") else "image/jpeg"
    image = recorder.rerun.EncodedImage(contents=content, media_type=kind)
    recorder.log(f"{_CAMERA}/image/rgb", image)
    if depth.suffix.lower() in METRES:
        image = recorder.rerun.DepthImage(read_depth_m(depth, units), meter=1.0)
    else:
        image = recorder.rerun.DepthImage(read_depth16(depth), meter=units)
    recorder.log(f"{_CAMERA}/image/depth", image)
