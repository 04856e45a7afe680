"""Makes the view of a sequence for a system: links to the images under the names that it requires,
lists of images, its settings file, and the readings of an IMU.

Stamps have six digits. If the first stamp would be too close to 0, whole seconds are added, and
subtracted from the result. The view does not contain the ground truth.
"""

import gzip
import lzma
import math
import os
import shutil
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np
from iclnuim.errors import InputError, WorkError
from iclnuim.formats.depth_units import depth16_from_metres
from iclnuim.formats.files import atomic_write, atomic_write_text, make_folder, read_bytes, sha256
from iclnuim.formats.imu_files import imu_text
from iclnuim.formats.png import write_png
from iclnuim.geometry.trajectory import Trajectory, frame_rate_hz, frame_slice
from iclnuim.sensor.imu import ImuStream
from iclnuim.sequences.associations import (
    Associations,
    ImageList,
    write_associations,
    write_image_list,
)
from iclnuim.sequences.camera_files import SequenceCamera
from iclnuim.sequences.frames import ImagePair
from iclnuim.sequences.imu import READINGS
from iclnuim.sequences.recipe import sequence_name
from iclnuim.sequences.slam_settings import IMU_SETTINGS, SLAM_SETTINGS
from iclnuim.sequences.stored_sequence import StoredSequence, opened, read_depth_m

from .system import StageSettings

_PACKED: dict[str, Callable] = {".xz": lzma.open, ".gz": gzip.open}


@dataclass(frozen=True, eq=False)
class StagedSequence:
    """Images and camera for a system, the ground truth for its evaluation, and the readings of an
    IMU around the images, if there are any. The evaluation leaves out the first `skip_s` seconds.

    Stamps (n,) in seconds are those of the sequence; those of the view are `offset_s` later.
    """

    name: str
    pairs: tuple[ImagePair, ...]
    camera: SequenceCamera
    truth: Trajectory | None
    imu: ImuStream | None = None
    skip_s: float = 0.0

    @classmethod
    def of(
        cls, sequence: StoredSequence | Path, frames: str = "::", skip_s: float = 0.0
    ) -> "StagedSequence":
        """The image pairs of a sequence or of its folder, or those of a Python slice.

        Raises InputError if there are none, if none is left to evaluate, or the camera is unknown.
        """
        stored = opened(sequence)
        pairs = [stored.pairs[k] for k in frame_slice(frames, len(stored.pairs))]
        name = sequence_name(stored.folder)
        lasts_s = pairs[-1].stamp_s - pairs[0].stamp_s
        if not 0 <= skip_s <= lasts_s:
            expected = f"a time within the {lasts_s:.6g} s of the sequence"
            raise InputError(expected, path=name, setting="skip", found=skip_s)
        imu = None
        if stored.imu is not None:
            imu = stored.imu.stream.around(pairs[0].stamp_s, pairs[-1].stamp_s)
        return cls(name, tuple(pairs), stored.camera, stored.truth, imu, skip_s)

    @property
    def stamps_s(self) -> np.ndarray:
        return np.array([pair.stamp_s for pair in self.pairs])

    @property
    def rate_hz(self) -> float:
        return frame_rate_hz(self.stamps_s)

    @cached_property
    def images_sha256(self) -> str:
        """Hash of the content of all images and of their stamps, wherever they are.

        It takes about 0.4 ms a frame.
        """
        with ThreadPoolExecutor() as pool:  # hashing and reading do not need Python's global lock
            lines = pool.map(_identified, self.pairs)
            return sha256("\n".join(lines).encode())

    def is_staged_in(self, stage: Path) -> bool:
        """Whether all links of a view lead to these images: they may have been moved since it was
        written.
        """
        images = {os.path.abspath(pair.rgb) for pair in self.pairs}
        images |= {os.path.abspath(pair.depth) for pair in self.pairs}
        links = filter(Path.is_symlink, stage.rglob("*"))
        return all(os.readlink(link) in images for link in links)

    def imu_text(self, settings: StageSettings) -> str:
        """The readings of the IMU in EuRoC's columns, with the stamps of the view.

        Raises InputError without them, or if there is none between two frames.
        """
        hint = (
            "`iclnuim make --imu bmi055`, or imu.csv of `iclnuim trajectory imu` beside its files"
        )
        if self.imu is None:
            raise InputError("an IMU in the sequence", path=self.name, found="none", hint=hint)
        between = np.diff(np.searchsorted(self.imu.stamps_s, self.stamps_s, side="right"))
        if (between == 0).any():
            where = f"none between {_range_of(self.stamps_s, int(between.argmin()))}"
            raise InputError("readings of the IMU between all frames", path=self.name, found=where)
        offset_ns = round(1e9 * self.offset_s(settings))
        return imu_text(self.imu.stamps_ns + offset_ns, self.imu.readings)

    def offset_s(self, settings: StageSettings) -> float:
        """Whole seconds added to the stamps of the view."""
        return float(max(0, math.ceil(settings.first_stamp_s - self.pairs[0].stamp_s)))

    def units(self, settings: StageSettings) -> float:
        """Depth units per metre in the view."""
        return settings.depth_units or self.camera.depth_units_per_metre

    def values(self, settings: StageSettings, stage: Path) -> dict[str, object]:
        """Values of the placeholders in a system's command."""
        c = self.camera.pinhole
        return {
            **{name: repr(float(getattr(c, name))) for name in ("fx", "fy", "cx", "cy")},
            **{"width": c.width, "height": c.height, "units": repr(float(self.units(settings)))},
            **{"rate": repr(self.rate_hz), "frames": len(self.pairs), "stage": stage},
            **{name: stage / f"{name}.txt" for name in ("associations", "rgb", "depth")},
            "settings": stage / settings.settings_file,
            "imu": stage / READINGS,
        }

    def write(self, settings: StageSettings, stage: Path) -> None:
        """Write the view.

        Raises InputError if two frames have the same stamp in six digits, if depth does not fit the
        requested units, or if readings of the IMU are missing.
        """
        offset_s = self.offset_s(settings)
        stamps = [f"{pair.stamp_s + offset_s:.6f}" for pair in self.pairs]
        if len(set(stamps)) < len(stamps):
            raise InputError("stamps at least a microsecond apart", path=self.name)
        names = stamps
        if settings.names == "number":
            names = [f"{number:06}" for number in range(len(stamps))]
        lists = {}
        for kind, folder in (("rgb", settings.rgb), ("depth", settings.depth)):
            make_folder(stage / folder)
            images = [getattr(pair, kind) for pair in self.pairs]
            own = self.camera.depth_units_per_metre
            units = self.units(settings) if kind == "depth" else own
            files = []
            for image, name in zip(images, names, strict=True):
                ending = image.suffix if kind == "rgb" else ".png"
                files.append(f"{folder}/{name}{ending}")
                _place(image, stage / files[-1], own, units)
            lists[kind] = ImageList(tuple(map(float, stamps)), tuple(files), tuple(stamps))
            write_image_list(stage / f"{kind}.txt", lists[kind])
        order = ("depth", "rgb") if settings.order == "depth-first" else ("rgb", "depth")
        both = Associations(lists[order[0]], lists[order[1]])
        write_associations(stage / "associations.txt", both)
        if settings.settings:
            text = SLAM_SETTINGS[settings.settings](
                self.camera.pinhole, self.rate_hz, self.units(settings)
            )
            if settings.imu and self.imu is not None and settings.settings in IMU_SETTINGS:
                text += IMU_SETTINGS[settings.settings](self.imu)
            atomic_write_text(stage / settings.settings_file, text)
        if settings.imu:
            atomic_write_text(stage / READINGS, self.imu_text(settings))


def _range_of(stamps_s: np.ndarray, first: int) -> str:
    return f"{stamps_s[first]:.6f} and {stamps_s[first + 1]:.6f} s"


def _identified(pair: ImagePair) -> str:
    hashes = (sha256(read_bytes(pair.rgb)), sha256(read_bytes(pair.depth)))
    return f"{pair.stamp_s:.6f} {' '.join(hashes)}"


def _place(image: Path, file: Path, own: float, units: float) -> None:
    """Link to the image.

    Depth in other units per metre than `units`, or stored as an array, is converted to a new file.
    """
    if image.suffix == file.suffix and own == units:
        os.symlink(os.path.abspath(image), file)
    else:
        write_png(file, depth16_from_metres(read_depth_m(image, own), units))


def unpacked(options: Mapping[str, str], folder: Path) -> dict[str, str]:
    """The options with files as absolute paths; compressed files (.xz, .gz) are unpacked into
    `folder`. Raises WorkError if that fails.
    """
    found = {}
    for name, value in options.items():
        path = Path(value).expanduser()
        found[name] = value
        if name == "program" or not path.is_file():
            continue
        found[name] = str(path.resolve())
        if opened := _PACKED.get(path.suffix):
            target = folder / path.stem
            found[name] = str(target.resolve())
            if not target.is_file():
                make_folder(folder)
                atomic_write(target, partial(_unpack, opened, path))
    return found


def _unpack(opened: Callable, path: Path, target: Path) -> None:
    try:
        with opened(path) as source, open(target, "wb") as file:
            shutil.copyfileobj(source, file, 1 << 20)
    except (EOFError, lzma.LZMAError, gzip.BadGzipFile) as error:
        raise WorkError(f"{path}: cannot be unpacked: {error}") from None
