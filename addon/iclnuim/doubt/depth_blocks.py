"""Depth images reduced to blocks of pixels, to measure how well two of them agree after a motion.

In the image of a plane the inverse depth is linear in the pixel coordinates, so the mean of a block
and bilinear interpolation between blocks are exact there, and the noise of single pixels averages
out.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..geometry.camera import PinholeCamera
from ..geometry.se3 import SE3

#: Number of blocks along a row.
_COLUMNS = 80
_MIN_PX = 1
_MAX_PX = 8
#: A block with fewer pixels that have depth is left out.
_MIN_SHARE = 0.6
#: Blocks with a larger relative spread contain several surfaces, and so do four neighbours of this
#: relative range.
_ONE_SURFACE = 0.03
_ONE_NEIGHBOURHOOD = 0.1
#: Approximate number of points along a row.
_POINTS_IN_ROW = 40
#: Number of blocks of `_MAX_PX` pixels a side in which noise is measured.
_NOISE_BLOCKS = 300


@dataclass(frozen=True, eq=False)
class DepthBlocks:
    """inverse_per_m (rows, columns): mean inverse depth of blocks of `size_px` pixels a side, NaN
    without a single surface. points_m (n, 3): points of some blocks in the frame of the camera.
    noise: median of the relative residual of a block's pixels from a plane; NaN if unknown.
    """

    camera: PinholeCamera
    size_px: int
    inverse_per_m: np.ndarray
    points_m: np.ndarray
    noise: float

    @classmethod
    def of(cls, depth_z_m: np.ndarray, camera: PinholeCamera) -> "DepthBlocks":
        """depth_z_m (h, w): planar depth in metres, 0 or not finite = missing."""
        size_px = int(np.clip(round(camera.width / _COLUMNS), _MIN_PX, _MAX_PX))
        valid = np.isfinite(depth_z_m) & (depth_z_m > 0)
        inverse = np.zeros(depth_z_m.shape, np.float32)
        np.divide(1, depth_z_m, out=inverse, where=valid)
        pixels = _in_blocks(inverse, size_px)
        valid = _in_blocks(valid, size_px)
        count = np.maximum(valid.sum(-1), _MIN_SHARE * size_px**2)
        mean = pixels.sum(-1) / count
        spread = np.sqrt(np.maximum(np.square(pixels).sum(-1) / count - mean**2, 0))
        enough = valid.sum(-1) >= _MIN_SHARE * size_px**2
        one_surface = enough & (spread <= _ONE_SURFACE * mean)
        points_m = _points_m(mean, valid, one_surface, camera)
        inverse_per_m = np.where(one_surface, mean, np.nan)
        return cls(camera, size_px, inverse_per_m, points_m, _noise(_in_blocks(inverse, _MAX_PX)))

    def thinned(self, step: int) -> "DepthBlocks":
        """The same with every `step`-th point."""
        return replace(self, points_m=self.points_m[::step])

    def seen_by(self, camera: PinholeCamera) -> "DepthBlocks":
        """The same if another camera, of the same size, took the image."""
        own = self.camera
        x, y, z = self.points_m.T
        u = own.fx * x / z + own.cx
        v = own.fy * y / z + own.cy
        moved = np.stack([(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z], -1)
        return replace(self, camera=camera, points_m=moved)

    def along_rays(self) -> "DepthBlocks":
        """The same if the depth was the distance along the ray of a pixel."""
        rows, columns = self.inverse_per_m.shape
        x = ((np.arange(columns) + 0.5) * self.size_px - 0.5 - self.camera.cx) / self.camera.fx
        y = ((np.arange(rows) + 0.5) * self.size_px - 0.5 - self.camera.cy) / self.camera.fy
        lengths = np.sqrt(1 + x**2 + y[:, None] ** 2)
        of_points = np.linalg.norm(self.points_m, axis=-1, keepdims=True) / self.points_m[:, 2:]
        inverse_per_m = self.inverse_per_m * lengths
        return replace(self, inverse_per_m=inverse_per_m, points_m=self.points_m / of_points)

    def residuals(self, T_here_there: SE3, points_there_m: np.ndarray) -> np.ndarray:
        """(n,) relative differences in depth between points (n, 3), which another camera measured,
        and this image: |z - z'| divided by their mean, at most 2.

        NaN where this image has no single surface, infinite for points outside of the image.
        """
        points = T_here_there.apply(points_there_m)
        size = self.size_px
        with np.errstate(over="ignore"):
            blocks = (self.camera.project(points) - (size - 1) / 2) / size
        rows, columns = self.inverse_per_m.shape
        inside = ((blocks >= 0) & (blocks < [columns - 1, rows - 1])).all(-1)  # NaN is not
        measured = _interpolated(self.inverse_per_m, blocks[inside])
        expected = 1 / points[inside, 2]
        found = np.full(len(points), np.inf)
        found[inside] = 2 * np.abs(measured - expected) / (measured + expected)
        return found


def _in_blocks(image: np.ndarray, size: int) -> np.ndarray:
    """(rows, columns, size * size): the pixels of each block of the image (h, w)."""
    rows = image.shape[0] // size
    columns = image.shape[1] // size
    whole = image[: rows * size, : columns * size].reshape(rows, size, columns, size)
    return whole.swapaxes(1, 2).reshape(rows, columns, size * size)


def _pixel_grid(size: int) -> tuple[np.ndarray, np.ndarray]:
    """u and v (size * size,) of a block's pixels, from its first."""
    v, u = np.indices((size, size)).reshape(2, -1).astype(np.float32)
    return u, v


def _points_m(
    inverse: np.ndarray, valid: np.ndarray, chosen: np.ndarray, camera: PinholeCamera
) -> np.ndarray:
    """(n, 3): some of the chosen blocks, at the centre of their valid pixels."""
    size = round(valid.shape[-1] ** 0.5)
    step = max(1, round(chosen.shape[1] / _POINTS_IN_ROW))
    sparse = np.zeros_like(chosen)
    sparse[::step, ::step] = chosen[::step, ::step]
    row, column = np.nonzero(sparse)
    weights = valid[sparse] / valid[sparse].sum(-1, keepdims=True)
    u, v = _pixel_grid(size)
    z_m = 1 / inverse[sparse]
    x_m = (column * size + weights @ u - camera.cx) / camera.fx * z_m
    y_m = (row * size + weights @ v - camera.cy) / camera.fy * z_m
    return np.stack([x_m, y_m, z_m], axis=-1)


def _noise(blocks: np.ndarray) -> float:
    """Median relative residual of inverse depths (rows, columns, size * size), 0 = missing, from
    the planes of some blocks without missing pixels.
    """
    pixels = blocks[blocks.min(-1) > 0]
    pixels = pixels[:: 1 + len(pixels) // _NOISE_BLOCKS]
    pixels = pixels[pixels.std(-1) <= _ONE_SURFACE * pixels.mean(-1)]
    if not len(pixels):
        return float("nan")
    u, v = _pixel_grid(round(pixels.shape[-1] ** 0.5))
    terms = np.stack([np.ones_like(u), u, v])
    plane = (np.linalg.pinv(terms) @ terms).astype(np.float32)
    return float(np.median(np.abs(pixels - pixels @ plane) / pixels))


def _interpolated(image: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(n,) bilinear interpolation at columns and rows (n, 2); NaN between different surfaces."""
    column, row = at.astype(int).T
    share_x, share_y = (at % 1).T
    corners = np.stack(
        [
            image[row, column],
            image[row, column + 1],
            image[row + 1, column],
            image[row + 1, column + 1],
        ]
    )
    upper = corners[0] + share_x * (corners[1] - corners[0])
    lower = corners[2] + share_x * (corners[3] - corners[2])
    middle = upper + share_y * (lower - upper)
    return np.where(np.ptp(corners, axis=0) <= _ONE_NEIGHBOURHOOD * middle, middle, np.nan)
