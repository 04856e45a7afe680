"""Pyramids, and images that no pyramid helps."""

import numpy as np
import pytest
from iclnuim.geometry.camera import PinholeCamera

pytest.importorskip("numba", reason="the extra `odometry` is not installed")
from iclnuim.benchmark.odometry.levels import Pair, pyramid  # noqa: E402
from iclnuim.benchmark.odometry.protocol import Frame  # noqa: E402


def frame(camera, contrast=10.0):
    """A chessboard of pixels with a standard deviation of `contrast` grey levels."""
    board = np.indices((camera.height, camera.width)).sum(axis=0) // 8 % 2
    return Frame.of(100 + contrast * (2 * board - 1), np.full(board.shape, 2.0), 0.0)


@pytest.mark.parametrize("size", ["640x480", "320x240", "100x75", "64x60"])
def test_the_coarsest_level_of_a_deep_pyramid_still_has_rows_for_a_gradient(size):
    """Sixteen to thirty-one of them, whatever the size of the image."""
    camera = PinholeCamera.parse(size)
    levels = pyramid(frame(camera), camera, 9)
    assert 16 <= min(levels[-1].grey.shape) < 32
    assert all(level.grey.shape == (level.camera.height, level.camera.width) for level in levels)


@pytest.mark.parametrize(("contrast", "too_little"), [(0.7, True), (1.4, False)])
def test_an_image_of_a_grey_level_is_black_white_or_covered(contrast, too_little):
    camera = PinholeCamera.parse("64x48")
    one, other = (pyramid(frame(camera, c), camera, 1) for c in (10.0, contrast))
    assert Pair(one, other).no_contrast() is too_little
    assert Pair(other, one).no_contrast() is too_little
