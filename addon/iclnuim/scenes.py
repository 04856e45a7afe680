"""The built-in scenes and trajectories: the one list that command line, panel and farm read. The code that builds them lies in blend/builder/ of the repository."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SceneEntry:
    """A scene shipped as blend/NAME.blend, with trajectories/NAME/kt0.txt and so on; `title` and `description` are for people."""

    name: str
    title: str
    description: str


SCENES = {
    "living_room": SceneEntry("living_room", "Living room", "4.94 x 5.02 x 2.50 m, after the paper's (section III)"),
    "office": SceneEntry("office", "Office", "5.0 x 7.4 x 2.40 m, after the paper's (section III)"),
}

#: name -> description; each is there for every scene
TRAJECTORIES: dict[str, str] = {
    "kt0": "1510 frames (paper, Table I); passes a bare wall",
    "kt1": "967 frames (paper, Table I)",
    "kt2": "882 frames (paper, Table I)",
    "kt3": "1242 frames (paper, Table I); closes a small loop",
}
