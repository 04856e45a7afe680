"""`iclnuim trajectory imu`: the readings of an IMU on the path of a trajectory."""

from argparse import Namespace
from pathlib import Path

from iclnuim.console import Console
from iclnuim.formats.files import atomic_write_text, make_folder
from iclnuim.formats.imu_files import imu_text
from iclnuim.geometry.se3 import SE3
from iclnuim.sensor.imu import imu_on
from iclnuim.sensor.imu_noise import IMU_MODELS, imu_noise
from iclnuim.sequences.imu import read_rig
from iclnuim.trajectory_files.paths import path_of

from ..options import Actions, action, trajectory_file
from .trajectory_options import FILE, check_out


def configure(actions: Actions) -> None:
    help = "the readings of an IMU that moves with the camera, in EuRoC's columns"
    example = "iclnuim trajectory imu kt2 --rate 200 --noise bmi055 -o imu.csv"
    imu = action(actions, "imu", help, example, _run)
    add = imu.add_argument
    add("source", type=trajectory_file, metavar="SOURCE", help=FILE)
    help = "readings per second: 100 to 1000 (default 200)"
    add("--rate", type=float, default=200.0, metavar="HZ", help=help)
    models = ", ".join(f"{name}: {model.summary}" for name, model in IMU_MODELS.items())
    help = f"noise of a sensor; default: none. {models}"
    add("--noise", default="none", metavar="{" + ",".join(IMU_MODELS) + "}", help=help)
    add("--seed", type=int, default=0, metavar="N", help="seed of the noise (default 0)")
    help = "pose of the camera in the IMU, from a rig file; default: the axes of the camera"
    add("--rig", type=Path, metavar="JSON", help=help)
    add("-o", "--out", type=Path, default=Path("imu.csv"), metavar="CSV", help="default: imu.csv")
    add("--force", action="store_true", help="overwrite CSV")


def _run(args: Namespace, console: Console) -> None:
    check_out(args.out, args.force)
    noise = imu_noise(args.noise)
    T_imu_camera = SE3.identity() if args.rig is None else read_rig(args.rig)
    path = path_of(args.source)
    imu = noise.apply(imu_on(path.motion, args.rate, T_imu_camera), args.seed)
    make_folder(args.out.parent, hint="another {out}")
    atomic_write_text(args.out, imu_text(imu.stamps_ns, imu.readings))
    first_s, last_s = imu.stamps_s[[0, -1]].tolist()
    figures = {
        "file": str(args.out),
        "readings": len(imu),
        "rate_hz": imu.rate_hz,
        "first_s": first_s,
        "last_s": last_s,
        "exact": path.is_exact,
        "path": path.sentence,
        "noise": noise.name,
    }
    span = f"{len(imu)} readings at {imu.rate_hz:g} Hz, {first_s:.3f} to {last_s:.3f} s"
    console.result(figures, f"{args.out}: {span}, noise {noise.name}\n{path.sentence}")
