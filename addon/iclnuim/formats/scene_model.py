"""A scene as a surface: triangles with shading normals, texture coordinates, materials and instances; cut and chosen as arrays."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False)
class Look:
    """A material to look at: its name, its colour (3,) in sRGB 0..1, and its texture (h, w, 3) uint8, row 0 at the top, where it has one."""

    name: str
    colour: tuple[float, float, float]
    texture: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class SceneModel:
    """m triangles. corners_m (m, 3, 3) in metres, our world, counter-clockwise from the front; normals (m, 3, 3) unit shading normals of the
    corners; uv (m, 3, 2), v upwards; material (m,) index into looks; instance (m,) the numbers of label images; names: of these.
    """

    corners_m: np.ndarray
    normals: np.ndarray
    uv: np.ndarray
    material: np.ndarray
    instance: np.ndarray
    looks: tuple[Look, ...] = ()
    names: dict[int, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.corners_m)

    def area_m2(self) -> np.ndarray:
        """(m,) square metres."""
        a, b, c = np.moveaxis(self.corners_m, 1, 0)
        return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2

    def chosen(self, rows: np.ndarray) -> "SceneModel":
        """Some of the triangles, by a mask (m,) or by indices."""
        arrays = {name: getattr(self, name)[rows] for name in _ARRAYS}
        return replace(self, **arrays)

    def cut(self, longest_m: float) -> "tuple[SceneModel, np.ndarray]":
        """The same surface in k triangles without an edge longer than `longest_m`, and which triangle (k,) each was part of.

        The longest edge is halved, as often as it takes.
        """
        done, rest, origin, origins = [], self, np.arange(len(self)), []
        while len(rest):
            edges = np.linalg.norm(rest.corners_m - np.roll(rest.corners_m, -1, axis=1), axis=2)
            longest = edges.argmax(1)
            small = edges.max(1) <= longest_m
            done.append(rest.chosen(small))
            origins.append(origin[small])
            origin = np.repeat(origin[~small], 2)
            rest = rest.chosen(~small)._bisected(longest[~small])
        joined = {
            name: np.concatenate([getattr(part, name) for part in done] or [getattr(self, name)]) for name in _ARRAYS
        }
        return replace(self, **joined), np.concatenate(origins or [origin])

    def _bisected(self, edge: np.ndarray) -> "SceneModel":
        """Two triangles for each, split in the middle of the edge that starts at corner edge (m,)."""
        order = (edge[:, None] + np.arange(3)) % 3
        halves: dict[str, Any] = {}
        for name in _OF_CORNERS:
            a, b, c = np.moveaxis(np.take_along_axis(getattr(self, name), order[..., None], 1), 1, 0)
            middle = (a + b) / 2
            if name == "normals":
                middle = middle / np.maximum(np.linalg.norm(middle, axis=1, keepdims=True), 1e-12)
            pair = np.stack([np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)], 1)
            halves[name] = pair.reshape(-1, *pair.shape[2:])
        whole: dict[str, Any] = {name: np.repeat(getattr(self, name), 2) for name in ("material", "instance")}
        return replace(self, **halves, **whole)


_OF_CORNERS = ("corners_m", "normals", "uv")
_ARRAYS = (*_OF_CORNERS, "material", "instance")
