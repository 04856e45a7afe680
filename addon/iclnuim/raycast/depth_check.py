"""Independent check of rendered depth, instances and normals: Embree casts the same rays at the
same triangles.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..channels import INSTANCE, NORMAL
from ..errors import InputError
from ..formats.scene_model import SceneModel
from ..geometry.camera import CameraOrText, PinholeCamera
from ..geometry.se3 import SE3, Poses
from .caster import RayCaster

#: A pixel is on an edge if depth at this offset from its centre differs from the plane at the
#: centre
EDGE_OFFSET_PX = 0.1
#: by more than this share of depth.
EDGE_TOLERANCE = 1e-4
#: If depth differs by more than this, pixel and ray hit different surfaces: an outline.
_SAME_PLACE_M = 1e-4
#: Cycles and Embree compute in float32: transforming the camera and the vertices, the direction of
#: the ray, and where it hits round by up to this many steps of a number as large as depth.
_STEPS = 8
#: Surfaces coincide if their depths differ by less than this share.
_COINCIDENT = 1e-5
#: Required accuracy of normals.
PROMISED_DEG = 0.1


@dataclass(frozen=True)
class RayDepthErrors:
    """|Z - Z of the rays| in metres over the pixels that are not on an edge; `edge_share` and
    `one_sided_share` are shares of all pixels.

    A pixel is one-sided if only one of the two has a surface there.
    """

    pixels: int
    median_m: float
    p999_m: float
    max_m: float
    within_01mm_share: float
    edge_share: float
    one_sided_share: float


@dataclass(frozen=True)
class TruthErrors:
    """Over pixels with a single surface, without outlines: shares of equal instances and of normals
    within PROMISED_DEG; angles in degrees.

    outline_share, coincident_share: of the pixels with a surface, the share on outlines, and the
    share with coincident surfaces.
    """

    equal_instance_share: float
    normal_median_deg: float
    normal_p999_deg: float
    normal_within_share: float
    outline_share: float
    coincident_share: float


class GlassCaster(RayCaster):
    """Depth for a job's `glass` setting: of the surfaces `behind` panes, or with `holes` where a
    pane is in front of them.
    """

    def __init__(self, surface: RayCaster, behind: RayCaster, holes: bool) -> None:
        self._surface = surface
        self._behind = behind
        self._holes = holes

    def depth(
        self, camera: CameraOrText, T_world_camera: Poses, offset_px: Sequence[float] = (0.0, 0.0)
    ) -> np.ndarray:
        """(h, w) planar Z in metres, 0 without depth."""
        behind = self._behind.depth(camera, T_world_camera, offset_px)
        if not self._holes:
            return behind
        in_front = self._surface.depth(camera, T_world_camera, offset_px)
        return np.where(behind == in_front, behind, 0.0)


def compare_depth(
    depth_z_m: np.ndarray, caster: RayCaster, camera: PinholeCamera, T_world_camera: SE3
) -> np.ndarray:
    """(h, w) signed error in metres; NaN on edges, +-inf where only one of the two has depth.

    Raises InputError for an image of another size.
    """
    if depth_z_m.shape != (camera.height, camera.width):
        found = " x ".join(map(str, depth_z_m.shape[::-1]))
        raise InputError(f"{camera.width} x {camera.height} as in the camera", found=found)
    truth = caster.depth(camera, T_world_camera)
    error = depth_z_m.astype(float) - truth
    error[(depth_z_m > 0) != (truth > 0)] = np.inf
    error[_edges(caster, camera, T_world_camera, truth)] = np.nan
    return error


def _edges(
    caster: RayCaster, camera: PinholeCamera, T_world_camera: SE3, centre: np.ndarray
) -> np.ndarray:
    """(h, w) bool: edges.

    On a plane 1/Z is linear in the image, so its second difference over a tenth of a pixel is 0.
    """
    found = np.zeros(centre.shape, bool)
    nothing_around = np.ones(centre.shape, bool)
    for u, v in ((EDGE_OFFSET_PX, 0.0), (0.0, EDGE_OFFSET_PX)):
        sides = [caster.depth(camera, T_world_camera, (sign * u, sign * v)) for sign in (1, -1)]
        with np.errstate(divide="ignore", invalid="ignore"):
            bend = np.abs(centre / sides[0] + centre / sides[1] - 2.0)
        found |= ~(bend < EDGE_TOLERANCE)
        nothing_around &= (sides[0] == 0) & (sides[1] == 0)
    return found & ((centre > 0) | ~nothing_around)


def rounding_m(depth_z_m: np.ndarray) -> np.ndarray:
    """The error in metres that depth in metres may have because float32 is rounded."""
    return _STEPS * np.finfo(np.float32).eps * np.abs(np.asarray(depth_z_m, float))


def depth_summary(errors: list[np.ndarray], depths_z_m: list[np.ndarray]) -> RayDepthErrors:
    """Statistics over the images of `compare_depth`, and the depth (h, w) in metres of each. An
    error is within 0.1 mm if it is but for the rounding of float32.
    """
    every = np.concatenate([e.ravel() for e in errors])
    is_inner = ~np.isnan(every)
    inner = np.abs(every[is_inner])
    rounded_m = rounding_m(np.concatenate([z.ravel() for z in depths_z_m])[is_inner])
    finite = inner[np.isfinite(inner)]
    p50, p999 = np.percentile(finite, (50, 99.9)) if len(finite) else (np.nan, np.nan)
    return RayDepthErrors(
        pixels=len(every),
        median_m=float(p50),
        p999_m=float(p999),
        max_m=float(finite.max(initial=0.0)),
        within_01mm_share=float((inner <= 1e-4 + rounded_m).mean()) if len(inner) else float("nan"),
        edge_share=float(np.isnan(every).mean()),
        one_sided_share=float(np.isinf(every).mean()),
    )


class TruthCaster:
    """Computes the channels of ground-truth frames by casting rays at a scene model; normals are
    interpolated over triangles.
    """

    def __init__(self, model: SceneModel) -> None:
        self._model = model
        self._caster = RayCaster.of_model(model)
        self._of_instance: dict[int, RayCaster] = {}

    def frame(
        self, camera: PinholeCamera, T_world_camera: SE3
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(h, w) planar Z in metres, 0 without a hit; (h, w) instance; (h, w, 3) unit normal of the
        visible side, in the cv camera's frame.
        """
        rays = camera.rays() @ T_world_camera.rotation.T
        hits = self._caster.cast(T_world_camera.translation, rays)
        triangle = np.maximum(hits.triangle, 0)
        seen = (hits.triangle >= 0) & (self._model.instance[triangle] > 0)
        u, v = np.moveaxis(hits.uv.astype(float), -1, 0)
        weights = np.stack([1 - u - v, u, v], -1)
        normal = np.einsum("hwk,hwkc->hwc", weights, self._model.normals[triangle])
        a, b, c = np.moveaxis(self._model.corners_m[triangle], -2, 0)
        behind = np.einsum("hwc,hwc->hw", np.cross(b - a, c - a), rays) > 0
        normal = np.where(behind[..., None], -normal, normal) @ T_world_camera.rotation
        normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
        instance = np.where(seen, self._model.instance[triangle], 0)
        return np.where(seen, hits.distance, 0), instance, normal

    def compare(
        self, frame: dict[str, np.ndarray], camera: PinholeCamera, T_world_camera: SE3
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Compare a frame's channels where there is a single surface: (n,) whether instances are
        equal, (n,) degrees between normals; and the number of pixels (3,) with a surface, an
        outline, and coincident surfaces.
        """
        depth_z_m, instance, normal = self.frame(camera, T_world_camera)
        seen = (depth_z_m > 0) | (frame["Z"] > 0)
        same = (depth_z_m > 0) & (np.abs(frame["Z"] - depth_z_m) < _SAME_PLACE_M)
        found = np.stack([frame[name] for name in NORMAL], -1).astype(float)
        half_chord = np.linalg.norm(found - normal, axis=-1) / 2
        degrees = np.degrees(2 * np.arcsin(np.minimum(half_chord, 1)))
        coincident = np.zeros_like(same)
        for number in np.unique(frame[INSTANCE][same & (frame[INSTANCE] != instance)]):
            rows = same & (frame[INSTANCE] == number) & (frame[INSTANCE] != instance)
            rays = camera.rays()[rows]
            coincident[rows] = self._coincides(int(number), rays, T_world_camera, depth_z_m[rows])
        single = same & ~coincident
        counts = np.array([seen.sum(), (seen & ~same).sum(), coincident.sum()])
        return (frame[INSTANCE] == instance)[single], degrees[single], counts

    def _coincides(
        self, number: int, rays: np.ndarray, T_world_camera: SE3, depth_z_m: np.ndarray
    ) -> np.ndarray:
        """(n,) whether the instance `number` is also at these depths (n,) along rays (n, 3)."""
        selected = self._model.instance == number
        if not selected.any():
            return np.zeros(len(rays), bool)
        if number not in self._of_instance:
            self._of_instance[number] = RayCaster.of_model(self._model.chosen(selected))
        caster = self._of_instance[number]
        hits = caster.cast(T_world_camera.translation, rays @ T_world_camera.rotation.T)
        return np.abs(hits.distance - depth_z_m) <= _COINCIDENT * depth_z_m


def truth_summary(found: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> TruthErrors:
    """Statistics over the results of `TruthCaster.compare` for all frames."""
    equal = np.concatenate([one[0] for one in found])
    degrees = np.concatenate([one[1] for one in found])
    seen, outline, coincident = np.sum([one[2] for one in found], 0)
    if not len(equal):  # only sky is not an error
        equal = np.array([not seen])
        degrees = np.array([180.0 if seen else 0.0])
    return TruthErrors(
        equal_instance_share=float(equal.mean()),
        normal_median_deg=float(np.median(degrees)),
        normal_p999_deg=float(np.percentile(degrees, 99.9)),
        normal_within_share=float((degrees < PROMISED_DEG).mean()),
        outline_share=float(outline / max(seen, 1)),
        coincident_share=float(coincident / max(seen, 1)),
    )
