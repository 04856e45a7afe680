"""Pairs of a ground truth and an estimate with the errors that odometers have, and the mistakes of
files that make such an estimate worse than it is. Everything is drawn from the generator passed in.
"""

from pathlib import Path

import numpy as np
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.trajectory_files.trajectories import read_trajectory

REPOSITORY = Path(__file__).resolve().parents[1]
ROOMS = sorted((REPOSITORY / "trajectories").glob("*/*.txt"))
FLIPPED = np.diag([1.0, -1.0, -1.0])
#: Columns: the axes of another body in those of a cv camera.
BODIES = {
    "opengl": FLIPPED,
    "flu": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
    "ned": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
}
RATES = (25 / 30, 30 / 25, 24 / 30, 15 / 30, 2.0, 3.0, 10 / 30, 5.0, 1.1)
#: Mistakes of the time axis besides a constant offset.
OF_TIME = ("rate", "renumbered", "frame numbers", "unit of time", "rows")
UNITS = {
    "millimetres": 1e3,
    "centimetres": 1e2,
    "inches": 1 / 0.0254,
    "feet": 1 / 0.3048,
    "kilometres": 1e-3,
}


def smooth(rng: np.random.Generator, frames: int, width: float) -> np.ndarray:
    """A random curve (frames,) of unit standard deviation; width in frames."""
    white = rng.normal(size=frames + int(8 * width))
    kernel = np.exp(-0.5 * (np.arange(-4 * width, 4 * width) / width) ** 2)
    curve = np.convolve(white, kernel, "valid")[:frames]
    return (curve - curve.mean()) / max(curve.std(), 1e-9)


def room_walk(rng: np.random.Generator) -> Trajectory:
    """A part of a shipped trajectory, at one of its rates."""
    whole = read_trajectory(ROOMS[rng.integers(len(ROOMS))]).trajectory
    frames = int(rng.integers(min(250, len(whole) - 1), len(whole)))
    start = int(rng.integers(len(whole) - frames))
    every = int(rng.choice([1, 1, 2, 3]))
    return whole[start : start + frames : every]


def car_drive(rng: np.random.Generator) -> Trajectory:
    """A cv camera that looks forward, on nearly flat ground, at 10 Hz."""
    frames = int(rng.integers(200, 800))
    heading = 1.5 * smooth(rng, frames, 60.0) + np.linspace(0, rng.uniform(0, 6.0), frames)
    speed_m = np.clip(1.0 + 0.3 * smooth(rng, frames, 50.0), 0.1, None)
    up = np.cumsum(speed_m * 0.01 * smooth(rng, frames, 40.0))
    steps = np.stack([np.cos(heading) * speed_m, np.sin(heading) * speed_m], -1)
    positions = np.column_stack([np.cumsum(steps, axis=0), up])
    zero = np.zeros(frames)
    yaw = SE3.exp(np.column_stack([zero, zero, zero, zero, zero, heading]))
    shake = SE3.exp(np.column_stack([zero, zero, zero, *(0.01 * rng.normal(size=(3, frames)))]))
    camera = BODIES["flu"].T
    rotation = yaw.rotation @ shake.rotation @ camera
    return Trajectory(1.5e9 + np.arange(frames) / 10, SE3(rotation, positions))


def flight(rng: np.random.Generator) -> Trajectory:
    """A free motion with all rotations, at 20 Hz."""
    frames = int(rng.integers(200, 900))
    positions = np.stack([3 * smooth(rng, frames, 60.0) for _ in range(3)], -1)
    positions[:, 2] *= 0.4
    turns = np.stack([0.5 * smooth(rng, frames, 40.0) for _ in range(3)], -1)
    rotation = SE3.exp(np.column_stack([np.zeros((frames, 3)), turns])).rotation
    return Trajectory(1e3 + np.arange(frames) / 20, SE3(rotation, positions))


def truth_of(rng: np.random.Generator) -> Trajectory:
    makers = (room_walk, room_walk, room_walk, car_drive, flight)
    return makers[rng.integers(len(makers))](rng)


def estimate_of(rng: np.random.Generator, truth: Trajectory, whole: bool = False) -> Trajectory:
    """An estimate with drift of 0 to 10 % of the length, jitter, gaps, lost ends, another rate
    (unless it is `whole`), in the truth's world or in one of its own.
    """
    steps = truth.T_world_camera[:-1].inverse() @ truth.T_world_camera[1:]
    length_m = truth.step_lengths_m()
    drift = rng.choice([0.0, 0.002, 0.01, 0.03, 0.1]) * rng.uniform(0.3, 1.0)
    spread = drift * length_m.sum() / np.sqrt(len(truth)) / np.sqrt(3)
    turn = drift * rng.uniform(0.0, 1.0) / np.sqrt(len(truth)) / 3
    sigma = np.r_[[spread] * 3, [turn] * 3]
    wrong = SE3.exp(rng.normal(size=(len(steps), 6)) * sigma)
    bias = 1 + drift * rng.uniform(-0.5, 0.5)
    moved = SE3(steps.rotation, bias * steps.translation) @ wrong
    poses = [truth.T_world_camera[0]]
    for step in moved:
        poses.append(poses[-1] @ step)
    T = SE3(np.stack([p.rotation for p in poses]), np.stack([p.translation for p in poses]))
    jitter = rng.choice([0.0, 0.01, 0.05, 0.2]) * np.median(length_m)
    shake = np.r_[[jitter] * 3, [rng.choice([1e-4, 1e-3, 3e-3])] * 3]
    T = T @ SE3.exp(rng.normal(size=(len(T), 6)) * shake)
    world = rng.integers(3)
    if world == 1:
        T = T[0].inverse() @ T
    elif world == 2:
        T = SE3.exp(np.r_[rng.normal(0, 3, 3), rng.normal(0, 1.5, 3)]) @ T
    kept = np.ones(len(truth), bool)
    for _ in range(rng.integers(4)):
        start = rng.integers(len(truth))
        kept[start : start + int(rng.integers(1, len(truth) // 8))] = False
    kept[: int(rng.integers(len(truth) // 5)) * int(rng.integers(2))] = False
    kept &= np.arange(len(truth)) % int(rng.choice([1, 1, 2, 5])) == 0
    if whole:
        kept[:] = True
    return Trajectory(truth.stamps_s, T)[np.flatnonzero(kept)]


def other_order(poses: SE3, is_euroc: bool) -> SE3:
    """How poses are read whose file has qw qx qy qz where qx qy qz qw is expected, or, in EuRoC's
    format, the other way round.
    """
    shift = -1 if is_euroc else 1
    return SE3.from_quat_xyzw(np.roll(poses.quat_xyzw, shift, axis=-1), poses.translation)


def with_poses(trajectory: Trajectory, poses: SE3) -> Trajectory:
    return Trajectory(trajectory.stamps_s, poses)


def turned(trajectory: Trajectory, T_camera_body: SE3) -> Trajectory:
    return with_poses(trajectory, trajectory.T_world_camera @ T_camera_body)


def other_stamps(
    kind: str, rng: np.random.Generator, truth_s: np.ndarray, stamps_s: np.ndarray
) -> np.ndarray:
    """Stamps (n,) with a mistake of this kind of the time axis."""
    first_s = rng.choice([0.0, truth_s[0], stamps_s[0]])
    step_s = float(np.median(np.diff(truth_s)))
    if kind == "rate":
        return first_s + rng.choice(RATES) * (stamps_s - stamps_s[0])
    if kind == "renumbered":
        return first_s + step_s * np.arange(len(stamps_s))
    if kind == "frame numbers":
        return np.rint((stamps_s - stamps_s[0]) / step_s)
    if kind == "unit of time":
        return first_s + float(rng.choice([1e3, 1e6, 1e9])) * (stamps_s - stamps_s[0])
    steps_s = step_s * rng.uniform(0.2, 1.8, len(stamps_s))
    return first_s + np.cumsum(steps_s * (1 + 0.8 * smooth(rng, len(stamps_s), 30.0)).clip(0.1))


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    axis = rng.normal(size=3)
    angle = rng.uniform(0.3, np.pi)
    return SE3.exp(np.r_[0, 0, 0, angle * axis / np.linalg.norm(axis)]).rotation


def corrupted(
    kind: str,
    rng: np.random.Generator,
    truth: Trajectory,
    estimate: Trajectory,
    formats: tuple[str, str] = ("tum", "tum"),
) -> tuple[Trajectory, Trajectory]:
    """The pair with a mistake of this kind; formats: of the two files."""
    poses = estimate.T_world_camera
    if kind in BODIES:
        return truth, turned(estimate, SE3(BODIES[kind], np.zeros(3)))
    if kind == "rotation":
        return truth, turned(estimate, SE3(random_rotation(rng), np.zeros(3)))
    if kind == "truth rotation":
        return turned(truth, SE3(random_rotation(rng), np.zeros(3))), estimate
    if kind == "inverse":
        return truth, with_poses(estimate, poses.inverse())
    if kind == "truth inverse":
        return with_poses(truth, truth.T_world_camera.inverse()), estimate
    if kind == "wxyz":
        return truth, with_poses(estimate, other_order(poses, formats[1] == "euroc"))
    if kind == "truth wxyz":
        return with_poses(truth, other_order(truth.T_world_camera, formats[0] == "euroc")), estimate
    if kind == "scale":
        factor = np.exp(rng.uniform(np.log(1.3), np.log(20)) * rng.choice([-1, 1]))
        return truth, with_poses(estimate, SE3(poses.rotation, factor * poses.translation))
    if kind == "unit":
        factor = UNITS[rng.choice(sorted(UNITS))]
        return truth, with_poses(estimate, SE3(poses.rotation, factor * poses.translation))
    if kind == "mirror":
        flip = np.diag([1.0, -1.0, 1.0])
        return truth, with_poses(
            estimate, SE3(flip @ poses.rotation @ flip, poses.translation @ flip)
        )
    if kind == "offset":
        step_s = float(np.median(np.diff(truth.stamps_s)))
        span_s = float(np.ptp(truth.stamps_s))
        offset_s = rng.choice([-1, 1]) * rng.uniform(2 * step_s, 0.3 * span_s)
        return truth, Trajectory(estimate.stamps_s + offset_s, poses)
    if kind in OF_TIME:
        return truth, Trajectory(other_stamps(kind, rng, truth.stamps_s, estimate.stamps_s), poses)
    if kind == "lever":
        extent_m = float(np.linalg.norm(truth.positions_m.std(axis=0)))
        arm = rng.normal(size=3)
        arm *= rng.uniform(0.05, 0.5) * extent_m / np.linalg.norm(arm)
        return truth, turned(estimate, SE3(np.eye(3), arm))
    if kind == "extrinsic":
        extent_m = float(np.linalg.norm(truth.positions_m.std(axis=0)))
        arm = rng.normal(size=3) * 0.1 * extent_m
        return truth, turned(estimate, SE3(random_rotation(rng), arm))
    if kind == "axes":
        swap = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
        return truth, with_poses(estimate, SE3(poses.rotation, poses.translation @ swap.T))
    if kind == "rotations inverse":
        return truth, with_poses(
            estimate, SE3(np.swapaxes(poses.rotation, -1, -2), poses.translation)
        )
    if kind == "mirrored positions":
        flip = np.diag(rng.permutation([1.0, 1.0, -1.0]))
        return truth, with_poses(estimate, SE3(poses.rotation, poses.translation @ flip))
    raise ValueError(kind)


KINDS = [
    *BODIES,
    "rotation",
    "truth rotation",
    "inverse",
    "truth inverse",
    "wxyz",
    "truth wxyz",
    "scale",
    "unit",
    "mirror",
    "mirrored positions",
    "offset",
    *OF_TIME,
    "lever",
    "extrinsic",
    "axes",
    "rotations inverse",
]
