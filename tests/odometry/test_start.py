"""Where an alignment starts after a sudden motion."""

from dataclasses import replace

import numpy as np
import pytest
from iclnuim.geometry.se3 import SE3

pytest.importorskip("numba", reason="the extra `odometry` is not installed")
from iclnuim.benchmark.odometry import start  # noqa: E402
from iclnuim.benchmark.odometry.candidates import Estimate  # noqa: E402
from iclnuim.benchmark.odometry.levels import Pair  # noqa: E402
from iclnuim.benchmark.odometry.protocol import Frame, OdometryResult, OdometryStatus, failure  # noqa: E402
from iclnuim.benchmark.odometry.registry import odometer  # noqa: E402
from iclnuim.benchmark.odometry.start import Start, initialise  # noqa: E402
from odometry_scenes import BIG, ROOM, WALL, after, error_m, run, view  # noqa: E402


@pytest.mark.parametrize("name", ["rgbd", "dvo"])
def test_a_guess_that_is_ten_degrees_off_is_found_to_be_wrong_by_small_images(name):
    method = odometer(name)
    reference, current = (method.prepare(view(i, ROOM, camera=BIG), BIG) for i in (0, 2))
    for axis in np.eye(3):
        found = method.align(reference, current, SE3.exp(np.r_[0, 0, 0, np.radians(10) * axis]))
        assert np.abs((after(2).inverse() @ found.T_reference_camera).log()).max() < 1e-3


@pytest.mark.parametrize("off_deg", [10, 20])
@pytest.mark.parametrize("name", ["rgbd", "dvo"])
def test_a_guess_that_is_far_off_is_corrected_from_a_far_keyframe(name, off_deg):
    """The parallax between the two views is as large as the error of the guess."""
    method = odometer(name)
    reference, current = (method.prepare(view(i, ROOM, camera=BIG), BIG) for i in (0, 20))
    for axis in (*np.eye(3), *-np.eye(3)):
        found = method.align(
            reference, current, after(20) @ SE3.exp(np.r_[0, 0, 0, np.radians(off_deg) * axis])
        )
        assert np.abs((after(20).inverse() @ found.T_reference_camera).log()).max() < 2e-3


@pytest.mark.parametrize(
    ("turned", "predicted", "taken"),
    [
        (0.2, 0.95, "predicted"),
        (0.7, 0.95, "turned"),
        (None, 0.95, "turned"),
        (0.9, None, "turned"),
    ],
)
def test_the_prediction_is_aligned_too_where_another_guess_replaces_it(turned, predicted, taken):
    """Correlations at the two results; None: the alignment fails."""
    poses, fits = (
        {"turned": after(1), "predicted": after(2)},
        {"turned": turned, "predicted": predicted},
    )

    class Images:
        def fit(self, T):
            return next(fits[name] for name, pose in poses.items() if pose is T), 0.4

    def align(guess):
        name = next(name for name, pose in poses.items() if pose is guess)
        return Estimate(OdometryResult(guess) if fits[name] else failure("image: unrelated"))

    found = Start(list(poses.values()), [], Images(), poor=True).aligned(align).result
    assert found.status is (OdometryStatus.OK if fits[taken] else OdometryStatus.FAILED)
    assert not fits[taken] or found.T_reference_camera is poses[taken]


@pytest.mark.parametrize("jump, noise", [(10, 0.0), (14, 0.001)])
@pytest.mark.parametrize("name", ["icp_rgbd", "rgbd", "dvo"])
def test_a_sudden_motion_along_a_wall_is_found_by_its_image(name, jump, noise):
    """The planes do not constrain it, and the prediction is 9 and 12 cm off."""
    numbers = (0, 1, 2, 2 + jump, 3 + jump)
    found = run(name, [view(i, WALL, noise, BIG) for i in numbers], BIG)
    assert error_m(found, numbers[-1]) < 5e-4
    assert found[3].result.status is OdometryStatus.OK and found[3].result.converged


@pytest.mark.parametrize("name", ["icp_rgbd", "rgbd", "dvo"])
def test_images_that_still_do_not_fit_after_a_poor_prediction_are_reported(name):
    """Half of the view shows another texture, so that no motion aligns it."""
    method = odometer(name)
    frames = [view(i, ROOM, camera=BIG) for i in (0, 30)]
    frames[1].grey[:, 160:] = frames[1].grey[::-1, 160:]
    reference, current = (method.prepare(f, BIG) for f in frames)
    result = method.align(reference, current, after(27))
    assert result.status is OdometryStatus.DEGENERATE and result.reason.startswith(
        "prediction: poor, correlation 0.5"
    )


@pytest.mark.parametrize("name", ["icp_rgbd", "dvo"])
def test_the_authors_settings_report_a_motion_if_half_of_the_image_has_changed(name):
    method = odometer(name, "paper")
    frames = [view(i, ROOM, camera=BIG) for i in (0, 1, 1)]
    frames[2].grey[:, 160:] = frames[2].grey[::-1, 160:]
    reference, same, changed = (method.prepare(f, BIG) for f in frames)
    assert method.align(reference, same, after(1)).status is OdometryStatus.OK
    result = method.align(reference, changed, after(1))
    assert result.status is not OdometryStatus.OK and result.reason.startswith(
        ("image: does not fit", "overlap", "step")
    )


@pytest.mark.parametrize(("other", "poor"), [(0.3, False), (0.8, True)])
def test_images_fit_where_nine_tenths_of_their_contrast_agree(other, poor):
    """Another texture is added to the current image: the correlation is 0.96 and 0.80."""
    method, frame = odometer("rgbd"), view(0, ROOM, camera=BIG)
    texture = view(40, ROOM, camera=BIG).grey[:, ::-1]
    changed = replace(frame, grey=frame.grey + np.float32(other) * (texture - texture.mean()))
    pair = Pair(method.prepare(frame, BIG), method.prepare(changed, BIG))
    start = initialise(pair, method.settings, method.schedule(pair.reference), SE3.identity())
    assert start.poor is poor


@pytest.mark.parametrize(("period", "corrected"), [(0.6, True), (0.35, False)])
def test_a_fit_over_less_than_half_of_the_view_is_not_trusted(period, corrected):
    """Wallpaper that repeats itself, on a sphere about the camera: a guess that is a period off
    fits where both images overlap.
    """
    method, rays = odometer("rgbd"), BIG.rays()
    azimuth = np.arctan2(rays[..., 0], rays[..., 2])
    angle = period * np.ptp(azimuth[BIG.height // 2])
    wave = 2 * np.pi * azimuth / angle
    grey = 128 + 60 * np.sin(wave) + 30 * np.sin(2 * wave + 1) + 20 * np.sin(40 * rays[..., 1])
    frame = Frame.of(grey, 2 / np.linalg.norm(rays, axis=-1), 0.0)
    pair = Pair(method.prepare(frame, BIG), method.prepare(frame, BIG))
    guess = SE3.exp(np.array([0, 0, 0, 0, angle, 0]))
    start = initialise(pair, method.settings, method.schedule(pair.reference), guess)
    assert (start.guesses[0] is not guess) is corrected
    if corrected:
        assert np.abs(start.guesses[0].log()).max() < 0.01


def test_an_alignment_after_a_poor_prediction_may_take_a_few_times_as_long():
    """The slowest of these takes more than twice the iterations of a usual frame, and no more than
    three times as many.
    """
    method = odometer("rgbd")
    one, other = (method.prepare(view(i, ROOM, camera=BIG), BIG) for i in (0, 30))
    usual = sum(method.iterations) + method.iterations[method.finest]  # its last level runs twice
    off = SE3.exp(np.array([0, 0, 0, np.radians(16), 0, 0]))
    found = method.align(one, other, after(30) @ off)
    assert np.abs((after(30).inverse() @ found.T_reference_camera).log()).max() < 1e-3
    assert found.converged and 2 * usual < found.iterations <= 3 * usual


def test_a_roll_of_twenty_degrees_is_registered_in_a_few_rounds(monkeypatch):
    """To some degrees, from which the alignment goes on; each round costs as much as an alignment
    of coarse images.
    """
    rounds = []
    register = start._register
    monkeypatch.setattr(start, "_register", lambda *images: rounds.append(1) or register(*images))
    method = odometer("rgbd")
    pair = Pair(*(method.prepare(view(i, ROOM, camera=BIG), BIG) for i in (0, 20)))
    for sense in (1, -1):
        rounds.clear()
        guess = after(20) @ SE3.exp(np.array([0, 0, 0, 0, 0, sense * np.radians(20)]))
        found = initialise(pair, method.settings, method.schedule(pair.reference), guess)
        error = after(20).inverse() @ found.guesses[0]
        assert np.linalg.norm(error.log()[3:]) < np.radians(3)
        assert len(rounds) < 15
