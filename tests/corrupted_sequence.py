"""Sequences of a moving camera of which one thing is read wrongly, by seed."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from iclnuim.geometry.se3 import SE3
from moving_box import CAMERA, depth_z_m, hand_held, kinect

KINDS = ("unit", "ray", "mirrored", "inverse", "shifted", "axes", "quaternion")
#: Wrong units of depth or of poses, as a factor of the positions.
FACTORS = (0.2, 5.0, 10.0, 0.1, 6553.5 / 5000, 0.8, 0.01, 100.0, 1000.0, 0.3048, 1.3, 2.0)
MIRRORS = (np.diag([-1.0, 1, 1]), np.diag([1.0, -1, 1]), np.diag([1.0, 1, -1]))
OPENGL = np.diag([1.0, -1, -1])
NED = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
FLU = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])


@dataclass(frozen=True)
class Corrupted:
    """kind: what is wrong, "" for nothing. right and read: the poses (n,) as they are and as a
    program reads them; load(i): depth as it is read.
    """

    kind: str
    right: SE3
    read: SE3
    load: Callable[[int], np.ndarray]


def corrupted(seed: int, kind: str | None = None) -> Corrupted:
    """A kind by the seed, or the given one; 6 to 60 frames, one in two with the noise of a
    Kinect.
    """
    rng = np.random.default_rng(seed)
    kind = rng.choice(KINDS) if kind is None else kind
    frames = int(rng.integers(6, 61))
    step = int(rng.choice([1, 2, 3]))
    every = hand_held(step * (frames + 4), seed)[::step]
    noisy = bool(rng.integers(2))
    first = 2
    right = every[first : first + frames]
    read = _read(kind, every, first, frames, rng)

    def load(i: int) -> np.ndarray:
        depth_m = depth_z_m(right[i])
        depth_m = kinect(depth_m, seed + i) if noisy else depth_m
        return depth_m * np.linalg.norm(CAMERA.rays(), axis=-1) if kind == "ray" else depth_m

    return Corrupted(kind, right, read, load)


def _read(kind: str, every: SE3, first: int, frames: int, rng: np.random.Generator) -> SE3:
    """The poses as a program reads them."""
    if kind == "shifted":
        first += int(rng.choice([-2, -1, 1, 2]))
    T = every[first : first + frames]
    match kind:
        case "unit":
            return SE3(T.rotation, rng.choice(FACTORS) * T.translation)
        case "mirrored":
            S = MIRRORS[rng.integers(3)]
            return SE3(S @ T.rotation @ S, T.translation @ S)
        case "inverse":
            return T.inverse()
        case "axes":
            return SE3(T.rotation @ (OPENGL, NED, FLU)[rng.integers(3)], T.translation)
        case "quaternion":
            return SE3.from_quat_xyzw(np.roll(T.quat_xyzw, 1, axis=-1), T.translation)
    return T
