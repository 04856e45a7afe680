"""Pictures for the panel: sizes, colours by value, and letters that stay inside."""

import numpy as np
from iclnuim import shown
from iclnuim.ui import pictures


def test_the_ramp_goes_from_blue_to_red_and_clips():
    low, high = shown.ramp(np.array([-1.0, 2.0]))
    assert low[2] > low[0] and high[0] > high[2]
    assert np.array_equal(shown.ramp(np.array([0.0, 1.0])), [low, high])


def test_pixels_without_depth_are_black_and_others_are_not():
    z = np.array([[0.0, 1.0], [2.0, 3.0]])
    colours = shown.depth_colours(z, 1.0, 3.0)
    assert colours[0, 0].max() == 0
    assert (colours[z > 0].max(-1) > 0).all()


def test_a_frame_picture_holds_both_images_clean_above_noisy_each_below_its_title():
    for width, title in ((64, 11), (320, 22), (640, 44)):
        rgb, z = np.full((4, width, 3), 100, np.uint8), np.ones((4, width))
        picture = pictures.frame_picture(rgb, z, rgb + 50, np.zeros((4, width)))
        clean, above, noisy, below = np.split(picture, [title, title + 4, 2 * title + 4])
        assert (above[:, :width] == 100).all()
        assert (below[:, :width] == 150).all() and (below[:, width:] == 0).all()
        assert clean.min() < 100 and not np.array_equal(clean, noisy)


def test_a_title_of_a_depth_image_is_no_wider_than_the_image():
    rgb, z = np.full((4, 160, 3), 100, np.uint8), np.full((4, 160), 12.34)
    title = pictures.frame_picture(rgb, z, rgb, z)[:11]
    assert title[:, -4:].min() == 255


def test_a_picture_of_a_frame_without_any_depth_is_made():
    nothing = np.zeros((4, 6))
    black = np.zeros((4, 6, 3), np.uint8)
    assert pictures.frame_picture(black, nothing, black, nothing)[-4:].max() == 0


def test_the_plot_draws_larger_errors_higher():
    stamps = np.linspace(0, 10, 300)
    plot = pictures.error_plot(stamps, np.where(stamps < 5, 0.001, 0.05), 0.035)
    coloured = plot.max(-1).astype(int) - plot.min(-1) > 60
    rows = [
        np.flatnonzero(coloured[:, x]).mean() for x in (plot.shape[1] // 4, plot.shape[1] * 3 // 4)
    ]
    assert rows[1] < rows[0] - 100


def test_the_plot_of_a_single_or_perfect_estimate_is_made():
    assert pictures.error_plot(np.zeros(1), np.zeros(1), 0.0).shape[2] == 3


def test_words_beyond_the_edge_are_cut_off():
    image = np.full((10, 10, 3), 255, np.uint8)
    pictures.write(image, "0123", 4, 6)
    assert image.min() < 255
