"""The EXR frames of a render run as the source of a sequence."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from ..channels import further_of
from ..errors import InputError, StrPath, within
from ..formats.exr import read_exr
from ..formats.files import read_bytes, read_json, sha256
from ..geometry.camera import PinholeCamera
from ..geometry.trajectory import Trajectory, frame_slice
from ..trajectory_files.trajectories import read_trajectory
from .frame_source import FrameSource
from .ground_truth import FurtherImages
from .run_folder import RunFolder, read_run


def run_frames(folder: StrPath, frames: str = "::") -> FrameSource:
    """The EXR frames of a run folder (exr/000000.exr, groundtruth.txt, camera.json, sequence.json).

    `frames` is a slice of the poses of the trajectory; of these, the existing frames are used.
    Raises InputError if the folder is not a run folder or has no such frames.
    """
    folder = Path(folder)
    there = {int(p.stem) for p in (folder / "exr").glob("*.exr") if p.stem.isdecimal()}
    if not there:
        hint = "the folder that `iclnuim render` wrote"
        raise InputError(
            "a run with frames exr/000000.exr ...", path=folder, found="none", hint=hint
        )
    truth = read_trajectory(folder / "groundtruth.txt", "tum").trajectory
    if max(there) >= len(truth):
        expected = f"frames of the {len(truth)} poses in groundtruth.txt"
        raise InputError(expected, path=folder / "exr", found=f"frame {max(there)}")
    numbers = sorted(there.intersection(frame_slice(frames, len(truth))))
    if not numbers:
        raise InputError(f"frames {frames} to be rendered", path=folder, found="none of them")
    with within(folder / "camera.json"):
        camera = PinholeCamera.from_dict(read_json(folder / "camera.json"))
    if (folder / "sequence.json").is_file():
        origin: dict = {"run": read_run(folder).recipe}
    else:
        files = ("groundtruth.txt", "camera.json")
        hashes = {name: sha256(read_bytes(folder / name)) for name in files}
        origin = {"frames": folder.resolve().name, "sha256": hashes}
    return _run_source(folder, camera, truth, numbers, origin)


def frames_of_run(run: RunFolder, numbers: Iterable[int]) -> FrameSource:
    """Frames of a run, which may not be rendered yet. Poses and stamps are those in the run's
    folder: a run that was started by an earlier release with other stamps keeps them.
    """
    return _run_source(run.path, run.camera, run.truth(), numbers, {"run": run.recipe})


def _run_source(
    folder: Path, camera: PinholeCamera, truth: Trajectory, numbers: Iterable[int], origin: dict
) -> FrameSource:
    def load(number: int) -> tuple[np.ndarray, np.ndarray]:
        return read_frame(folder / "exr" / f"{number:06}.exr", camera)

    stamps_s = dict(enumerate(truth.stamps_s.tolist()))
    channels = further_of(origin.get("run", {}).get("job", {}))
    return FrameSource(
        camera,
        tuple(sorted(numbers)),
        stamps_s,
        load,
        lambda some: truth[np.array(some)],
        origin,
        further=FurtherImages(folder, channels) if channels else None,
    )


def read_frame(path: Path, camera: PinholeCamera) -> tuple[np.ndarray, np.ndarray]:
    """Read (h, w, 3) half or float scene-linear RGB and (h, w) float32 planar metres of one EXR
    frame.

    Raises InputError if a channel is missing, the size is not the camera's, or Z has only half
    precision.
    """
    channels = read_exr(path)
    missing = [name for name in "RGBZ" if name not in channels]
    if missing:
        found = f"no {', '.join(missing)} among {', '.join(channels)}"
        raise InputError("channels R, G, B and Z", path=path, found=found)
    depth_z_m = channels["Z"]
    height, width = depth_z_m.shape
    if (height, width) != (camera.height, camera.width):
        expected = f"{camera.width} x {camera.height} as in camera.json"
        raise InputError(expected, path=path, found=f"{width} x {height}")
    if depth_z_m.dtype != np.float32:
        raise InputError("Z as 32-bit float", path=path, found="half, which rounds 4 m to 2 mm")
    return np.stack([channels[c] for c in "RGB"], -1), depth_z_m
