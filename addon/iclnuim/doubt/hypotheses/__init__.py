"""The hypotheses on poses and stamps: one module each, and a line below. Those on stamps are other
time axes (`time.py`), which `against_truth.py` tries with those on poses.
"""

from ..hypothesis import Files, Hypothesis, Said
from . import axes, body, inverse, mirror, quaternion_order, scale, time

#: In the order in which mistakes are undone.
_MODULES = (quaternion_order, inverse, mirror, axes, body, scale)
#: What each kind says.
WORDS: dict[str, Said] = {
    kind: words for module in (*_MODULES, time) for kind, words in module.WORDS.items()
}


def hypotheses(files: Files) -> list[Hypothesis]:
    """All hypotheses on the poses of these files."""
    return [one for module in _MODULES for one in module.hypotheses(files)]
