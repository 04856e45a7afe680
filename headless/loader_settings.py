"""Settings files that a third-party system needs to read a sequence. Each system is a TOML file in
settings/: the files of a sequence that it reads, and its own files as templates.
"""

import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from string import Template

import numpy as np
from iclnuim.errors import InputError
from iclnuim.formats.meshes import read_mesh_or_cloud
from iclnuim.geometry.trajectory import frame_rate_hz
from iclnuim.sensor.imu import ImuStream
from iclnuim.sensor.imu_noise import estimator_figures
from iclnuim.sequences.frames import depth_stamps_s, poses_at
from iclnuim.sequences.stored_sequence import StoredSequence, read_depth_m

_FOLDER = Path(__file__).parent / "settings"
#: Added to the bounds of the room on each side, as a share of their size.
_MARGIN = 0.05
#: Maximum number of images from which bounds are taken, and step between their pixels.
_VIEWS = 60
_STEP = 8
_NO_IMU = ImuStream(np.zeros(0, int), np.zeros((0, 6)), 200.0)


@dataclass(frozen=True)
class SystemFiles:
    """What one system needs: `format` of the sequence and a file or folder that shows it, and the
    templates of the system's files by name. imu_files: those of sequences with an IMU.
    """

    name: str
    format: str
    shown_by: str
    files: dict[str, str]
    imu_files: dict[str, str] = field(default_factory=dict)

    @property
    def needs_bounds(self) -> bool:
        """Whether a template has the bounds of the room."""
        return any("$bound" in text for text in self.files.values())


def systems() -> tuple[str, ...]:
    """Names of the systems."""
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.toml")))


def system_files(name: str) -> SystemFiles:
    """The files of a system. Raises InputError for an unknown name."""
    if name not in systems():
        raise InputError(f"a system ({', '.join(systems())})", found=name)
    content = tomllib.loads((_FOLDER / f"{name}.toml").read_text(encoding="utf-8"))
    return SystemFiles(name, **content)


def filled(system: SystemFiles, folder: Path, model: Path | None = None) -> dict[str, str]:
    """Name -> text of the system's files for a sequence. model: a mesh of the room, whose bounds
    are used; otherwise those of the surfaces that its depth images show.

    Raises InputError for a sequence in another format, and without poses where bounds are needed.
    """
    if not (folder / system.shown_by).exists():
        expected = f"a sequence in the format {system.format} for {system.name}"
        hint = f"iclnuim convert {folder} OUT --format {system.format}"
        raise InputError(expected, path=folder, found=f"no {system.shown_by}", hint=hint)
    sequence = StoredSequence(folder)
    camera = sequence.camera
    c = camera.pinhole
    values: dict[str, object] = {
        "width": c.width,
        "height": c.height,
        "units": camera.depth_units_per_metre,
        "metres": 1 / camera.depth_units_per_metre,
        "rate": frame_rate_hz(sequence.stamps_s),
        "name": folder.resolve().name,
        "parent": folder.resolve().parent,
        "folder": folder.resolve(),
    }
    values |= {name: repr(float(getattr(c, name))) for name in ("fx", "fy", "cx", "cy")}
    values |= _of_imu(sequence)
    files = system.files if sequence.imu is None else system.files | system.imu_files
    if system.needs_bounds:
        values["bound"] = bounds_m(sequence, model).round(3).tolist()
    return {name: Template(text).substitute(values) for name, text in files.items()}


def _of_imu(sequence: StoredSequence) -> dict[str, object]:
    """Values of the IMU: where the camera is in it, its rate, its noise per square root of hertz,
    and per reading. Without an IMU, those of one in the camera's place.
    """
    stream = sequence.imu.stream if sequence.imu else _NO_IMU
    T = stream.T_imu_camera
    rows = [[round(value, 9) + 0.0 for value in row] for row in T.matrix.tolist()]
    found: dict[str, object] = {
        "has_imu": "true" if sequence.imu else "false",
        "imu_modes": ", 'mono-vi'" if sequence.imu else "",
        "imu_rate": repr(float(stream.rate_hz)),
        "T_imu_camera": ", ".join(repr(value) for row in rows for value in row),
        "T_imu_camera_rows": "".join(f"\n    - {row}" for row in rows),
        "imu_note": "its IMU" if sequence.imu else "it needs an IMU, which this sequence lacks",
    }
    pose = [*T.translation.tolist(), *T.quat_xyzw.tolist()]
    names = ("px", "py", "pz", "qx", "qy", "qz", "qw")
    found["T_imu_camera_named"] = ", ".join(
        f'"{name}": {round(value, 9) + 0.0!r}' for name, value in zip(names, pose, strict=True)
    )
    for name, value in estimator_figures(stream).items():
        found[name] = f"{value:.9e}"
        found[f"{name}_per_reading"] = f"{value * stream.rate_hz**0.5:.9e}"
    return found


def bounds_m(sequence: StoredSequence, model: Path | None = None) -> np.ndarray:
    """(3, 2) smallest and largest x, y, z in metres of the room in the world of the sequence, 5 %
    of their size wider on each side.
    """
    points = _seen(sequence) if model is None else read_mesh_or_cloud(model)[0]
    if not len(points):
        expected = "depth or a model, for the bounds of the room"
        raise InputError(expected, path=sequence.folder, found="none")
    low = points.min(0)
    high = points.max(0)
    margin = _MARGIN * (high - low)
    return np.stack([low - margin, high + margin], 1)


def _seen(sequence: StoredSequence) -> np.ndarray:
    """(n, 3) points in the world that depth images, spread over the sequence, show."""
    pairs = sequence.pairs
    camera = sequence.camera
    poses = poses_at(depth_stamps_s(pairs), sequence.truth)
    kept = np.flatnonzero([pose is not None for pose in poses])
    if not len(kept):
        hint = "--model with a mesh of the room"
        raise InputError("poses, for the bounds", path=sequence.folder, found="none", hint=hint)
    points = []
    for at in np.linspace(0, len(kept) - 1, min(_VIEWS, len(kept))).round().astype(int):
        pose = poses[kept[at]]
        depth = pairs[kept[at]].depth
        depth_z_m = read_depth_m(depth, camera.depth_units_per_metre).astype(float)
        place = (slice(None, None, _STEP), slice(None, None, _STEP))
        seen = camera.pinhole.unproject(depth_z_m)[place][depth_z_m[place] > 0]
        points.append(pose.apply(seen))
    return np.concatenate(points)
