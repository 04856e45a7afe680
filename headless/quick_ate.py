"""ATE of two ordinary TUM files in plain Python: numpy's import alone takes longer than all of this.

A short command pays for what it imports: numpy's import was 83 of the 155 ms of `iclnuim evaluate ate`, and a fifth of
all that evo_ape takes. So the usual question (two TUM files, SE(3) or Sim(3)) is answered here, and whatever is out of
the ordinary is left to the library by returning None: another form, frame numbers for stamps, a damaged line, a large
file, no overlap in time, paths that hardly fix the alignment, a mirrored estimate. So the library alone words errors
and warnings. A test holds both ways to the same figures.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from itertools import pairwise

from .plain_alignment import PlainAlignment, Quaternion, Vector, angle_deg, rms, times

#: Beyond these the library is faster, or has something to say; they are narrower than its own limits.
LARGEST_BYTES, LARGEST_CANDIDATES = 1_000_000, 50_000
LEAST_PAIRS, LEAST_EXTENT_M, LEAST_EXTENT_SHARE = 10, 1e-3, 1e-2

TAKEN = "TUM: stamps in seconds, right-handed camera-to-world poses in the file's own world"
RECALL_M = {"1cm": 0.01, "5cm": 0.05, "10cm": 0.10}

#: stamps in seconds, positions in metres, unit quaternions (w, x, y, z)
Poses = tuple[list[float], list[Vector], list[Quaternion]]
#: time difference, index in the ground truth, index in the estimate
Pair = tuple[float, int, int]


def quick_ate(
    reference: str, estimate: str, method: str = "se3", max_difference_s: float = 0.02, offset_s: float = 0.0
) -> dict | None:
    """What `iclnuim evaluate ate --json` prints (error_report.py), or None where the library has to look at it."""
    if method not in ("se3", "sim3") or not 0 < max_difference_s <= 1 or not math.isfinite(offset_s):
        return None
    truth, guess = _read(reference), _read(estimate)
    if truth is None or guess is None:
        return None
    pairs = _pairs(truth[0], [stamp + offset_s for stamp in guess[0]], max_difference_s)
    if len(pairs) < LEAST_PAIRS:
        return None
    x, y = [guess[1][j] for _, _, j in pairs], [truth[1][i] for _, i, _ in pairs]
    alignment = PlainAlignment(x, y, with_scale=method == "sim3")
    if not _clear(alignment):
        return None
    errors_deg = [angle_deg(truth[2][i], times(alignment.turn, guess[2][j])) for _, i, j in pairs]
    association = {"method": "greedy", "max_difference_s": max_difference_s, "offset_s": offset_s}
    return {
        "metric": "ate",
        "reference": {"path": reference, "poses": len(truth[0]), "taken": TAKEN},
        "estimate": {"path": estimate, "poses": len(guess[0]), "taken": TAKEN},
        "settings": {"association": association, "alignment": {"method": method, "first": None, "up": "z"}},
        "pairs": len(pairs),
        "largest_difference_s": max(difference_s for difference_s, _, _ in pairs),
        "translation_error_m": _statistics(alignment.errors_m),
        "rotation_error_deg": _statistics(errors_deg),
        **_completeness(alignment.errors_m, len(truth[0])),
        **_diagnostics(alignment),
    }


def _read(path: str) -> Poses | None:
    """A TUM file in which everything is as usual."""
    try:
        with open(path, encoding="utf-8") as file:
            text = file.read(LARGEST_BYTES + 1)
        lines = [line for line in text.split("\n") if line.strip() and not line.lstrip().startswith("#")]
        rows = [list(map(float, line.split())) for line in lines]
    except (OSError, ValueError):
        return None
    if len(text) > LARGEST_BYTES or path.lower().endswith(".gt.freiburg") or len(rows) < LEAST_PAIRS:
        return None
    # float() also takes 1_000 and the digits of other scripts, which the library refuses
    if any(len(row) != 8 for row in rows) or any("_" in line or not line.isascii() for line in lines):
        return None
    return _poses(rows)


def _poses(rows: list[list[float]]) -> Poses | None:
    stamps_s, positions_m = [row[0] for row in rows], [(row[1], row[2], row[3]) for row in rows]
    lengths = [math.hypot(*row[4:]) for row in rows]
    # two whole stamps at the start may be frame numbers; the comparisons are written so that NaN fails them
    usual = (
        not (stamps_s[0].is_integer() and stamps_s[1].is_integer())
        and all(before < after for before, after in pairwise(stamps_s))
        and all(-1e10 < stamp < 1e10 for stamp in stamps_s)
        and all(-1e4 < part < 1e4 for position in positions_m for part in position)
        and all(-5e-3 < length - 1 < 5e-3 for length in lengths)
    )
    if not usual:
        return None
    quats: list[Quaternion] = [(r[7] / n, r[4] / n, r[5] / n, r[6] / n) for r, n in zip(rows, lengths, strict=True)]
    return stamps_s, positions_m, quats


def _pairs(first_s: list[float], second_s: list[float], limit_s: float) -> list[Pair]:
    """The TUM rule as a plain loop over sorted candidates, ordered by the truth. Empty where those are too many."""
    candidates, low = [], 0
    for i, stamp in enumerate(first_s):
        j = low = bisect_left(second_s, stamp - 1.1 * limit_s, low)
        while j < len(second_s) and second_s[j] < stamp + 1.1 * limit_s:
            candidates.append((abs(stamp - second_s[j]), i, j))
            j += 1
        if len(candidates) > LARGEST_CANDIDATES:
            return []
    chosen, taken_i, taken_j = [], set(), set()
    for pair in sorted(candidates):
        difference_s, i, j = pair
        if difference_s < limit_s and i not in taken_i and j not in taken_j:
            taken_i.add(i)
            taken_j.add(j)
            chosen.append(pair)
    return sorted(chosen, key=lambda pair: pair[1])


def _clear(alignment: PlainAlignment) -> bool:
    """Whether the library would have nothing to refuse or to warn of, with room to spare."""
    wide = all(
        second > max(LEAST_EXTENT_M, LEAST_EXTENT_SHARE * longest)
        for longest, second, _ in (alignment.extents_x_m, alignment.extents_y_m)
    )
    upright = alignment.reflection_rms_m > 0.6 * alignment.rotation_rms_m
    return wide and upright and alignment.residual_rms_m < 0.9 * alignment.extents_y_m[1]


def _statistics(errors: list[float]) -> dict[str, float]:
    ordered, n = sorted(errors), len(errors)
    mean = math.fsum(errors) / n
    return {
        "rmse": rms(errors),
        "mean": mean,
        "median": (ordered[(n - 1) // 2] + ordered[n // 2]) / 2,
        "std": rms([error - mean for error in errors]),
        "min": ordered[0],
        "max": ordered[-1],
    }


def _completeness(errors_m: list[float], frames: int) -> dict:
    recall = {name: sum(error <= bound for error in errors_m) / frames for name, bound in RECALL_M.items()}
    area = math.fsum(max(0.0, 1 - error / RECALL_M["10cm"]) for error in errors_m) / frames
    return {"coverage": len(errors_m) / frames, "recall": recall, "area_under_curve": area}


def _diagnostics(alignment: PlainAlignment) -> dict:
    w, x, y, z = alignment.turn if alignment.turn[0] >= 0 else [-part for part in alignment.turn]
    motion = {
        "scale": alignment.scale,
        "translation_m": alignment.translation_m,
        "quat_xyzw": [x, y, z, w],
        "poses_used": len(alignment.errors_m),
        "extents_m": alignment.extents_y_m,
        "residual_rms_m": alignment.residual_rms_m,
    }
    rest = {"rotation_rms_m": alignment.rotation_rms_m, "reflection_rms_m": alignment.reflection_rms_m}
    return {"alignment": motion, "mirror": {"mirrored": False, **rest}, "warnings": []}
