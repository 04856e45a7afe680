"""A depth image reduced to blocks of pixels, to measure how well it agrees with others.

In the image of a plane the inverse depth is linear in the pixel coordinates, so the mean of a block
and bilinear interpolation between blocks are exact there, and the noise of single pixels averages
out.
"""

from dataclasses import dataclass

import numpy as np

from ..geometry.camera import PinholeCamera

#: Number of blocks along a row.
_COLUMNS = 80
_MIN_PX = 1
_MAX_PX = 8
#: A block with fewer pixels that have depth is left out.
_MIN_SHARE = 0.6
#: Blocks with a larger relative spread contain several surfaces.
_ONE_SURFACE = 0.03
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
