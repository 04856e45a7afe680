"""What an estimate looks like whose system lost track: held poses, identities, a few poses far off,
a restart.
"""

import numpy as np

from ..evaluation.align import umeyama
from ..geometry.se3 import SE3

#: Poses that are held or the identity are reported above this share of all.
_SHARE = 0.1
#: Errors this many times the median are outliers, if not more than this share of the poses has one.
_OUTLIER = 20.0
_FEW = 0.1
_ROUNDS = 5
#: With a restart each part fits by itself to this share of the error of the whole, and is of at
#: least so many poses.
_PART_SHARE = 0.25
_MIN_PART = 10


def signs_of_lost_track(reference: SE3, estimate: SE3) -> list[str]:
    """Sentences on associated poses (n,) of both."""
    found = []
    same = (estimate.rotation[1:] == estimate.rotation[:-1]).all((1, 2))
    held = int((same & (estimate.translation[1:] == estimate.translation[:-1]).all(1)).sum())
    identity = int(_is_identity(estimate).sum())
    total = f"of the estimate's {len(estimate)} compared poses"
    if identity > max(1, _SHARE * len(estimate)):
        found.append(f"{identity} {total} are the identity, as a system writes them without a pose")
    elif held > max(1, _SHARE * len(estimate)):
        found.append(f"{held} {total} repeat the pose before them, as where a system lost track")
    found += _outliers(reference, estimate) or _restart(reference, estimate)
    return found


def _is_identity(poses: SE3) -> np.ndarray:
    return (poses.rotation == np.eye(3)).all((1, 2)) & (poses.translation == 0).all(1)


def _errors_m(
    reference: SE3, estimate: SE3, used: np.ndarray | slice, with_scale: bool = False
) -> np.ndarray:
    """Distances (n,) after the alignment of the used poses (n,)."""
    x, y = estimate.translation, reference.translation
    T, scale = umeyama(x[used], y[used], with_scale=with_scale)
    return np.linalg.norm(y - T.apply(scale * x), axis=1)


def _outliers(reference: SE3, estimate: SE3) -> list[str]:
    spread_m = np.linalg.norm(estimate.translation - np.median(estimate.translation, 0), axis=1)
    used = spread_m <= _OUTLIER * np.median(spread_m)
    for _ in range(_ROUNDS):
        if np.count_nonzero(used) < 3:
            return []
        errors_m = _errors_m(reference, estimate, used)
        used = errors_m <= _OUTLIER * np.median(errors_m)
    count = int(np.count_nonzero(~used))
    if not 0 < count <= _FEW * len(used):
        return []
    poses = "1 pose is" if count == 1 else f"{count} poses are"
    rest_m = _rms(errors_m[used])
    first = int(np.flatnonzero(~used)[0])
    return [
        f"{poses} up to {errors_m.max():.3g} m off, the first is number {first + 1} of the compared "
        f"ones; without {'it' if count == 1 else 'them'} the ATE is {1e3 * rest_m:.3g} mm"
    ]


def _restart(reference: SE3, estimate: SE3) -> list[str]:
    steps_m = np.linalg.norm(np.diff(estimate.translation, axis=0), axis=1)
    jump = int(np.argmax(steps_m)) + 1
    parts = slice(0, jump), slice(jump, len(estimate))
    if min(jump, len(estimate) - jump) < _MIN_PART:
        return []
    every = slice(0, len(estimate))
    rigid_m, scaled_m = (
        [_rms(_errors_m(reference[o], estimate[o], slice(None), scale)) for o in (every, *parts)]
        for scale in (False, True)
    )
    own_scale = max(scaled_m[1:]) < _PART_SHARE * max(rigid_m[1:])
    whole_m, *parts_m = scaled_m if own_scale else rigid_m
    if max(parts_m) > _PART_SHARE * whole_m:
        return []
    return [
        f"the estimate jumps by {steps_m[jump - 1]:.3g} m after {jump} compared poses, and each "
        f"part fits by itself{' with a scale of its own' if own_scale else ''} (to "
        f"{1e3 * parts_m[0]:.3g} and {1e3 * parts_m[1]:.3g} mm): the system may have started again "
        "in another world"
    ]


def _rms(errors_m: np.ndarray) -> float:
    return float(np.sqrt(np.mean(errors_m**2)))
