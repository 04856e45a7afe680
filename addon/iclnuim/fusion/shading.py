"""Pictures of a mesh: rays from a camera outside, walls that turn their back left out, lit from the camera."""

from __future__ import annotations

import numpy as np

from ..errors import InputError, WorkError

#: How many surfaces that turn their back a ray may pass.
_PASSES = 12
_BACKGROUND = 255


def ray_scene(points: np.ndarray, triangles: np.ndarray):
    """Open3D's RaycastingScene of one mesh. Raises InputError for an empty mesh, WorkError where Open3D is missing."""
    if not len(triangles):
        raise InputError("a mesh with triangles", found="none")
    try:
        import open3d
    except ImportError:
        raise WorkError("this needs Open3D; try: pip install open3d-cpu") from None
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        open3d.core.Tensor(np.ascontiguousarray(points, np.float32)),
        open3d.core.Tensor(np.ascontiguousarray(triangles, np.uint32)),
    )
    return scene


def picture(
    points: np.ndarray, triangles: np.ndarray, colours: np.ndarray | None, width: int = 960, height: int = 720
) -> np.ndarray:
    """(height, width, 3) uint8: from above and aside, z up, as one looks into a doll's house. colours (n, 3) 0..255."""
    scene = ray_scene(points, triangles)
    low, high = np.percentile(points, (1, 99), axis=0)
    rays = _rays((low + high) / 2, float(np.linalg.norm(high - low)), width, height)
    hit, uv, normal = _front_hits(scene, rays)
    image = np.full((len(rays), 3), _BACKGROUND, np.float32)
    seen = hit >= 0
    facing = np.abs((normal[seen] * rays[seen, 3:]).sum(axis=1))
    corners = triangles[hit[seen]]
    if colours is None or not colours.shape[1]:
        colour = np.full((len(corners), 3), 200.0)
    else:
        u, v = uv[seen, :1], uv[seen, 1:]
        parts = colours.astype(np.float32)[corners]
        colour = (1 - u - v) * parts[:, 0] + u * parts[:, 1] + v * parts[:, 2]
    image[seen] = colour * (0.35 + 0.65 * facing[:, None])
    return np.clip(image, 0, 255).astype(np.uint8).reshape(height, width, 3)


def _rays(centre: np.ndarray, size: float, width: int, height: int) -> np.ndarray:
    """(width height, 6): origins and unit directions of a camera that looks down on the centre at 40 degrees, field of view 40."""
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
    rays = np.empty((height * width, 6), np.float32)
    rays[:, :3], rays[:, 3:] = origin, direction.reshape(-1, 3)
    return rays


def _front_hits(scene, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(triangle or -1, barycentric uv, normal) of the first surface that each ray meets from the front."""
    import open3d

    rays = rays.copy()
    hit, uv, normal = np.full(len(rays), -1), np.zeros((len(rays), 2), np.float32), np.zeros((len(rays), 3), np.float32)
    open_rays = np.arange(len(rays))
    for _ in range(_PASSES):
        if not len(open_rays):
            break
        answer = scene.cast_rays(open3d.core.Tensor(rays[open_rays]))
        distance = answer["t_hit"].numpy()
        n = answer["primitive_normals"].numpy()
        met = np.isfinite(distance)
        front = met & ((n * rays[open_rays, 3:]).sum(axis=1) < 0)
        found = open_rays[front]
        hit[found] = answer["primitive_ids"].numpy()[front]
        uv[found], normal[found] = answer["primitive_uvs"].numpy()[front], n[front]
        behind = met & ~front
        open_rays = open_rays[behind]
        rays[open_rays, :3] += rays[open_rays, 3:] * (distance[behind, None] + 1e-4)
    return hit, uv, normal
