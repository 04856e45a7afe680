"""Tries loaders of others, unchanged, on 882 frames that we write with the settings file of each:
order of the images, poses, camera, depth.

    python tools/loaders.py                           those of tools/loaders.toml, from GitHub
    python tools/loaders.py --from DIR --only eslam   from clones in DIR, by their names
    python tools/loaders.py --csv docs/measured/loaders.csv

The packages that they import must be there; PyTorch for the CPU suffices.
"""

import os
import subprocess
import sys
import tomllib
from argparse import ArgumentParser
from collections.abc import Iterable
from dataclasses import astuple, dataclass, fields, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
from iclnuim import shipped
from iclnuim.formats.files import csv_text
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.headless.loader_settings import filled, system_files
from iclnuim.postprocess import frames_from
from iclnuim.sequences.format import PUBLISHED
from iclnuim.sequences.frame_source import original_frames
from iclnuim.sequences.sequence_options import SequenceSettings
from iclnuim.sequences.stored_sequence import StoredSequence
from iclnuim.sequences.writer import write_sequence
from iclnuim.trajectory_files.trajectories import read_trajectory

_READERS = Path(__file__).with_name("loader_readers.py")
_TABLE = Path(__file__).with_suffix(".toml")
_ICL = "living_room_traj2_frei_png"


@dataclass(frozen=True)
class Loader:
    """One loader of the table (see there)."""

    title: str
    format: str
    git: str = ""
    commit: str = ""
    package: str = ""
    settings: str = ""
    camera_px: float = 1e-4
    stand_ins: tuple[str, ...] = ()


@dataclass(frozen=True)
class Tried:
    """One row. order: whether the images are those of the sequence in the order of time, from the
    first to the last; poses: largest difference of the relative poses; camera: largest difference
    in pixels; depth_units: largest difference in units of the depth images.
    """

    loader: str
    commit: str
    format: str
    frames: int
    order: bool
    poses: float | None
    camera: float
    depth_units: float | None
    stand_ins: str

    def holds(self, loader: Loader) -> bool:
        """Whether poses are within 1e-6, depth is within half a unit, and the camera is exact in
        single precision or what the loader makes of it.
        """
        close = (self.poses or 0) <= 1e-6 and (self.depth_units or 0) <= 0.505
        return self.order and close and self.camera <= loader.camera_px


def loaders() -> dict[str, Loader]:
    """The loaders of the table by name."""
    content = tomllib.loads(_TABLE.read_text())
    return {name: Loader(**values) for name, values in content.items()}


def made_up_depth_m(number: int) -> float:
    """The depth of all pixels of a frame."""
    return 1 + number / 777


def write(out: Path, formats: Iterable[str], frames: int | None = None) -> None:
    """Flat images along the path of kt2 in each format; icl-nuim as the official folder, which has
    no pose of image 0.
    """
    path = shipped.folder("trajectories") / "living_room/kt2.txt"
    trajectory = read_trajectory(path).trajectory[:frames]
    camera = PinholeCamera()

    def load(number: int) -> tuple[np.ndarray, np.ndarray]:
        size = (camera.height, camera.width)
        depth_z_m = np.full(size, made_up_depth_m(number), np.float32)
        return np.full((*size, 3), number / 1000, np.float32), depth_z_m

    source = frames_from(camera, trajectory, load)
    for format in formats:
        if format == "icl-nuim":
            write(out, ("tum",), frames)
            published = original_frames(out / "tum", "1:")
            settings = SequenceSettings(names=PUBLISHED)
            write_sequence(published, out / format / _ICL, settings, (format,))
        else:
            write_sequence(source, out / format, SequenceSettings(), (format,))


def place(out: Path, loader: Loader) -> Path:
    """The folder of the sequence that a loader gets."""
    if loader.format == "icl-nuim":
        return out / loader.format / _ICL
    return out / loader.format


def write_settings(loader: Loader, sequence: Path) -> None:
    """The settings files of a loader, beside the sequence. Another format of the same system has
    the same keys.
    """
    if not loader.settings:
        return
    system = replace(system_files(loader.settings), shown_by="recipe.json")
    for name, text in filled(system, sequence).items():
        (sequence / name).write_text(text)


def checkout(loader: Loader, work: Path, source: Path | None) -> Path:
    """The folder of the loader's code at its commit; an empty one for a package."""
    name = loader.git.rpartition("/")[2]
    folder = work / "code" / (name or loader.package)
    if folder.is_dir():
        return folder
    folder.mkdir(parents=True)
    if loader.git:
        where = f"https://github.com/{loader.git}"
        if source:
            where = str(source / name)
        subprocess.run(["git", "clone", "-q", "-n", where, str(folder)], check=True)
        command = [
            "git",
            "checkout",
            "-q",
            loader.commit,
            "--",
            ":(glob)**/*.py",
            ":(glob)**/*.yaml",
        ]
        subprocess.run(command, cwd=folder, check=True)
    return folder


def tried(name: str, loader: Loader, sequence: Path, code: Path) -> Tried:
    """Read the sequence in a process of its own. Raises CalledProcessError if the loader fails."""
    out = sequence.parent / f"{name}.npz"
    words = [sys.executable, str(_READERS), name, str(sequence), str(out), *loader.stand_ins]
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(words, cwd=code, env=environment, text=True, capture_output=True)
    done.check_returncode()
    with np.load(out) as read:
        return judged(loader, sequence, {key: read[key] for key in read.files})


def judged(loader: Loader, sequence: Path, read: dict[str, np.ndarray]) -> Tried:
    pairs = StoredSequence(sequence).pairs
    camera = StoredSequence(sequence).camera
    written = [pair.rgb.name for pair in pairs]
    images = [Path(str(image)).name for image in read["images"]]
    poses = None
    if "T_world_camera" in read:
        expected = truth(pairs[0].number, len(pairs))
        poses = float(np.abs(_relative(read["T_world_camera"]) - _relative(expected)).max())
    depth_units = None
    if "depth_spans_m" in read:
        expected_m = [[made_up_depth_m(pairs[0].number + n)] for n in range(len(pairs))]
        off_m = np.abs(read["depth_spans_m"] - np.array(expected_m)).max()
        depth_units = float(off_m * camera.depth_units_per_metre)
    c = camera.pinhole
    # a negative fy is that of the official, left-handed poses
    off_px = np.abs(np.abs(read["camera"]) - (c.fx, c.fy, c.cx, c.cy)).max()
    return Tried(
        loader=loader.title,
        commit=loader.commit[:7] or version(loader.package),
        format=loader.format,
        frames=len(images),
        order=images == written,
        poses=poses,
        camera=float(off_px),
        depth_units=depth_units,
        stand_ins=" ".join(loader.stand_ins),
    )


def truth(first: int, count: int) -> np.ndarray:
    """(count, 4, 4) true T_world_camera of the frames from `first` on."""
    path = shipped.folder("trajectories") / "living_room/kt2.txt"
    trajectory: Trajectory = read_trajectory(path).trajectory
    return trajectory.T_world_camera.matrix[first : first + count]


def _relative(T: np.ndarray) -> np.ndarray:
    return np.linalg.inv(T[0]) @ T


def main(arguments: list[str] | None = None) -> int:
    parser = ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--from", type=Path, dest="source", metavar="DIR", help="clones by name")
    parser.add_argument("--only", metavar="TEXT", default="", help="names that contain TEXT")
    help = "code and sequences, kept for the next time; default: %(default)s"
    parser.add_argument("--work", type=Path, default=Path("out/loaders"), help=help)
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write the rows")
    args = parser.parse_args(arguments)
    work = args.work.resolve()
    source = args.source and args.source.resolve()
    chosen = {name: loader for name, loader in loaders().items() if args.only in name}
    write(work / "sequences", {loader.format for loader in chosen.values()})
    rows = []
    failed = 0
    for name, loader in chosen.items():
        sequence = place(work / "sequences", loader)
        write_settings(loader, sequence)
        try:
            row = tried(name, loader, sequence, checkout(loader, work, source))
        except subprocess.CalledProcessError as error:
            failed += 1
            print(f"{name}: {_last_line(error)}", flush=True)
            continue
        rows.append(row)
        if row.holds(loader):
            print(f"{name}: holds", flush=True)
        else:
            failed += 1
            print(f"{name}: differs: {row}", flush=True)
    if args.csv:
        names = [field.name for field in fields(Tried)]
        args.csv.write_text(csv_text([names, *map(astuple, rows)]))
    return min(failed, 1)


def _last_line(error: subprocess.CalledProcessError) -> str:
    said = (error.stderr or str(error)).strip()
    return said.splitlines()[-1]


if __name__ == "__main__":
    sys.exit(main())
