"""Another unit of length, or none."""

from ...geometry.scene_axes import UNITS_M, unit_name
from ...geometry.se3 import SE3
from ..change import Change
from ..compared_poses import ComparedPoses
from ..hypothesis import Files, Hypothesis, Words

KIND = "scale"
#: Scales within this factor are a drift of scale.
DRIFT_OF_SCALE = 1.15
#: Length in metres of the units that are named, and within which share of a scale.
_NAMED_M = {unit_name(UNITS_M[unit]): UNITS_M[unit] for unit in ("mm", "cm", "in", "ft")}
_NAMED_M["kilometres"] = 1e3
_NAMED_WITHIN = 0.01


def scaled(scale: float) -> Change:
    def change(T: SE3) -> SE3:
        return SE3(T.rotation, scale * T.translation)

    return Change(KIND, change, parameters={"scale": scale}, free=1)


def _fit(poses: ComparedPoses) -> Change | None:
    scale = poses.scale()
    return None if is_drift(scale) else scaled(scale)


_OF_ALL = [Hypothesis(KIND, _fit, group=KIND)]


def is_drift(scale: float) -> bool:
    """Whether a scale is so near 1 that it may be a drift."""
    return 1 / DRIFT_OF_SCALE < scale < DRIFT_OF_SCALE


def _words(change: Change, format: str) -> Words:
    scale = change.parameters["scale"]
    found = []
    for subject, factor in (("it", scale), ("the ground truth", 1 / scale)):
        for name, length_m in _NAMED_M.items():
            if abs(factor / length_m - 1) < _NAMED_WITHIN:
                found.append(f"{subject} may be in {name}")
    advice = "converting it to metres, or correcting its scale"
    if not found:
        found.append("it may have no unit of length")
        advice = "correcting its scale"
    return Words(f"multiplied by {scale:.4g}", " or ".join(found), advice)


def hypotheses(files: Files) -> list[Hypothesis]:
    return [] if files.scale_is_corrected else _OF_ALL


WORDS = dict.fromkeys((KIND,), _words)
