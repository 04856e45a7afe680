"""Relative pose error (RPE): the error of the motion between two poses that are a given number of
frames, seconds or metres apart.

Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012, section VII: E_i =
(Q_i^-1 Q_j)^-1 (P_i^-1 P_j) with Q the ground truth and P the estimate; (i, j) is called an RPE
pair.
"""

import re
from dataclasses import dataclass, field
from typing import Any

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
    """Selection of the RPE pairs, and correction of the scale."""

    group = "relative error settings"

    delta: float = setting(1.0, "distance of the poses of a pair, in `unit`", low=1e-9, option="")
    unit: str = setting(
        "frames",
        "unit of delta",
        choices=dict.fromkeys(("frames", "seconds", "metres"), ""),
        option="",
    )
    all_pairs: bool = setting(
        True,
        "a pair starts at every pose; otherwise each starts at the end of the last one",
        option="",
    )
    tolerance: float = setting(
        0.1,
        "maximum deviation of a pair from delta, as a share of delta "
        "(seconds, and metres from every pose)",
        low=0.0,
        high=0.999,
    )
    measured_on: str = setting(
        "reference",
        "trajectory along which metres are measured",
        choices={
            "reference": "gives every estimate the same pairs",
            "estimate": "as evo and the TUM tools do",
        },
    )
    correct_scale: bool = setting(False, "first scale the estimate by its Sim(3) alignment")
    association: AssociationSettings = field(default_factory=AssociationSettings)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.unit == "frames" and self.delta != int(self.delta):
            raise InputError("a whole number of frames", setting="delta", found=self.delta)


@dataclass(frozen=True, eq=False, repr=False)
class RelativeError(PoseErrors):
    """Errors of m RPE pairs, from pose start (m,) to pose end (m,), which index `reference` and
    `stamps_s`.
    """

    start: np.ndarray
    end: np.ndarray
    scale: float

    @property
    def error_stamps_s(self) -> np.ndarray:
        """(m,) stamps of the first poses of the RPE pairs, in seconds."""
        return self.stamps_s[self.start]

    def to_dict(self) -> dict[str, Any]:
        """As of PoseErrors, with the scale that the estimate was multiplied by."""
        return super().to_dict() | {"scale": self.scale}


def parse_delta(text: str) -> tuple[float, str]:
    """`10` (frames), `0.5s` or `1m` -> number and unit. Raises InputError."""
    match = re.fullmatch(r"\s*(\d+\.?\d*|\.\d+)\s*(m|s|)\s*", text)
    if match is None:
        raise InputError("a delta such as 10 (frames), 0.5s (seconds) or 1m (metres)", found=text)
    return float(match[1]), {"": "frames", "s": "seconds", "m": "metres"}[match[2]]


def relative_error(
    reference: Trajectory, estimate: Trajectory, settings: RelativeErrorSettings | None = None
) -> RelativeError:
    """RPE of an estimate. Raises InputError if no stamps match, or no two poses are delta apart."""
    settings = settings or RelativeErrorSettings()
    association = pair_up(reference, estimate, settings.association)
    truth = reference.T_world_camera[association.first]
    poses = estimate.T_world_camera[association.second]
    scale = 1.0
    if settings.correct_scale:
        if np.ptp(poses.translation, axis=0).max() == 0.0:
            expected = "an estimate that moves, to correct its scale"
            raise InputError(expected, found="one that does not move")
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
    """Start and end indices (m,), start < end, for stamps (n,) and positions (n, 3).

    Raises InputError if there are none.
    """
    if settings.unit == "frames":
        step = 1 if settings.all_pairs else int(settings.delta)
        start = np.arange(0, max(0, len(stamps_s) - int(settings.delta)), step)
        end = start + int(settings.delta)
    elif settings.unit == "seconds":
        start, end = _pairs_by_measure(stamps_s, settings)
        if not settings.all_pairs:
            start, end = _end_to_end(start, end)
    elif settings.all_pairs:
        start, end = _pairs_by_measure(_distance_travelled(positions_m), settings)
    else:
        start, end = _end_to_end_by_length(positions_m, settings.delta)
    if len(start):
        return start, end
    spans = {"seconds": stamps_s[-1] - stamps_s[0], "metres": _distance_travelled(positions_m)[-1]}
    found = f"{len(stamps_s)} associated poses"
    hint = "a smaller delta"
    if settings.unit in spans:
        found += f" over {spans[settings.unit]:.3f} {settings.unit[0]}"
        hint = "another delta, or a larger tolerance"
    raise InputError(f"poses {settings.delta:g} {settings.unit} apart", found=found, hint=hint)


def _pairs_by_measure(
    measure: np.ndarray, settings: RelativeErrorSettings
) -> tuple[np.ndarray, np.ndarray]:
    """For every pose, the later one whose measure is closest to that of the first + delta (ties:
    the earlier), within tolerance.

    measure (n,): time or distance; it does not decrease.
    """
    start = np.arange(len(measure) - 1)
    last = len(measure) - 1
    after = np.searchsorted(measure, measure[:-1] + settings.delta)
    # of several poses with the same measure (the camera does not move) the first one is used
    before = np.searchsorted(measure, measure[np.clip(after - 1, 0, last)])
    before = np.clip(before, start + 1, last)
    after = np.clip(after, start + 1, last)
    error_before = np.abs(measure[before] - measure[start] - settings.delta)
    error_after = np.abs(measure[after] - measure[start] - settings.delta)
    end = np.where(error_before <= error_after, before, after)
    error = np.minimum(error_before, error_after)
    good = error <= settings.tolerance * settings.delta
    return start[good], end[good]


def _end_to_end(start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """End-to-end pairs, from pairs sorted by start: the first one, then always the next one that
    starts at or after the end of the last.
    """
    chosen = []
    row = 0
    following = np.searchsorted(start, end).tolist()
    while row < len(start):
        chosen.append(row)
        row = following[row]
    return start[chosen], end[chosen]


def _end_to_end_by_length(positions_m: np.ndarray, delta_m: float) -> tuple[np.ndarray, np.ndarray]:
    """End-to-end pairs: a pair ends at the first pose that is at least delta_m of travelled
    distance from its start.
    """
    ends = [0]
    travelled_m = 0.0
    steps_m = np.linalg.norm(np.diff(positions_m, axis=0), axis=1)
    for index, step_m in enumerate(steps_m.tolist(), 1):
        travelled_m += step_m
        if travelled_m >= delta_m:
            ends.append(index)
            travelled_m = 0.0
    return np.array(ends[:-1], int), np.array(ends[1:], int)


def _distance_travelled(positions_m: np.ndarray) -> np.ndarray:
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(positions_m, axis=0), axis=1))])
