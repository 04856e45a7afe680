"""Settings of the volume and of fusing a sequence; without numba, so that the command can name them."""

from dataclasses import dataclass, field

from ..errors import InputError
from ..settings import Settings, same_as, setting


@dataclass(frozen=True)
class VolumeSettings(Settings):
    """A frame counts from truncation_m before its surface to as far behind it. Behind the rim of a thing its front so grows
    walls of that depth, where nothing was seen, and slanted views of curved things shrink them. With a smaller behind_m
    distances are taken along the normal, slanted views weigh less, and the weight falls to 0 that far behind the surface.
    """

    group = "volume settings"

    voxel_m: float = setting(
        4.5 / 512, "side of a voxel", unit="m", low=1e-6, high=1.0, option="--voxel", source="Handa 2014, VI-C"
    )
    truncation_m: float = setting(
        0.045, "largest distance kept, two voxels or more", unit="m", option="--truncation", source="Handa 2014, VI-C"
    )
    behind_m: float = setting(0.045, "how far behind its surface a frame counts", unit="m", option="")
    slanted: int = setting(
        1,
        "times truncation_m along z that a slanted surface counts behind itself; above 1: where it continues",
        low=1,
        high=10,
        option="",
    )
    window_blocks: int = setting(256, "side of the window, a power of two", unit="blocks of 8 voxels", low=4, option="")
    max_weight: int = setting(255, "frames that the running mean counts", low=1, high=4000, option="")
    max_blocks: int = setting(120_000, "blocks of 8^3 voxels held at once; 120000 take 0.9 GB", low=1)
    far_m: float = setting(8.0, "no depth beyond this", unit="m", low=1e-6, option="--far")
    channels: int = setting(3, "of colour: 0, 1 or 3", low=0, high=3, option="")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.truncation_m < 2 * self.voxel_m:
            found = f"{self.voxel_m:g} and {self.truncation_m:g}"
            raise InputError("voxels of 0..1 m and a truncation of at least two of them", found=found)
        if not 2 * self.voxel_m <= self.behind_m <= self.truncation_m:
            raise InputError("two voxels or more behind the surface, no more than the truncation", found=self.behind_m)
        if self.window_blocks & (self.window_blocks - 1) or self.channels == 2:
            found = f"{self.window_blocks} and {self.channels}"
            raise InputError("a window of 4, 8, 16 ... blocks, and 0, 1 or 3 channels", found=found)


#: paper: the cyclic 4.5 m of Kintinuous; best: 18 m, more than the rooms have.
PRESETS = {"paper": VolumeSettings(window_blocks=64), "best": VolumeSettings(behind_m=0.020, slanted=4)}


@dataclass(frozen=True)
class FuseSettings(Settings):
    """How a sequence is fused; `volume` has settings of its own."""

    group = "fusion settings"

    volume: VolumeSettings = field(default_factory=VolumeSettings)
    min_weight: float = setting(
        0.25, "mesh only what so many frames saw, slanted views counting less; use 3 with noise", low=0.0
    )
    frames: str = setting("::", "only these images, as a Python slice A:B:S")
    max_difference_s: float = setting(0.02, "of an image's stamp from a pose's", unit="s", low=1e-9, option="")


#: What a distance from a sample is taken to -> what that means.
NEAREST = {
    "triangle": "of the other surface: no figure depends on the number of samples",
    "sample": "of the other surface's samples, as NICE-SLAM's and Co-SLAM's scripts do: their spacing is in every figure",
}


@dataclass(frozen=True)
class QualitySettings(Settings):
    """How accuracy, completion and Depth L1 of a reconstruction are measured."""

    group = "settings of accuracy and completion"

    samples: int = setting(200_000, "points on each of the two surfaces, spread by area", low=1000, high=50_000_000)
    seed: int = setting(0, "where the samples begin", low=0, high=2**31 - 1)
    nearest: str = setting("triangle", "what distances are taken to", choices=NEAREST)
    every: int = setting(10, "of the trajectory that decides what was seen: every Nth pose", low=1)
    far_m: float = same_as(VolumeSettings, "far_m")
