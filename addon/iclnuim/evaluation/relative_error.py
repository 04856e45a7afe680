"""Relative pose error (RPE): the error of the motion between two poses that are a number of frames, seconds or metres apart.

Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012, section VII: E_i = (Q_i^-1 Q_j)^-1
(P_i^-1 P_j) with Q the ground truth and P the estimate; (i, j) is called an RPE pair.
"""

import re
from dataclasses import dataclass, field

import numpy as np

from ..errors import InputError
from ..geometry import so3
from ..geometry.se3 import SE3, read_only
from ..geometry.trajectory import Trajectory
from ..settings import Settings, setting
from .absolute_error import PoseErrors
from .align import check_mirror, umeyama
from .associate import AssociationSettings, pair_up


@dataclass(frozen=True)
class RelativeErrorSettings(Settings):
    """Which RPE pairs are compared, and on which scale."""

    group = "relative error settings"

    delta: float = setting(1.0, "how far apart the poses of a pair are, in `unit`", low=1e-9, option="")
    unit: str = setting("frames", "of delta", choices=dict.fromkeys(("frames", "seconds", "metres"), ""), option="")
    all_pairs: bool = setting(True, "a pair from every pose; else each begins where the last ended", option="")
    tolerance: float = setting(
        0.1, "share of delta by which a pair may be off (seconds, and metres from every pose)", low=0.0, high=0.999
    )
    measured_on: str = setting(
        "reference",
        "along which trajectory metres are counted",
        choices={"reference": "gives every estimate the same pairs", "estimate": "as evo and the TUM tools do"},
    )
    correct_scale: bool = setting(False, "scale the estimate first by its Sim(3) alignment")
    association: AssociationSettings = field(default_factory=AssociationSettings)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.unit == "frames" and self.delta != int(self.delta):
            raise InputError("a whole number of frames", setting="delta", found=self.delta)


@dataclass(frozen=True, eq=False)
class RelativeError(PoseErrors):
    """Errors of m RPE pairs, from pose start (m,) to pose end (m,), which index `reference` and `stamps_s`."""

    start: np.ndarray
    end: np.ndarray
    scale: float


def parse_delta(text: str) -> tuple[float, str]:
    """`10` (frames), `0.5s` or `1m` -> number and unit. Raises InputError."""
    match = re.fullmatch(r"\s*(\d+\.?\d*|\.\d+)\s*(m|s|)\s*", text)
    if match is None:
        raise InputError("a delta as 10 (frames), 0.5s (seconds) or 1m (metres)", found=text)
    return float(match[1]), {"": "frames", "s": "seconds", "m": "metres"}[match[2]]


def relative_error(
    reference: Trajectory, estimate: Trajectory, settings: RelativeErrorSettings | None = None
) -> RelativeError:
    """RPE of an estimate. Raises InputError where no stamps agree, or no two poses are delta apart."""
    settings = settings or RelativeErrorSettings()
    association = pair_up(reference, estimate, settings.association)
    truth, poses = reference.T_world_camera[association.first], estimate.T_world_camera[association.second]
    scale = 1.0
    if settings.correct_scale:
        if np.ptp(poses.translation, axis=0).max() == 0.0:
            raise InputError("an estimate that moves, to correct its scale", found="one that stands still")
        scale = umeyama(poses.translation, truth.translation, with_scale=True)[1]
    scaled = SE3(poses.rotation, scale * poses.translation)
    stamps_s = read_only(reference.stamps_s[association.first])
    measured = truth if settings.measured_on == "reference" else scaled
    start, end = rpe_pairs(stamps_s, measured.translation, settings)
    Q, P = (poses[start].inverse() @ poses[end] for poses in (truth, scaled))
    return RelativeError(
        reference=truth,
        start=read_only(start),
        end=read_only(end),
        stamps_s=stamps_s,
        association=association,
        scale=scale,
        mirror=check_mirror(truth.translation, poses.translation),
        # |trans E|: the rotation in front of trans E = R_q^T (t_p - t_q) does not change its length
        translation_error_m=read_only(np.linalg.norm(P.translation - Q.translation, axis=1)),
        rotation_error_rad=read_only(so3.angle(np.swapaxes(Q.rotation, -1, -2) @ P.rotation)),
    )


def rpe_pairs(
    stamps_s: np.ndarray, positions_m: np.ndarray, settings: RelativeErrorSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Start and end indices (m,), start < end, for stamps (n,) and positions (n, 3). Raises InputError where there are none."""
    if settings.unit == "frames":
        step = 1 if settings.all_pairs else int(settings.delta)
        start = np.arange(0, max(0, len(stamps_s) - int(settings.delta)), step)
        end = start + int(settings.delta)
    elif settings.unit == "seconds":
        start, end = _by_measure(stamps_s, settings)
        if not settings.all_pairs:
            start, end = _chained(start, end)
    elif settings.all_pairs:
        start, end = _by_measure(_travelled(positions_m), settings)
    else:
        start, end = _by_steps(positions_m, settings.delta)
    if len(start):
        return start, end
    spans = {"seconds": stamps_s[-1] - stamps_s[0], "metres": _travelled(positions_m)[-1]}
    span = f" over {spans[settings.unit]:.3f} {settings.unit[0]}" if settings.unit in spans else ""
    hint = "another delta, or a larger tolerance" if span else "a smaller delta"
    found = f"{len(stamps_s)} associated poses{span}"
    raise InputError(f"poses {settings.delta:g} {settings.unit} apart", found=found, hint=hint)


def _by_measure(measure: np.ndarray, settings: RelativeErrorSettings) -> tuple[np.ndarray, np.ndarray]:
    """From every pose the later one whose measure is closest to its own + delta (ties: the earlier), within tolerance.

    measure (n,) never falls.
    """
    start, last = np.arange(len(measure) - 1), len(measure) - 1
    after = np.searchsorted(measure, measure[:-1] + settings.delta)
    # of several poses of the same measure (a camera that rests) the first one counts
    before = np.searchsorted(measure, measure[np.clip(after - 1, 0, last)])
    before, after = np.clip(before, start + 1, last), np.clip(after, start + 1, last)
    off_before, off_after = (np.abs(measure[end] - measure[start] - settings.delta) for end in (before, after))
    end, off = np.where(off_before <= off_after, before, after), np.minimum(off_before, off_after)
    good = off <= settings.tolerance * settings.delta
    return start[good], end[good]


def _chained(start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of pairs ordered by start: the first, then each time the next that starts no earlier than the last ended."""
    chosen, row = [], 0
    following = np.searchsorted(start, end).tolist()
    while row < len(start):
        chosen.append(row)
        row = following[row]
    return start[chosen], end[chosen]


def _by_steps(positions_m: np.ndarray, delta_m: float) -> tuple[np.ndarray, np.ndarray]:
    """End to end: a pair ends at the first pose by which at least delta was travelled since its start."""
    ends, travelled_m = [0], 0.0
    for index, step_m in enumerate(np.linalg.norm(np.diff(positions_m, axis=0), axis=1).tolist(), 1):
        travelled_m += step_m
        if travelled_m >= delta_m:
            ends.append(index)
            travelled_m = 0.0
    return np.array(ends[:-1], int), np.array(ends[1:], int)


def _travelled(positions_m: np.ndarray) -> np.ndarray:
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(positions_m, axis=0), axis=1))])
