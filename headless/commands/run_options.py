"""The options of `make`, `render`, `resume` and `task`: declared, and read once into the plan of a
run.
"""

from argparse import ArgumentParser, Namespace
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

from iclnuim import shipped
from iclnuim.errors import InputError
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.scene_axes import SceneReading
from iclnuim.geometry.trajectory import frame_slice
from iclnuim.job import RenderJob, read_recipe, shipped_job
from iclnuim.sensor.imu import ImuOnCamera, check_rate
from iclnuim.sequences.bag_writer import BagSettings
from iclnuim.sequences.imu import read_rig
from iclnuim.sequences.run_folder import load_trajectory, trajectory_file
from iclnuim.trajectory_files.paths import path_of

from .. import options
from ..farm.farm_settings import FarmSettings, SlurmSettings, read_settings
from ..farm.run_plan import RunPlan
from .sequence_output import SequenceOutput, add_sensor_options

#: Two seconds of consecutive frames: enough for odometers, fusion and errors over one second. They
#: are the first frames, so that stamps begin at 1 s.
QUICK_FRAMES = ":60"
#: Readings of an IMU per second if only its noise is asked for.
_IMU_RATE_HZ = 200.0


def add_run_options(parser: ArgumentParser, command: str, out: str) -> None:
    """Add the options of `render` or `make`, except those that distribute the work.

    `out`: the help text of --out.
    """
    parser.set_defaults(command=command)
    add = parser.add_argument
    known = "kt2, living_room/kt2, office/kt0, or a recipe file (.json)"
    if command == "make":
        known += ", or all for all eight"
    add("sequence", nargs="?", metavar="SEQUENCE", help=known)
    names = ", ".join(shipped.SCENE_NAMES)
    help = f"use another scene: {names}, or a file: {options.SCENE_KINDS}"
    add("--scene", metavar="NAME|FILE", help=help)
    help = "use another trajectory, in any format that `iclnuim trajectory info` reads"
    add("--trajectory", metavar="FILE", help=help)
    options.add_scene_options(parser)
    add("--frames", metavar="A:B:S", help=options.FRAMES)
    help = "only the first 60 frames (two seconds): enough for all further commands"
    add("--quick", action="store_true", help=help)
    help = "resolution and K; default: 640x480 and the paper's K"
    add("--camera", metavar="WxH[,FX,FY,CX,CY]", help=help)
    options.add_settings(parser, RenderJob, light="baked, or auto for a file")
    add("-o", "--out", type=Path, metavar="DIR", help=out)
    help = "an IMU on the camera, of 100 to 1000 readings per second; default: none"
    add(
        "--imu-rate", type=float, metavar="HZ", help=help + ", with --imu 200" * (command == "make")
    )
    help = "pose of the camera in the IMU, from a rig file; default: the axes of the camera"
    add("--rig", type=Path, metavar="JSON", help=help)
    if command == "make":
        add_sensor_options(parser, "released", ("depth_units", "formats", "names"))
        options.add_settings(parser, BagSettings)
        help = "keep the EXR frames; default: remove them once both sequences are complete"
        add("--keep-raw", action="store_true", help=help)


def add_farm_options(parser: ArgumentParser, example: str) -> None:
    """Add the options that distribute the work; none of them changes a pixel."""
    options.add_settings(parser, FarmSettings)
    add = parser.add_argument
    help = "settings for Slurm in TOML; options take precedence"
    add("--slurm", type=Path, metavar="FILE", help=help)
    options.add_settings(parser, SlurmSettings)
    help = "show the job scripts and the estimate; submit nothing"
    add("--print-only", action="store_true", help=help)
    options.common(parser, example)


@dataclass(frozen=True)
class RunOptions:
    """What the options of a run ask for, each group of settings by name.

    files: the scene and the trajectory, as given. frames: a Python slice. out: the output folder.
    slurm_file: settings for Slurm. output: the sequences that are written; None of `render`.
    imu_rate_hz: of an IMU on the camera, 0 for none; rig: the file with its mounting.
    """

    job: dict[str, Any]
    reading: dict[str, Any]
    farm: dict[str, Any]
    slurm: dict[str, Any]
    slurm_file: Path | None
    files: dict[str, str | None]
    frames: str
    out: Path | None
    output: SequenceOutput | None
    keep_raw: bool
    held_out: str
    imu_rate_hz: float = 0.0
    rig: Path | None = None

    @classmethod
    def of(cls, args: Namespace) -> Self:
        """The options given on the command line. Raises InputError for those that do not fit."""
        given = vars(args)
        groups = (RenderJob, SceneReading, FarmSettings, SlurmSettings)
        job, reading, farm, slurm = options.given_of_groups(args, *groups)
        if given.get("camera"):
            job["camera"] = PinholeCamera.parse(args.camera)
        if given.get("quick") and args.frames:
            raise InputError("{quick} or {frames}, not both")
        return cls(
            job,
            reading,
            farm,
            slurm,
            slurm_file=given.get("slurm"),
            files={name: given.get(name) for name in ("scene", "trajectory")},
            frames=given.get("frames") or (QUICK_FRAMES if given.get("quick") else "::"),
            out=given.get("out"),
            output=SequenceOutput.of(args) if given.get("command") == "make" else None,
            keep_raw=given.get("keep_raw", True),
            held_out=given.get("held_out") or "",
            imu_rate_hz=given.get("imu_rate") or (_IMU_RATE_HZ if given.get("imu") else 0.0),
            rig=given.get("rig"),
        )

    def plan(self, sequence: str | None) -> RunPlan:
        """The plan of a run: of a built-in sequence, of a recipe (.json), or without either of a
        scene and a trajectory. Raises InputError.
        """
        return self._plan(sequence, self.out)

    def every_plan(self) -> list[RunPlan]:
        """The plans of all sequences of the paper, each with a folder ROOM/KT below `out`.

        Raises InputError.
        """
        if any(self.files.values()):
            expected = "all without {scene} and {trajectory}, as it makes the built-in sequences"
            raise InputError(expected)
        out = self.out or Path("out")
        return [self._plan(name, out / name) for name in shipped.paper_sequences()]

    def resumed(self, plan: RunPlan, folder: Path) -> RunPlan:
        """The recorded plan of a folder with the farm that is asked for now.

        Raises InputError if its scene may read files outside and the options do not say so too.
        """
        self._check_allowed(plan.job, folder)
        return self._distributed(plan)

    def _plan(self, sequence: str | None, out: Path | None) -> RunPlan:
        job = self._job(sequence)
        numbers = tuple(frame_slice(self.frames, len(load_trajectory(job))))
        folder = out or Path("out") / job.sequence
        if self.output is None:
            return self._distributed(RunPlan(job, out or folder / "raw", numbers))
        held_out = _held_out(self.held_out, job)
        sequences = self.output.options
        logs = self.output.logs
        raw = folder / "raw"
        plan = RunPlan(job, raw, numbers, sequences, self.keep_raw, logs=logs, held_out=held_out)
        return self._distributed(plan)

    def _distributed(self, plan: RunPlan) -> RunPlan:
        """The plan with the engine and the settings of the farm that are asked for."""
        slurm = read_settings(self.slurm_file) if self.slurm_file else plan.slurm
        farm = plan.farm.changed(**self.farm)
        return replace(plan, farm=farm, slurm=slurm.changed(**self.slurm))

    def _job(self, sequence: str | None) -> RenderJob:
        """The render job. Raises InputError for an unknown sequence or scene."""
        given = self.job | {name: _absolute(file) for name, file in self.files.items()}
        is_recipe = sequence is not None and sequence.endswith(".json")
        if not is_recipe and not {"map_size", "map_samples"} & given.keys():
            given.setdefault("light", "auto")
        job = self._sequence_job(sequence)
        self._check_allowed(job, sequence or "")
        job = job.changed(reading=job.reading.changed(**self.reading), **given)
        if "quality" in given and (job.light != "auto" or job.samples is not None):
            expected = (
                "{quality} with {light} auto, without {samples}, of a scene without a light map"
            )
            raise InputError(expected, found=f"light {job.light}, samples {job.samples}")
        return replace(job, imu=self._imu(job))

    def _imu(self, job: RenderJob) -> ImuOnCamera:
        """The IMU on the camera of a job. Raises InputError for a path that it cannot follow."""
        if self.rig is not None and not self.imu_rate_hz:
            raise InputError("{imu} or {imu_rate} with {rig}", found="it alone")
        if not self.imu_rate_hz:
            return job.imu
        check_rate(self.imu_rate_hz)
        mount = () if self.rig is None else tuple(read_rig(self.rig).matrix.ravel().tolist())
        path = path_of(trajectory_file(job))
        return ImuOnCamera(self.imu_rate_hz, mount, path.recipe)

    def _sequence_job(self, sequence: str | None) -> RenderJob:
        """The job of a recipe, of a shipped sequence, or of a scene and a trajectory."""
        if sequence is not None:
            return read_recipe(sequence) if sequence.endswith(".json") else shipped_job(sequence)
        scene = self.files["scene"]
        trajectory = self.files["trajectory"]
        if not (scene and trajectory):
            expected = "a SEQUENCE, or {scene} and {trajectory}"
            raise InputError(expected, hint=", ".join(shipped.sequence_names()))
        name = f"{Path(scene).stem}/{Path(trajectory).stem}"
        return RenderJob(sequence=name, scene=scene, trajectory=trajectory)

    def _check_allowed(self, job: RenderJob, file: str | Path) -> None:
        """Raises InputError if a recipe, but no option, lets the scene read files outside."""
        job.reading.check_asked("allow_outside" in self.reading, file)


def _absolute(file: str | None) -> str | None:
    """The name of what is shipped, or the absolute path of a file, by which a recipe identifies
    it.
    """
    if file is None or file in (*shipped.SCENE_NAMES, *shipped.sequence_names()):
        return file
    return str(Path(file).expanduser().resolve())


def _held_out(name: str, job: RenderJob) -> str:
    """The number of views, the full name of a shipped trajectory, or the absolute path of a file.

    Raises InputError.
    """
    if name.isdecimal() and int(name) < 1:
        expected = "a number of views of at least 1, or a trajectory"
        raise InputError(expected, setting="held_out", found=name)
    if not name or name.isdecimal():
        return name
    own = name if "/" in name else f"{job.scene}/{name}"
    if own in shipped.sequence_names():
        return own
    return str(Path(name).expanduser().resolve())
