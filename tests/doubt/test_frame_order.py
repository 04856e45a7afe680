"""Images of other frames than their names say are found by how well they fit, and only then."""

import numpy as np
import pytest
from iclnuim.doubt.frame_order import other_order
from iclnuim.sequences.frames import ImagePair

FRAMES = 60


def order(true, named, noise=0.3, seed=0):
    """The order of images that are of frames `true` and named as frames `named`; the error is the
    distance of eight values of the frames, which change slowly.
    """
    rng = np.random.default_rng(seed)
    values = np.cumsum(rng.normal(size=(FRAMES, 8)), axis=0)
    seen = values[true] + noise * rng.normal(size=(len(true), 8))
    return other_order(lambda k, j: float(np.linalg.norm(seen[k] - values[j])), named, FRAMES)


@pytest.mark.parametrize("shift", [-9, -1, 1, 10])
def test_a_shift_is_found(shift):
    true = np.arange(12, 48)
    found = order(true, [int(frame) - shift for frame in true], noise=0.05)
    assert [found.frame(k) for k in range(36)] == true.tolist()


@pytest.mark.parametrize("step", [2, 3, 5, 10])
def test_every_kth_renumbered_is_found(step):
    true = np.arange(0, FRAMES, step)
    found = order(true, list(range(len(true))), noise=0.05)
    assert (found.first, found.step) == (0, step)


@pytest.mark.parametrize("count", [FRAMES, 30])
def test_the_reversed_order_is_found(count):
    """Of all frames, or of the first ones alone."""
    true = np.arange(count)[::-1]
    found = order(true, list(range(count)), noise=0.05)
    assert [found.frame(k) for k in range(count)] == true.tolist()


@pytest.mark.parametrize("seed", range(20))
def test_right_images_and_those_of_no_frame_have_no_other_order(seed):
    true = np.arange(FRAMES)
    assert order(true, true.tolist(), seed=seed) is None
    anywhere = np.random.default_rng(seed).permutation(FRAMES)
    assert order(anywhere, true.tolist(), noise=0.05, seed=seed) is None


@pytest.mark.parametrize(
    ("written", "depth_s"),
    [
        (("10.500000", "10.485000"), 10.485),
        (("10.500000", "10.500000"), 10.5),
        (("", ""), 10.5),
        (("10500000000", "10485000000"), 10.5),
    ],
)
def test_depth_has_the_stamp_of_its_own_list(tmp_path, written, depth_s):
    pair = ImagePair(0, 10.5, tmp_path, tmp_path, written)
    assert pair.depth_stamp_s == pytest.approx(depth_s)
