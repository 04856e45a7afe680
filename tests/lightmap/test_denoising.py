"""Noise goes, light stays: edges of shadows, borders of charts, and the energy of rare bright
paths.
"""

import numpy as np
from iclnuim.lightmap.denoise import denoise, fill, grown, luminance, next_to_known

SIZE = 96


def halves(truth, sigma, seed=3):
    rng = np.random.default_rng(seed)
    return [truth + rng.normal(0, sigma, truth.shape) for _ in range(2)]


def flat_room(charts=1):
    chart = np.repeat(np.arange(charts), SIZE // charts)[None, :].repeat(SIZE, 0)
    normals = np.zeros((SIZE, SIZE, 3))
    normals[..., 2] = 1
    return chart, normals, np.ones((SIZE, SIZE), bool)


def test_noise_on_even_light_falls_by_a_factor_of_five():
    chart, normals, usable = flat_room()
    truth = np.full((SIZE, SIZE, 3), 0.8)
    a, b = halves(truth, 0.1)
    out = denoise(a, b, chart, normals, usable)
    assert luminance(out - truth).std() < luminance((a + b) / 2 - truth).std() / 5
    assert abs(out.mean() / 0.8 - 1) < 0.005


def test_the_edge_of_a_shadow_stays_where_it_is():
    chart, normals, usable = flat_room()
    truth = np.full((SIZE, SIZE, 3), 0.2)
    truth[:, 48:] = 1.0
    out = denoise(*halves(truth, 0.03), chart, normals, usable)
    assert np.abs(luminance(out - truth))[:, 44:52].mean() < 0.02


def test_light_does_not_cross_from_chart_to_chart():
    chart, normals, usable = flat_room(2)
    truth = np.where(chart[..., None] == 0, 0.5, 0.52).repeat(3, -1)
    out = denoise(*halves(truth, 0.3), chart, normals, usable)
    alone = denoise(
        *[np.where(chart[..., None] == 0, h, 0) for h in halves(truth, 0.3)],
        chart,
        normals,
        usable & (chart == 0),
    )
    assert np.allclose(out[:, :48], alone[:, :48], atol=1e-6)


def test_rare_bright_paths_leave_no_specks_and_no_light_is_lost():
    chart, normals, usable = flat_room()
    rng = np.random.default_rng(8)
    a, b = halves(np.full((SIZE, SIZE, 3), 0.3), 0.01)
    for half in (a, b):
        half[rng.random((SIZE, SIZE)) < 0.004] += 20.0
    out = denoise(a, b, chart, normals, usable)
    mean = (a + b).mean() / 2
    assert abs(out.mean() / mean - 1) < 0.02
    assert luminance(out).max() < 3 * mean


def test_a_speck_in_both_halves_becomes_like_its_neighbours_also_at_the_corner_of_a_chart():
    chart, normals, usable = flat_room(2)
    truth = np.where(chart[..., None] == 0, 0.3, 0.6).repeat(3, -1)
    a, b = halves(truth, 0.005)
    for half in (a, b):
        half[40, 20] = half[0, 47] = half[95, 95] = 3.0
        half[70, 70] = 0.0
    out = denoise(a, b, chart, normals, usable)
    assert np.abs(luminance(out) / luminance(truth) - 1).max() < 0.03


def test_a_beam_one_texel_wide_stays():
    chart, normals, usable = flat_room()
    truth = np.full((SIZE, SIZE, 3), 0.3)
    truth[:, 50] = 2.0
    out = denoise(*halves(truth, 0.005), chart, normals, usable)
    assert np.abs(luminance(out)[:, 50] / 2.0 - 1).max() < 0.03


def test_a_mask_grows_by_steps_within_its_chart():
    chart, *_ = flat_room(2)
    chart[:10] = -1
    mask = np.zeros((SIZE, SIZE), bool)
    mask[12, 46] = mask[80, 10] = True
    row, column = np.mgrid[:SIZE, :SIZE]
    near = [np.maximum(abs(row - y), abs(column - x)) <= 3 for y, x in ((12, 46), (80, 10))]
    assert (grown(mask, chart, 3) == ((near[0] | near[1]) & (chart == 0))).all()
    assert (grown(mask, chart, 0) == mask).all()


def test_filling_takes_light_of_the_same_chart_only():
    chart, _, known = flat_room(2)
    light = np.where(chart[..., None] == 0, 1.0, 5.0).repeat(3, -1)
    known[:, 40:56] = False
    filled, reached = fill(light * known[..., None], known, chart, 8)
    assert reached.all()
    assert np.allclose(filled[:, :48], 1.0) and np.allclose(filled[:, 48:], 5.0)


def test_hidden_texels_find_the_nearest_seen_one_of_their_chart():
    chart, _, known = flat_room(2)
    known[:, 46:50] = False
    hidden, near = next_to_known(known, chart)
    assert set(hidden % SIZE) == {46, 49}
    assert set(near % SIZE) == {45, 50}
