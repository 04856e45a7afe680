"""Settings of the volume, of fusion and of surface quality.

This module does not import numba, so that commands can read the settings.
"""

from dataclasses import dataclass, field

from iclnuim.errors import InputError
from iclnuim.settings import Settings, same_as, setting


@dataclass(frozen=True)
class VolumeSettings(Settings):
    """A frame is fused from truncation_m in front of its surface to truncation_m behind it. This
    produces false walls of that depth behind the edges of objects, and slanted views shrink curved
    objects. With a smaller behind_m, distances are measured along the normal, slanted views have
    smaller weights, and the weight decreases to 0 at behind_m behind the surface.
    """

    group = "volume settings"

    voxel_m: float = setting(
        4.5 / 512,
        "side of a voxel",
        unit="m",
        low=1e-6,
        high=1.0,
        option="--voxel",
        source="Handa 2014, VI-C",
    )
    truncation_m: float = setting(
        0.045,
        "truncation distance, at least two voxels; if it is not given, the command fuse uses three "
        "voxels where these are more",
        unit="m",
        high=10.0,
        option="--truncation",
        source="Handa 2014, VI-C",
    )
    behind_m: float = setting(
        0.045, "distance behind its surface up to which a frame is fused", unit="m", option=""
    )
    slanted: int = setting(
        1,
        "multiple of truncation_m, along z, up to which a slanted surface is fused behind itself; "
        "above 1: only where it continues",
        low=1,
        high=10,
        option="",
    )
    window_blocks: int = setting(
        256,
        "side length of the window, a power of two",
        unit="blocks of 8 voxels",
        low=4,
        option="",
    )
    ahead: float = setting(
        0.0,
        "how far the window's centre is before the camera, as a share of half the window: 0, around "
        "the camera, as Kintinuous' program places it by default, to 1, as with its option -d",
        low=0.0,
        high=1.0,
        option="",
    )
    max_weight: int = setting(
        255, "maximum weight of the running mean, in frames", low=1, high=4000, option=""
    )
    max_blocks: int = setting(
        120_000,
        "maximum number of blocks of 8^3 voxels in memory; 120000 take 0.9 GB",
        low=1,
        high=100_000_000,
    )
    far_m: float = setting(8.0, "maximum depth that is used", unit="m", low=1e-6, option="--far")
    channels: int = setting(3, "colour channels: 0, 1 or 3", low=0, high=3, option="")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.truncation_m < 2 * self.voxel_m:
            found = f"{self.voxel_m:g} and {self.truncation_m:g}"
            raise InputError(
                "voxels of 0..1 m and a truncation of at least two of them", found=found
            )
        if not 2 * self.voxel_m <= self.behind_m <= self.truncation_m:
            raise InputError(
                "two voxels or more behind the surface, no more than the truncation",
                found=self.behind_m,
            )
        if self.window_blocks & (self.window_blocks - 1) or self.channels == 2:
            found = f"{self.window_blocks} and {self.channels}"
            raise InputError("a window of 4, 8, 16 ... blocks, and 0, 1 or 3 channels", found=found)

    def reach_m(self, voxel_m: float) -> tuple[float, float]:
        """(truncation_m, behind_m), if they are at least three and two voxels of another side."""
        return max(self.truncation_m, 3 * voxel_m), max(self.behind_m, 2 * voxel_m)


#: paper: the cyclic volume of 4.5 m of Kintinuous; best: 18 m, larger than the rooms.
PRESETS = {
    "paper": VolumeSettings(window_blocks=64),
    "best": VolumeSettings(behind_m=0.020, slanted=4),
}


@dataclass(frozen=True)
class FuseSettings(Settings):
    """Fusion of a sequence; `volume` has separate settings."""

    group = "fusion settings"

    volume: VolumeSettings = field(default_factory=VolumeSettings)
    min_weight: float = setting(
        0.25,
        "mesh only voxels that at least this many frames saw; slanted views count less; use 3 with "
        "noise",
        low=0.0,
    )
    frames: str = setting("::", "only these images, as a Python slice A:B:S")
    max_difference_s: float = setting(
        0.02, "maximum time difference of an image and a pose", unit="s", low=1e-9, option=""
    )


#: Target of the distance from a sample -> explanation.
NEAREST = {
    "triangle": "of the other surface: results do not depend on the number of samples",
    "sample": "of the other surface, as in the scripts of NICE-SLAM and Co-SLAM: results include "
    "the spacing of the samples",
}


@dataclass(frozen=True)
class QualitySettings(Settings):
    """Measurement of accuracy, completion and Depth L1 of a reconstruction."""

    group = "settings of accuracy and completion"

    samples: int = setting(
        400_000,
        "number of samples on each of the two surfaces, uniform by area",
        low=1000,
        high=50_000_000,
    )
    seed: int = setting(0, "random seed of the samples", low=0, high=2**31 - 1)
    nearest: str = setting("triangle", "target of the distances", choices=NEAREST)
    every: int = setting(
        10, "use every Nth pose of the trajectory that determines the seen surface", low=1
    )
    far_m: float = same_as(VolumeSettings, "far_m")
