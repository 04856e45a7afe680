"""Pictures of a mesh: rays from a camera outside, back faces left out, lit from the camera."""

import numpy as np

from ..raycast.caster import RayCaster

#: How many back faces a ray may pass.
_PASSES = 12
_BACKGROUND = 255


def picture(
    points: np.ndarray, triangles: np.ndarray, colours: np.ndarray | None, width: int = 960, height: int = 720
) -> np.ndarray:
    """(height, width, 3) uint8: from above and aside, z up, as one looks into a doll's house. colours (n, 3) 0..255."""
    caster = RayCaster(points, triangles)
    low, high = np.percentile(points, (1, 99), axis=0)
    origin, rays = _rays((low + high) / 2, float(np.linalg.norm(high - low)), width, height)
    hit, uv, normal = _front_hits(caster, origin, rays)
    image = np.full((len(rays), 3), _BACKGROUND, np.float32)
    seen = hit >= 0
    facing = np.abs((normal[seen] * rays[seen]).sum(axis=1))
    corners = triangles[hit[seen]]
    if colours is None or not colours.shape[1]:
        colour = np.full((len(corners), 3), 200.0)
    else:
        u, v = uv[seen, :1], uv[seen, 1:]
        parts = colours.astype(np.float32)[corners]
        colour = (1 - u - v) * parts[:, 0] + u * parts[:, 1] + v * parts[:, 2]
    image[seen] = colour * (0.35 + 0.65 * facing[:, None])
    return np.clip(image, 0, 255).astype(np.uint8).reshape(height, width, 3)


def _rays(centre: np.ndarray, size: float, width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    """Origin (3,) and unit directions (width height, 3) of a camera that looks down on the centre at 40 degrees, field of view 40."""
    back = np.array([-0.55, -0.55, 0.0]) / np.hypot(0.55, 0.55) * np.cos(np.radians(40))
    back[2] = np.sin(np.radians(40))
    right = np.cross([0, 0, 1.0], back)
    right /= np.linalg.norm(right)
    up = np.cross(back, right)
    reach = np.tan(np.radians(20))
    x = np.linspace(-1, 1, width) * reach
    y = -np.linspace(-1, 1, height) * reach * height / width
    direction = -back + x[None, :, None] * right + y[:, None, None] * up
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    origin = centre + back * size * 0.5 / np.tan(np.radians(20)) * 0.95
    return origin.astype(np.float32), direction.reshape(-1, 3).astype(np.float32)


def _front_hits(caster: RayCaster, origin: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(triangle or -1, barycentric uv, normal) of the first surface that each ray meets from the front."""
    hit, uv, normal = np.full(len(rays), -1), np.zeros((len(rays), 2), np.float32), np.zeros((len(rays), 3), np.float32)
    origins, remaining = np.repeat(origin[None], len(rays), axis=0), np.arange(len(rays))
    for _ in range(_PASSES):
        if not len(remaining):
            break
        hits = caster.cast(origins[remaining], rays[remaining])
        met = hits.triangle >= 0
        front = met & ((hits.normal * rays[remaining]).sum(axis=1) < 0)
        found = remaining[front]
        hit[found], uv[found], normal[found] = hits.triangle[front], hits.uv[front], hits.normal[front]
        behind = met & ~front
        remaining = remaining[behind]
        origins[remaining] += rays[remaining] * (hits.distance[behind, None] + 1e-4)
    return hit, uv, normal
