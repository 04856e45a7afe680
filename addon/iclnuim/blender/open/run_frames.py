"""The frames of a run that a scene is opened for."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class RunFrames:
    """poses: the number of poses, which get the timeline of the scene from frame 0 on. last: the
    last frame that is rendered; simulations are baked up to it. report: receives what a bake will
    take, and how far it is. begin: receives its estimated seconds.
    """

    poses: int
    last: int
    report: Callable[[str], object] = lambda text: None
    begin: Callable[[float], object] = lambda seconds: None
