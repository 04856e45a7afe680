"""Which sequence of the archives published in 2014 a ground truth is, also in a conversion, and
what is known of it (docs/guide/original_data.md).
"""

from dataclasses import dataclass

from ..geometry.trajectory import trajectory_statistics
from ..trajectory_files.trajectories import LoadedTrajectory


@dataclass(frozen=True)
class Archive:
    """A published sequence: the number of its poses, and the length of its path in metres (paper,
    Table I). remark: what else is known.
    """

    room: str
    name: str
    poses: int
    length_m: float
    remark: str = ""

    @property
    def file(self) -> str:
        """The name of its archive; `n` before _frei is that of the noisy one."""
        prefix = "living_room_" if self.room == "living room" else ""
        return f"{prefix}traj{self.name[-1]}_frei_png"


_FIRST = "its first image is number 1 and its first pose number 2"
ARCHIVES = (
    Archive("living room", "kt0", 1508, 6.54, "a jump of the camera reaches 1.84 m/s"),
    Archive("living room", "kt1", 965, 2.05),
    Archive("living room", "kt2", 880, 8.43),
    Archive("living room", "kt3", 1240, 11.32),
    Archive("office", "kt0", 1507, 6.54, _FIRST),
    Archive("office", "kt1", 965, 6.73),
    Archive("office", "kt2", 880, 9.02),
    Archive("office", "kt3", 1240, 7.83),
)
#: Maximum difference of the length from the printed one, which is rounded and of all frames.
_LENGTH = 0.01


def archive_of(loaded: LoadedTrajectory) -> Archive | None:
    """The archive with as many poses and the same length; None if there is none."""
    found = trajectory_statistics(loaded.trajectory)
    for archive in ARCHIVES:
        alike = abs(found.length_m - archive.length_m) <= _LENGTH * archive.length_m
        if found.frames == archive.poses and alike:
            return archive
    return None


def described(archive: Archive, loaded: LoadedTrajectory) -> str:
    """A sentence with what is known of an archive, and how its poses were read."""
    poses = "left-handed poses, read as right-handed"
    if loaded.read_as.handedness != "left":
        poses = "poses of a conversion to right-handed ones"
    facts = [poses, "fy = -480 in its files (480 for right-handed poses)", "no pose for image 0"]
    if archive.remark:
        facts.append(archive.remark)
    return f"{archive.room} {archive.name} of 2014 ({archive.file}): {'; '.join(facts)}"
