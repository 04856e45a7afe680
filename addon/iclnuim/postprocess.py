"""Noise, sequences and trajectory error for use from Python, inside or outside Blender: a thin
layer over the library.

    from iclnuim import postprocess

    postprocess.make_sequence(
        "out/living_room/kt2/raw", "noisy", depth_noise="released", rgb_noise="released", seed=1
    )
    error = postprocess.absolute_trajectory_error("noisy/groundtruth.txt", "estimate.txt")
    print(error.translation_m.rmse)
"""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from .console import Meter, advance_of
from .doubt.given_arrays import doubt_of_depth, doubt_of_rgb, warn
from .errors import InputError, StrPath
from .evaluation.absolute_error import AbsoluteError, AbsoluteErrorSettings
from .evaluation.align import AlignmentSettings
from .evaluation.relative_error import RelativeError, RelativeErrorSettings
from .formats.files import sha256
from .geometry.camera import CameraOrText, PinholeCamera
from .geometry.se3 import SE3, Poses
from .geometry.trajectory import Trajectory
from .report.trajectory_report import ComparedFile, Report
from .sensor.appearance import SurfaceAppearance
from .sensor.imu_noise import ImuNoise, imu_noise
from .sensor.models import NamedNoise, depth_model, rgb_model, with_depth_noise
from .sensor.noise_model import DEPTH, RGB, frame_generator
from .sensor.phone import PhoneDepthNoise
from .sequences.frame_source import FrameSource, image_frames, run_frames
from .sequences.pose_lines import tied_to_poses
from .sequences.rgbd_sequence import RgbdSequence
from .sequences.sequence_options import SequenceSettings
from .sequences.stored_sequence import StoredSequence
from .sequences.writer import WrittenSequence, write_sequence
from .trajectory_files.source import OWN_WORLD
from .trajectory_files.trajectories import (
    LoadedTrajectory,
    ReadAs,
    read_trajectory,
    trajectory_text,
)

Settings = Mapping[str, Any]
TrajectoryOrFile = Trajectory | Poses | StrPath
#: Poses from Python, which need no other reading of a file.
_AS_GIVEN = ReadAs("replica", "right", OWN_WORLD, "poses as given")
#: What images must be, and what to try if they hold whole numbers.
_METRES = "depth in metres", "dividing by the units per metre (TUM: 5000)"
_LINEAR_RGB = "scene-linear RGB with 1 = white", "iclnuim.linear_from_srgb8 for 8-bit images"


def noisy_depth(
    depth_z_m: np.ndarray,
    model: NamedNoise = "paper",
    camera: CameraOrText | None = None,
    seed: int = 0,
    frame: int = 0,
    settings: Settings | None = None,
    rgb: np.ndarray | None = None,
    albedo: np.ndarray | float | None = None,
    normals: np.ndarray | None = None,
) -> np.ndarray:
    """Add the noise of a sensor model to planar depth (h, w) in metres, 0 = missing. Returns
    float32 of the same shape. Of a batch (n, h, w), image k gets the noise of frame number
    `frame` + k.

    model: a key of DEPTH_MODELS, a function(depth_z_m, camera, rng) or its `module:function`;
    settings: settings of the model, by name (docs/guide/sensor.md). camera: or its text; default is
    the benchmark's camera, scaled to the image's width. The noise depends only on seed and frame
    number. rgb, albedo, normals: for models of sensors that see more than distance
    (docs/guide/sensors.md), one image for each depth image. rgb: scene-linear (..., h, w, 3), 1 =
    white, or sRGB uint8; its luminance stands for the reflectance unless albedo (..., h, w), 0..1,
    or one number is given. normals: (..., h, w, 3) unit vectors in the camera's frame (x right, y
    down, z forward); default: those of the depth image. Raises InputError for an unknown model or
    setting, for whole numbers, for another shape or size than the camera's, and for a model that
    asks for colour or albedo if there is neither.
    """
    depth_z_m = _floating(depth_z_m, *_METRES)
    if depth_z_m.ndim not in (2, 3) or (depth_z_m.ndim == 3 and depth_z_m.shape[2] == 1):
        hint = "depth[..., 0]" if depth_z_m.shape[-1:] == (1,) else None
        expected = "depth (h, w), or a batch (n, h, w), in metres"
        raise InputError(expected, found=depth_z_m.shape, hint=hint)
    camera = _camera_of(depth_z_m, camera)
    noise = depth_model(model, settings)

    def noisy(image: np.ndarray, number: int, **given: Any) -> np.ndarray:
        seen = SurfaceAppearance.given(image.shape, **given)
        rng = frame_generator(seed, number, DEPTH)
        noisy_z_m = np.asarray(with_depth_noise(noise, image, camera, rng, seen))
        return np.where(np.isfinite(noisy_z_m), noisy_z_m, noisy_z_m.dtype.type(0))

    warn(_doubt_of_images(depth_z_m, rgb))
    given = {"rgb": rgb, "albedo": albedo, "normals": normals}
    if depth_z_m.ndim == 2:
        return noisy(depth_z_m, frame, **given)
    given_of = _image_by_image(len(depth_z_m), **given)
    return np.stack([noisy(image, frame + k, **given_of(k)) for k, image in enumerate(depth_z_m)])


def phone_depth(
    depth_z_m: np.ndarray,
    camera: CameraOrText | None = None,
    seed: int = 0,
    frame: int = 0,
    settings: Settings | None = None,
    rgb: np.ndarray | None = None,
    albedo: np.ndarray | float | None = None,
) -> tuple[np.ndarray, np.ndarray, PinholeCamera]:
    """What a phone with LiDAR gives of planar depth (h, w) in metres, 0 = missing: its depth (192,
    256) in metres, float32; its confidence (0 low, 1 medium, 2 high), uint8; and its camera.

    The arguments and errors are those of noisy_depth with the model `phone`.
    """
    depth_z_m = _floating(depth_z_m, *_METRES)
    if depth_z_m.ndim != 2:
        raise InputError("depth (h, w) in metres", found=depth_z_m.shape)
    camera = _camera_of(depth_z_m, camera)
    model = PhoneDepthNoise.from_dict(settings or {})
    warn(_doubt_of_images(depth_z_m, rgb))
    seen = SurfaceAppearance.given(depth_z_m.shape, rgb, albedo)
    rng = frame_generator(seed, frame, DEPTH)
    return *model.with_confidence(depth_z_m, camera, rng, seen), model.native_camera(camera)


def _doubt_of_images(depth_z_m: np.ndarray, rgb: np.ndarray | None) -> str:
    """Sentences on planar depth in metres and scene-linear RGB, if there is one."""
    is_linear = rgb is not None and np.asarray(rgb).dtype.kind == "f"
    found = doubt_of_depth(depth_z_m), doubt_of_rgb(np.asarray(rgb)) if is_linear else ""
    return "; ".join(filter(None, found))


def _camera_of(depth_z_m: np.ndarray, camera: CameraOrText | None) -> PinholeCamera:
    """The camera of depth (..., h, w). Raises InputError for one of another size."""
    height, width = depth_z_m.shape[-2:]
    camera = PinholeCamera.of(camera or f"{width}x{height}")
    if (height, width) != (camera.height, camera.width):
        expected = f"depth of the camera's size {camera.width}x{camera.height}"
        raise InputError(expected, found=(width, height))
    return camera


def _image_by_image(count: int, **arrays: Any) -> Callable[[int], dict[str, Any]]:
    """k -> the k-th image of each array. Numbers and None are the same for all. Raises InputError
    for an array of another number of images.
    """
    for name, array in arrays.items():
        if np.ndim(array) and len(np.asarray(array)) != count:
            raise InputError(f"{name} for each of {count} images", found=np.shape(array))
    return lambda k: {name: a[k] if np.ndim(a) else a for name, a in arrays.items()}


def noisy_rgb(
    rgb: np.ndarray,
    model: NamedNoise = "paper",
    seed: int = 0,
    frame: int = 0,
    settings: Settings | None = None,
) -> np.ndarray:
    """Convert scene-linear RGB (h, w, 3), 1 = white, to sRGB (h, w, 3) uint8 with the noise of a
    sensor model.

    model: a key of RGB_MODELS, a function(light, rng) or its `module:function`; settings: settings
    of the model, by name (docs/guide/sensor.md). The noise depends only on seed and frame number.
    Raises InputError for an unknown model or setting, and for whole numbers.
    """
    rgb = _floating(rgb, *_LINEAR_RGB)
    warn(doubt_of_rgb(rgb))
    return rgb_model(model, settings).apply(rgb, frame_generator(seed, frame, RGB))


def _floating(image: np.ndarray, expected: str, hint: str) -> np.ndarray:
    """Raises InputError for an image without pixels, and for whole numbers: they are the values of
    an image file, in another unit.
    """
    image = np.asarray(image)
    if not image.size:
        raise InputError(expected, found=f"an array {image.shape}")
    if image.dtype.kind != "f":
        raise InputError(f"{expected}, as floating-point numbers", found=image.dtype, hint=hint)
    return image


def make_sequence(
    frames: RgbdSequence | FrameSource | StrPath,
    out: StrPath,
    depth_noise: NamedNoise = "none",
    rgb_noise: NamedNoise = "none",
    seed: int = 0,
    formats: Sequence[str] = ("tum",),
    depth_settings: Settings | None = None,
    rgb_settings: Settings | None = None,
    workers: int | None = None,
    progress: Meter = None,
    imu: ImuNoise | str = "none",
) -> WrittenSequence:
    """Write a sequence, with noise if it is asked for. An interrupted sequence is resumed.

    frames: the folder of a run or of any sequence, a sequence or a part of it (open_sequence), or
    frames of your own (frames_from). depth_noise, rgb_noise: names, `module:function` or functions
    of images (h, w) and (h, w, 3), as for noisy_depth and noisy_rgb. formats: names in
    sequences/sequence_formats.py. Several formats are written into a folder each. workers: processes,
    by default as many as cores. progress: as of render_frames(). imu: the noise of the readings, if
    `frames` has an IMU: `bmi055`, `adis16448` or an ImuNoise.

    Raises InputError if `frames` contains no frames or `out` contains another sequence, and
    WorkError if a file cannot be written.
    """
    source = _source(frames)
    if callable(depth_noise) or callable(rgb_noise):
        source = replace(source, volatile=True)
    settings = SequenceSettings(
        depth_model(depth_noise, depth_settings),
        rgb_model(rgb_noise, rgb_settings),
        seed,
        imu=imu_noise(imu),
    )
    advance = advance_of(progress, len(source.numbers), "sequence")
    names = (formats,) if isinstance(formats, str) else formats
    written = write_sequence(source, Path(out), settings, names, workers, lambda number: advance())
    lost = [f"{pixels} {kind}" for kind, pixels in written.lost_depth.items()]
    found = [f"depth values set to 0: {', '.join(lost)}"] if lost else []
    if source.volatile:
        rgb, depth_z_m = source.load(source.numbers[len(source.numbers) // 2])
        found.append(_doubt_of_images(depth_z_m, rgb))
    warn("; ".join(filter(None, found)))
    return written


def convert_sequence(
    sequence: RgbdSequence | StrPath, out: StrPath, format: str, progress: Meter = None
) -> WrittenSequence:
    """Write a sequence, its folder or a part of it in another format, without noise; images that
    the format stores in the same way are copied byte for byte. Raises the errors of make_sequence.
    """
    return make_sequence(sequence, out, formats=(format,), progress=progress)


def _source(frames: RgbdSequence | FrameSource | StrPath) -> FrameSource:
    if isinstance(frames, FrameSource):
        return frames
    if isinstance(frames, RgbdSequence):
        whole = image_frames(frames.stored)
        return replace(whole, numbers=tuple(sorted(pair.number for pair in frames.pairs)))
    folder = Path(frames)
    return run_frames(folder) if (folder / "exr").is_dir() else image_frames(folder)


def frames_from(
    camera: CameraOrText,
    trajectory: Trajectory | Poses,
    load: Callable[[int], tuple[np.ndarray, np.ndarray]],
    name: str = "own",
) -> FrameSource:
    """Frames of your own renderer or simulator, for make_sequence. Frame i has stamp i and pose i
    of the trajectory, or pose i of matrices (n, 4, 4) and the stamp 1 + i / 30 seconds. camera: or
    its text.

    load(i) returns RGB (h, w, 3), scene-linear with 1 = white, and planar depth (h, w) in metres
    with 0 = no surface, both of the camera's size. It may be called in any order and from several
    threads. `name` is written into the sequence's recipe. A sequence is resumed only with the same
    trajectory, and if load() returns the same first and last of the finished frames. Raises
    InputError, when a frame is loaded, for whole numbers and for another size.
    """

    def checked(number: int) -> tuple[np.ndarray, np.ndarray]:
        loaded = load(number)
        if not isinstance(loaded, tuple) or len(loaded) != 2:
            raise InputError(f"load({number}) to return RGB and depth", found=type(loaded).__name__)
        rgb, depth_z_m = loaded
        rgb = _floating(rgb, *_LINEAR_RGB)
        depth_z_m = _floating(depth_z_m, *_METRES)
        if (rgb.shape, depth_z_m.shape) != ((*size, 3), size):
            expected = f"frame {number} of the camera's size: RGB {(*size, 3)} and depth {size}"
            raise InputError(expected, found=f"{rgb.shape} and {depth_z_m.shape}")
        return rgb, depth_z_m

    def poses(numbers: Sequence[int]) -> Trajectory:
        return own[np.array(numbers)]

    camera = PinholeCamera.of(camera)
    if not isinstance(trajectory, Trajectory):
        trajectory = Trajectory.at_rate(trajectory)
    own = trajectory
    size = camera.height, camera.width
    origin = {
        "frames": name,
        "trajectory_sha256": sha256(trajectory_text(trajectory, "tum").encode()),
    }
    stamps_s = dict(enumerate(trajectory.stamps_s.tolist()))
    return FrameSource(camera, tuple(stamps_s), stamps_s, checked, poses, origin, volatile=True)


def absolute_trajectory_error(
    truth: TrajectoryOrFile,
    estimate: TrajectoryOrFile,
    settings: AbsoluteErrorSettings | None = None,
    alignment: str | None = None,
) -> AbsoluteError:
    """ATE of an estimate against the ground truth (Sturm et al., IROS 2012, section VII), each a
    Trajectory, a file in any known format, the name of a built-in trajectory (`living_room/kt2`), a
    sequence with ground truth; poses or matrices (n, 4, 4), or positions (n, 3), whose row i is
    that of the other's row i; or rows (n, 8) of stamp, position and quaternion as in TUM files.

    By default, stamps within 20 ms are associated and the estimate is aligned by SE(3); alignment:
    se3, sim3, yaw, origin or none, in place of that of the settings. `.rmse_mm` is the value that
    papers report, `.warnings` what `iclnuim evaluate` warns of. Raises InputError for a file that
    cannot be read, if no stamps match, and if the poses do not determine the alignment.
    """
    settings = settings or AbsoluteErrorSettings()
    if alignment is not None:
        own = AlignmentSettings.from_dict(asdict(settings.alignment) | {"method": alignment})
        settings = replace(settings, alignment=own)
    found = _report(truth, estimate, settings)
    assert isinstance(found, AbsoluteError)
    return found


def relative_pose_error(
    truth: TrajectoryOrFile,
    estimate: TrajectoryOrFile,
    settings: RelativeErrorSettings | None = None,
) -> RelativeError:
    """RPE of an estimate against the ground truth (Sturm et al., IROS 2012, section VII), each a
    Trajectory, a file in any known format, a sequence with ground truth, or poses or matrices
    (n, 4, 4), whose pose i is that of the other's pose i.

    By default, all pairs of consecutive frames are used; `settings` can set another delta in
    frames, seconds or metres. Raises InputError for a file that cannot be read, if no stamps match,
    and if no two poses are delta apart.
    """
    found = _report(truth, estimate, settings or RelativeErrorSettings())
    assert isinstance(found, RelativeError)
    return found


def _report(
    truth: TrajectoryOrFile,
    estimate: TrajectoryOrFile,
    settings: AbsoluteErrorSettings | RelativeErrorSettings,
) -> AbsoluteError | RelativeError:
    """The errors, with the warnings that `iclnuim evaluate` prints."""
    both = tied_to_poses(_read(truth), _read(estimate))
    reference = ComparedFile(_name(truth), both[0])
    report = Report.of(reference, ComparedFile(_name(estimate), both[1]), settings)
    return replace(report.result, warnings=tuple(report.warnings))


def _name(given: TrajectoryOrFile) -> str:
    return os.fspath(given) if isinstance(given, str | os.PathLike) else ""


def _read(given: TrajectoryOrFile) -> LoadedTrajectory:
    """The poses; those without stamps are counted rows."""
    if isinstance(given, str | os.PathLike):
        of_sequence = StoredSequence(given).loaded_truth if os.path.isdir(given) else None
        return of_sequence or read_trajectory(given, positions_suffice=True)
    if isinstance(given, Trajectory):
        return LoadedTrajectory(given, _AS_GIVEN, np.arange(len(given)), len(given))
    shape = _shape_of(given)
    if len(shape) == 2 and shape[1] == 8:
        table = np.asarray(given, float)
        poses = SE3.from_quat_xyzw(table[:, 4:], table[:, 1:4])
        stamped = Trajectory(table[:, 0], poses)
        read_as = replace(_AS_GIVEN, format="tum")
        return LoadedTrajectory(stamped, read_as, np.arange(len(table)), len(table))
    read_as = _AS_GIVEN
    if len(shape) == 2 and shape[1] == 3:
        read_as = replace(_AS_GIVEN, sentence="positions as given", has_rotations=False)
        poses = SE3(SE3.identity(shape[:1]).rotation, np.asarray(given, float))
    else:
        try:
            poses = SE3.of(given)
        except InputError:
            if shape[-2:] in ((3, 4), (4, 4)):
                raise  # the numbers are wrong, not the shape
            poses = SE3.identity()
    if len(poses.shape) != 1:
        expected = (
            "a Trajectory, a file, a sequence, poses (n,) or (n, 4, 4), positions (n, 3), or rows "
            "(n, 8) of a TUM file"
        )
        hint = next((text for end, text in _HINTS.items() if shape[-len(end) :] == end), None)
        raise InputError(expected, found=shape or type(given).__name__, hint=hint)
    rows = np.arange(len(poses))
    return LoadedTrajectory(Trajectory.at_rate(poses), read_as, rows, len(rows), is_counted=True)


def _shape_of(given: Any) -> tuple[int, ...]:
    """The shape of an array or of nested lists; () of anything else."""
    try:
        return () if isinstance(given, SE3) else np.shape(given)
    except ValueError:
        return ()


#: What to try with arrays whose shapes end so.
_HINTS = {
    (4, 3): "the transposed matrices",
    (3, 3): "matrices (n, 4, 4), which have positions, too",
    (4, 4): "a list of it, for one pose",
    (12,): "reshape(-1, 3, 4), for rows of KITTI",
    (16,): "reshape(-1, 4, 4)",
    (7,): "np.column_stack([stamps_s, rows]), for rows of position and quaternion",
}
