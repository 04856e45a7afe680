"""ICP+RGB-D: T. Whelan et al., "Robust real-time visual odometry for dense RGB-D mapping", ICRA 2013, section IV."""

from dataclasses import dataclass, replace

from ..geometry.se3 import SE3
from .icp import Icp, IcpSettings, PlaneTerm
from .photometric import PhotometricSettings, no_contrast, photometric_passes
from .protocol import Result, Status
from .pyramid import Level
from .solver import Limits, Linearise, Pass, Stop, System, solve


@dataclass(frozen=True)
class IcpRgbdSettings:
    """The two terms and how they join; iterations, stop and limits are those of `icp`, without its least eigenvalue.

    weights: "consistent"; "kintinuous2013" repeats a slip (matrix weighted by w^2, right-hand side by w); "information"
    takes each term by its own variance, which makes it independent of units. Of a sensor's frames: rough_spread, whose
    errors reach farther; rough_scale, standard deviation of the motion's length, as their depth is biased (`released` noise
    by 0.16 % a metre, and so 0.6 % of a motion seen from 2 m); rough_prior_m, as where the image alone holds the motion.
    """

    icp: IcpSettings = IcpSettings()
    photometric: PhotometricSettings = PhotometricSettings(min_gradients=(12, 5, 3), max_depth_m=13.0)
    weights: str = "consistent"
    weight_rgbd: float = 0.1  # of the photometric term (Whelan 2013)
    rough_spread: float = 0.0
    rough_scale: float = 0.0
    rough_prior_m: float = 0.0


PRESETS = {
    "paper": IcpRgbdSettings(),
    "kintinuous2013": IcpRgbdSettings(weights="kintinuous2013"),
    "best": IcpRgbdSettings(
        IcpSettings(
            iterations=(0, 2, 2, 2),
            strides=(1, 2, 1, 1),
            bilateral=False,
            max_angle_deg=12.0,
            two_normals=True,
            nu=10.0,
            spread=30.0,
            rough_step=3,
            stop=Stop(min_step=5e-6),
            limits=Limits(prior_m=0.003),
            reference="keyframe",
        ),
        PhotometricSettings(
            min_gradients=(12, 2, 3, 3),
            max_depth_m=13.0,
            nu=5.0,
            mean_gradient=True,
            spread=75.0,
            tiles=True,
            stop=Stop(min_step=5e-6),
        ),
        weights="information",
        rough_spread=300.0,
        rough_scale=0.1,
        rough_prior_m=0.01,
    ),
}


class IcpRgbd(Icp):
    name, reads_grey = "icp_rgbd", True

    def __init__(self, settings: IcpRgbdSettings) -> None:
        super().__init__(settings.icp)
        self.settings = settings

    def align(self, reference: list[Level], current: list[Level], guess: SE3) -> Result:
        """By geometry alone where the images hold nothing to align, or are unrelated."""
        if no_contrast(reference, current):
            return super().align(reference, current, guess)
        s, icp, rough, schedule = self.settings, self.icp, self.rough(current), self.schedule(reference)
        scale, limits = 0.0, replace(icp.limits, min_eigenvalue=0.0)
        if rough:
            icp, scale = replace(icp, spread=s.rough_spread), s.rough_scale
            limits = replace(limits, prior_m=s.rough_prior_m or limits.prior_m)
        planes = {n: PlaneTerm(reference[n], current[n], icp, n) for n, _ in schedule}
        passes, finest = photometric_passes(reference, current, s.photometric, schedule)
        levels = [n for n, _ in schedule] + [schedule[-1][0]] * (len(passes) - len(schedule))
        joint = [
            Pass(_joint(planes[n], p.linearise, s, scale), p.iterations, planes[n].pixels, icp.stop)
            for n, p in zip(levels, passes, strict=True)
        ]
        result = solve(joint, guess, limits)
        if result.status is not Status.FAILED and finest.unrelated():
            return super().align(reference, current, guess)
        return result


def _joint(plane: PlaneTerm, photometric: Linearise, settings: IcpRgbdSettings, scale: float) -> Linearise:
    def linearise(T: SE3, iteration: int) -> System:
        w = settings.weight_rgbd
        geometry, image = plane(T, iteration), photometric(T, iteration)
        if scale:
            geometry = geometry.without_scale(T.translation, scale)
        if settings.weights == "information":
            return geometry.plus(image)
        return geometry.plus(image, w * w, w if settings.weights == "kintinuous2013" else w * w)

    return linearise
