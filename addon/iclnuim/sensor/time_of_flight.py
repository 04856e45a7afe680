"""Depth noise of a time-of-flight camera, by its published characterisation: the Azure Kinect DK.

The sensor measures the phase of modulated infrared light, which grows with the length of the ray,
and an amplitude, which falls with its square. Noise, bias and loss follow from both. Light that
arrives by two ways is added as phasors: at edges from two surfaces, in corners over another wall.
"""

from dataclasses import dataclass

import numpy as np

from ..geometry.camera import PinholeCamera
from ..settings import parameter, same_as
from . import depth_image as images
from .active_stereo import D435DepthNoise
from .appearance import WHITE_ALBEDO, SurfaceAppearance, required
from .depth import PaperDepthNoise
from .multipath import longer_way_m
from .noise_model import NoiseModel, gaussian

_HARDWARE = "Microsoft: Azure Kinect DK hardware specifications, depth camera, NFOV unbinned"
_TOLGYESSY = (
    "Tolgyessy, Dekan, Chovanec, Hubinsky, Sensors 2021, 21:413, as BlenderProc's "
    "add_kinect_azure_noise quotes it: 0.5 mm at least, 1 mm at 1 m, 3.6 mm at 3 m"
)
_BOUND = "a guess, below the printed 11 mm + 0.1 % of the distance (" + _HARDWARE + ")"
#: The reflectivity of the darkest target of the operating range.
DARK_ALBEDO = 0.15
_LIGHT_M_PER_S = 299792458.0
#: Samples of a period, whose count makes the error of the phase: Lindner and Kolb 2006.
_SAMPLES = 4


@dataclass(frozen=True)
class AzureKinectDepthNoise(NoiseModel):
    """Along the ray of length r on a surface of albedo a at angle t: sigma^2 = base^2 + (noise
    r^power)^2 0.95 / (a cos t).
    """

    name = "azure_kinect"
    summary = "time of flight, Azure Kinect by published characterisation (asks for colour)"
    asks_appearance = True

    base_m: float = parameter(0.0005, "base of sigma", unit="m", low=0.0, source=_TOLGYESSY)
    noise_m: float = parameter(
        0.00087, "sigma at 1 m besides its base", unit="m", low=0.0, source=_TOLGYESSY
    )
    power: float = parameter(
        1.29,
        "growth of sigma with the distance",
        low=0.0,
        high=4.0,
        source=_TOLGYESSY + "; 1 is shot noise alone, 2 read noise alone",
    )
    wiggle_m: float = parameter(
        0.002, "amplitude of the periodic bias", unit="m", low=0.0, source=_BOUND
    )
    dark_bias_m: float = parameter(
        0.002, "bias of a black surface", unit="m", source=_BOUND + "; white has none"
    )
    near_m: float = parameter(
        0.5, "nearer is missing", unit="m", low=0.0, source=_HARDWARE + ": 0.5 to 3.86 m"
    )
    dark_range_m: float = parameter(
        3.86,
        "distance to which 15 % of reflectivity is measured; others in proportion to the root",
        unit="m",
        low=1e-3,
        source=_HARDWARE + ": 0.5 to 3.86 m for 15 to 95 % reflectivity",
    )
    illumination: float = same_as(D435DepthNoise, "illumination")
    amplitude_noise: float = parameter(
        0.1, "relative noise of the amplitude", low=0.0, high=1.0, source="a guess"
    )
    modulation_hz: float = parameter(
        2e8,
        "frequency of the modulation",
        unit="Hz",
        low=1e6,
        source="Bamji and others, ISSCC 2018, as cited in Azure-Kinect-Sensor-SDK 1807: 200 MHz on "
        "average, 10 to 320 MHz; which the device uses is not printed",
    )
    unambiguous_m: float = parameter(
        15.0,
        "distances wrap at it",
        unit="m",
        low=0.1,
        source="a guess: the frequencies are not printed",
    )
    coherence: float = parameter(
        0.7,
        "mixed pixels whose phasors cancel to less than it are missing",
        unit="share of the sum of amplitudes",
        low=0.0,
        high=1.0,
        source="a guess",
    )
    edge_share: float = same_as(PaperDepthNoise, "edge_share")
    multipath: float = parameter(
        1.0,
        "light over another surface, of that of diffuse surfaces",
        low=0.0,
        source="computed: one bounce between diffuse surfaces",
    )
    depth_step_m: float = parameter(
        0.001, "rounding of the depth", unit="m", low=1e-6, source=_HARDWARE + ": millimetres"
    )

    def apply(
        self,
        depth_z_m: np.ndarray,
        camera: PinholeCamera,
        rng: np.random.Generator,
        appearance: SurfaceAppearance | None = None,
    ) -> np.ndarray:
        """(h, w) planar depth in metres, 0 = missing -> the same with noise, float32. Raises
        InputError without `appearance`.
        """
        appearance = required(appearance, self.name)
        depth_z_m = images.as_depth(depth_z_m)
        x, y = images.ray_slopes(camera)
        ray_length = np.sqrt(1 + x * x + y * y)
        range_m = depth_z_m * ray_length
        albedo = appearance.reflectance(self.illumination)
        reflected = albedo * appearance.cosine(depth_z_m, camera)
        known = range_m > 0
        amplitude = np.divide(reflected, range_m * range_m, out=np.zeros_like(range_m), where=known)
        measured_m, mixed = self.mixed_at_edges(range_m, amplitude)
        if self.multipath:
            measured_m += longer_way_m(
                depth_z_m, camera, albedo, self.radians_per_m, self.multipath
            )
        measured_m += self.bias_m(range_m, albedo)
        measured_m += self.sigma_m(range_m, reflected) * gaussian(rng, range_m.shape)
        seen = known & mixed & self.is_bright_enough(amplitude, rng) & ~appearance.saturated
        seen &= (range_m >= self.near_m) & (measured_m > 0)
        step_m = np.float32(self.depth_step_m)
        wrapped_m = np.mod(measured_m, np.float32(self.unambiguous_m))
        noisy_m = np.rint(wrapped_m / ray_length / step_m) * step_m
        return np.where(seen, noisy_m, np.float32(0))

    @property
    def radians_per_m(self) -> float:
        """Phase per metre of distance, there and back."""
        return 4 * np.pi * self.modulation_hz / _LIGHT_M_PER_S

    @property
    def wiggles_per_m(self) -> float:
        """Phase per metre of the periodic bias."""
        return _SAMPLES * self.radians_per_m

    def sigma_m(self, range_m: np.ndarray, reflected: np.ndarray) -> np.ndarray:
        """The standard deviation (h, w) at these distances, for albedo times cosine."""
        of_light = self.noise_m * range_m ** np.float32(self.power)
        share = np.maximum(reflected, np.float32(1e-4)) / np.float32(WHITE_ALBEDO)
        return np.sqrt(np.float32(self.base_m**2) + of_light * of_light / share)

    def bias_m(self, range_m: np.ndarray, albedo: np.ndarray) -> np.ndarray:
        """The systematic error (h, w): of the phase, `_SAMPLES` periods in one of the modulation,
        and of dark surfaces.
        """
        dark = np.float32(self.dark_bias_m) * (1 - albedo)
        return np.float32(self.wiggle_m) * np.sin(np.float32(self.wiggles_per_m) * range_m) + dark

    def is_bright_enough(self, amplitude: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Whether the amplitude (h, w) with noise reaches that of the darkest target at the end of
        its range.
        """
        darkest = np.float32(DARK_ALBEDO / self.dark_range_m**2)
        noise = np.float32(self.amplitude_noise) * gaussian(rng, amplitude.shape)
        return amplitude * (1 + noise) >= darkest

    def mixed_at_edges(
        self, range_m: np.ndarray, amplitude: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Distances (h, w) where a pixel sees several surfaces, and whether they can be measured.

        A pixel gathers light from its neighbours with the weights 1, 2, 1 in both directions. The
        phase of the sum lies between those of the surfaces: a flying pixel.
        """
        result = range_m.copy()
        measured = np.ones(range_m.shape, bool)
        place = np.flatnonzero(_has_edge(range_m, self.edge_share))
        if not place.size:
            return result, measured
        height, width = range_m.shape
        row, column = np.divmod(place, width)
        own_m = range_m.ravel()[place]
        total = np.zeros(place.size, np.complex64)
        light = np.zeros(place.size, np.float32)
        for dv in (-1, 0, 1):
            for du in (-1, 0, 1):
                v = np.clip(row + dv, 0, height - 1)
                u = np.clip(column + du, 0, width - 1)
                weight = amplitude[v, u] * np.float32((2 - abs(dv)) * (2 - abs(du)))
                phase = np.float32(self.radians_per_m) * (range_m[v, u] - own_m)
                total += weight * np.exp(1j * phase).astype(np.complex64)
                light += weight
        result.ravel()[place] = own_m + np.angle(total) / np.float32(self.radians_per_m)
        measured.ravel()[place] = np.abs(total) >= self.coherence * light
        return result, measured


def _has_edge(range_m: np.ndarray, edge_share: float) -> np.ndarray:
    """Whether a neighbour (h, w) is nearer or farther by more than a share of the distance."""
    edge = np.zeros(range_m.shape, bool)
    for axis in (0, 1):
        before, after = (np.moveaxis(range_m, axis, 0)[part] for part in (np.s_[:-1], np.s_[1:]))
        jump = np.maximum(before, after) > np.float32(1 + edge_share) * np.minimum(before, after)
        along = np.moveaxis(edge, axis, 0)
        along[:-1] |= jump
        along[1:] |= jump
    return edge
