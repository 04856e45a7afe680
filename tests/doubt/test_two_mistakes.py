"""Two mistakes at once are found and named, and what is found can be applied; signs of an estimate
without rotations, and of one that lost track, are said.
"""

import json
from contextlib import suppress
from itertools import combinations, pairwise

import numpy as np
import pytest
from corrupted_estimates import corrupted, room_walk
from iclnuim.doubt.against_truth import explain
from iclnuim.doubt.hypothesis import Reorder
from iclnuim.doubt.lost_track import signs_of_lost_track
from iclnuim.doubt.no_rotations import lacks_rotations
from iclnuim.errors import InputError
from iclnuim.evaluation.absolute_error import absolute_error
from iclnuim.evaluation.relative_error import RelativeErrorSettings, relative_error
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.headless import cli
from iclnuim.trajectory_files.trajectories import write_trajectory

MISTAKES = {
    "offset": {"offset"},
    "scale": {"scale"},
    "opengl": {"rotation"},
    "mirror": {"mirror"},
    "extrinsic": {"body", "rotation", "arm"},
    "inverse": {"inverse"},
    "wxyz": {"wxyz"},
}
PAIRS = [pair for pair in combinations(MISTAKES, 2) if pair != ("opengl", "extrinsic")]
SCALAR_FIRST = Reorder(
    "wxyz", lambda T: SE3.from_quat_xyzw(np.roll(T.quat_xyzw, -1, axis=-1), T.translation)
)
OVER_10 = RelativeErrorSettings(10.0)


def errors_m(truth, estimate):
    found = absolute_error(truth, estimate), relative_error(truth, estimate, OVER_10)
    return np.array([one.translation_m.rmse for one in found])


def noisy(rng, truth):
    shake = SE3.exp(rng.normal(size=(len(truth), 6)) * 2e-3)
    return Trajectory(
        truth.stamps_s, truth.T_world_camera[0].inverse() @ truth.T_world_camera @ shake
    )


def outcome(pair, seed):
    """corrected, needless, missed or wrong."""
    rng = np.random.default_rng(seed)
    truth = room_walk(rng)
    estimate = noisy(rng, truth)
    given = truth, estimate
    for kind in sorted(pair, key=lambda kind: kind == "wxyz"):
        given = corrupted(kind, rng, *given)
    right_m = errors_m(truth, estimate)
    with suppress(InputError):
        if (errors_m(*given) <= 1.5 * right_m).all():
            return "needless"
    found = explain(*given, reorders={"estimate": SCALAR_FIRST})
    if found is None:
        return "missed"
    if (errors_m(found.reference, found.estimate) <= 1.5 * right_m).all():
        return "corrected"
    kinds = MISTAKES[pair[0]] | MISTAKES[pair[1]]
    return "missed" if set(found.kinds) <= kinds else "wrong"


def counts(pairs, seeds):
    found = [outcome(pair, seed) for pair in pairs for seed in seeds]
    return {what: found.count(what) for what in ("corrected", "needless", "missed", "wrong")}


def test_two_mistakes_are_corrected():
    """Each with one that stands beside it; all pairs are slow."""
    beside = [pair for pair in pairwise(MISTAKES) if pair in PAIRS]
    table = counts(beside, [1])
    assert table["corrected"] >= 0.9 * (len(beside) - table["needless"]) and table["wrong"] == 0


@pytest.mark.parametrize("kind", ["scale", "mirror", "inverse"])
def test_frame_numbers_as_stamps_are_found_whatever_else_is_wrong(kind, walk):
    rng = np.random.default_rng(5)
    estimate = noisy(rng, walk)
    right_m = errors_m(walk, estimate)
    truth, spoilt = corrupted(kind, rng, walk, estimate)
    numbered = Trajectory(np.arange(len(spoilt), dtype=float), spoilt.T_world_camera)
    truth = Trajectory(truth.stamps_s + 1000.0, truth.T_world_camera)
    found = explain(truth, numbered)
    assert set(found.kinds) == {"rate", kind}
    assert (errors_m(found.reference, found.estimate) <= 1.5 * right_m).all()


@pytest.mark.slow
def test_two_hundred_pairs_of_mistakes():
    table = counts(PAIRS, range(10, 20))
    assert table["corrected"] >= 0.9 * (10 * len(PAIRS) - table["needless"])
    assert table["wrong"] <= 2


def test_what_was_found_can_be_applied(tmp_path, walk, capsys):
    rng = np.random.default_rng(1)
    spoilt = corrupted("opengl", rng, walk, noisy(rng, walk))[1]
    spoilt = Trajectory(spoilt.stamps_s + 2.0, spoilt.T_world_camera)
    files = [str(tmp_path / name) for name in ("truth.txt", "spoilt.txt", "mended.txt")]
    write_trajectory(files[0], walk, "tum")
    write_trajectory(files[1], spoilt, "tum")
    assert cli.main(["evaluate", "ate", files[0], files[1]]) == 0
    assert (
        f"convert {files[1]} OUT.txt --explained {files[0]} applies all" in capsys.readouterr().err
    )
    assert cli.main(["trajectory", "convert", files[1], files[2], "--explained", files[0]]) == 0
    capsys.readouterr()
    assert cli.main(["evaluate", "ate", files[0], files[2], "--json"]) == 0
    values = json.loads(capsys.readouterr().out)
    assert values["translation_error_m"]["rmse"] < 0.006 and values["warnings"] == []


def test_a_file_without_rotations_is_compared_by_its_positions(evaluate, walk, capsys):
    rng = np.random.default_rng(2)
    positions_m = noisy(rng, walk).positions_m
    alone = Trajectory(walk.stamps_s, SE3(SE3.identity((len(walk),)).rotation, positions_m))
    values = evaluate(alone, "rpe", "--delta", "10")
    (warning,) = values["warnings"]
    assert "all rotations are the same" in warning and values["rotation_error_deg"] is None
    assert values["translation_error_m"]["rmse"] < 0.006


@pytest.mark.parametrize(("angle_deg", "lacks"), [(4.0, False), (6.0, True)])
def test_a_camera_that_slides_has_rotations(angle_deg, lacks):
    twist = np.zeros((20, 6))
    slides = Trajectory.at_rate(SE3.exp(twist + np.arange(20)[:, None] * [0.1, 0, 0, 0, 0, 0]))
    twist[:, 5] = np.radians(angle_deg) * np.linspace(0, 1, 20)
    assert lacks_rotations(slides, Trajectory.at_rate(SE3.exp(twist))) == lacks


def test_signs_of_lost_track_are_counted(walk):
    true = walk.T_world_camera
    estimate = noisy(np.random.default_rng(3), walk).T_world_camera
    late = np.arange(len(walk)) >= 180
    assert signs_of_lost_track(true, estimate) == []
    far = estimate.translation.copy()
    far[200] += 1000.0
    (said,) = signs_of_lost_track(true, SE3(estimate.rotation, far))
    assert said.startswith("1 pose is up to 1.73e+03 m off, the first is number 201")
    world = SE3.exp(np.array([1.0, 2.0, 3.0, 0.4, 1.0, 0.2]))
    (said,) = signs_of_lost_track(true, chosen(late, world @ estimate, estimate))
    assert "after 180 compared poses" in said and "another world" in said
    half = SE3(estimate.rotation, 0.5 * estimate.translation)
    (said,) = signs_of_lost_track(true, chosen(late, world @ half, estimate))
    assert "after 180 compared poses" in said and "with a scale of its own" in said
    (said,) = signs_of_lost_track(true, estimate[np.minimum(np.arange(len(walk)), 200)])
    assert said.startswith("199 of the estimate's 400 compared poses repeat")
    none = chosen(np.arange(len(walk)) % 3 == 0, SE3.identity((len(walk),)), estimate)
    assert "134 of the estimate's 400" in signs_of_lost_track(true, none)[0]


def chosen(where, one, other):
    rotation = np.where(where[:, None, None], one.rotation, other.rotation)
    return SE3(rotation, np.where(where[:, None], one.translation, other.translation))
