"""ATE and RPE equal evo's, an independent judge, on a thousand random cases each; on a quarter of
them where nothing slow is asked for.
"""

import pytest
from iclnuim.errors import InputError
from iclnuim.evaluation.align import AlignmentSettings
from iclnuim.evaluation.relative_error import RelativeErrorSettings
from iclnuim.geometry.se3 import SE3
from iclnuim.trajectory_files.trajectories import read_trajectory
from judges import judge_module
from paired_poses import Pairs, absolute_error_of_pairs, relative_error_of_pairs

trajectory = judge_module("evo.core.trajectory", "evo")
from evo.core import metrics  # noqa: E402

#: Seeds of the random cases.
CASES = pytest.mark.parametrize(
    "cases", [range(250), pytest.param(range(250, 1000), marks=pytest.mark.slow)], ids=len
)
STATISTICS = ("rmse", "mean", "median", "std", "min", "max")
UNITS = {"frames": metrics.Unit.frames, "metres": metrics.Unit.meters}


def path(poses):
    return trajectory.PosePath3D(poses_se3=list(poses.matrix))


def assert_equal(ours, theirs):
    judge = theirs.get_all_statistics()
    for name in STATISTICS:
        assert getattr(ours, name) == pytest.approx(judge[name], rel=0, abs=1e-9), name


def evo_ape(pairs, method, first, relation):
    reference, estimate = path(pairs.reference), path(pairs.estimate)
    if method == "origin":
        estimate.align_origin(reference)
    elif method != "none":
        estimate.align(reference, correct_scale=method == "sim3", n=first or -1)
    metric = metrics.APE(relation)
    metric.process_data((reference, estimate))
    return metric


@CASES
def test_all_six_ate_statistics_equal_evo_on_a_thousand_cases(wander, cases):
    for seed in cases:
        pairs, method = wander(seed), ("none", "origin", "se3", "sim3")[seed % 4]
        first = (None, None, 8)[seed % 3] if method in ("se3", "sim3") else None
        ours = absolute_error_of_pairs(pairs, AlignmentSettings(method, first))
        assert_equal(
            ours.translation_m, evo_ape(pairs, method, first, metrics.PoseRelation.translation_part)
        )


@pytest.mark.parametrize("method", ["none", "origin", "se3", "sim3"])
def test_rotation_errors_equal_evo(wander, method):
    for seed in range(20):
        pairs = wander(seed)
        judge = evo_ape(pairs, method, None, metrics.PoseRelation.rotation_angle_deg)
        ours = absolute_error_of_pairs(pairs, AlignmentSettings(method))
        # evo's own angle comes from matrices and is exact to about 1e-7 degrees
        assert ours.rotation_deg.rmse == pytest.approx(judge.get_all_statistics()["rmse"], abs=1e-6)


@CASES
def test_rpe_over_frames_and_metres_equals_evo_on_a_thousand_cases(wander, cases):
    compared = {
        (unit, all_pairs, on): 0
        for unit in UNITS
        for all_pairs in (True, False)
        for on in (True, False)
    }
    for seed in cases:
        unit, all_pairs, on_reference = (
            ("frames", "metres")[seed % 2],
            seed // 2 % 2 == 0,
            seed // 4 % 2 == 0,
        )
        delta = 1 + seed % 5 if unit == "frames" else 0.3 + 0.1 * (seed % 5)
        pairs = wander(seed)
        judge = metrics.RPE(
            metrics.PoseRelation.translation_part,
            delta,
            UNITS[unit],
            0.1,
            all_pairs,
            pairs_from_reference=on_reference,
        )
        settings = RelativeErrorSettings(
            delta, unit, all_pairs, 0.1, "reference" if on_reference else "estimate"
        )
        try:
            judge.process_data((path(pairs.reference), path(pairs.estimate)))
        except metrics.filters.FilterException:
            with pytest.raises(InputError, match="apart"):
                relative_error_of_pairs(pairs, settings)
            continue
        ours = relative_error_of_pairs(pairs, settings)
        assert ours.end.tolist() == judge.delta_ids
        assert_equal(ours.translation_m, judge)
        compared[unit, all_pairs, on_reference] += 1
    assert min(compared.values()) > 0.8 * len(cases) / len(compared)


def test_rpe_rotation_equals_evo(wander):
    for seed in range(20):
        pairs = wander(seed)
        judge = metrics.RPE(
            metrics.PoseRelation.rotation_angle_deg, 2, metrics.Unit.frames, all_pairs=True
        )
        judge.process_data((path(pairs.reference), path(pairs.estimate)))
        ours = relative_error_of_pairs(pairs, RelativeErrorSettings(2))
        assert ours.rotation_deg.rmse == pytest.approx(judge.get_all_statistics()["rmse"], abs=1e-6)


def test_rpe_of_a_scaled_estimate_equals_evo_after_its_sim3_alignment(wander):
    for seed in range(20):
        pairs = wander(seed)
        reference, estimate = path(pairs.reference), path(pairs.estimate)
        estimate.scale(3.7)
        scaled = SE3(pairs.estimate.rotation, 3.7 * pairs.estimate.translation)
        estimate.align(reference, correct_scale=True)
        judge = metrics.RPE(
            metrics.PoseRelation.translation_part, 3, metrics.Unit.frames, all_pairs=True
        )
        judge.process_data((reference, estimate))
        moved = Pairs(pairs.reference, scaled, pairs.stamps_s)
        assert_equal(
            relative_error_of_pairs(
                moved, RelativeErrorSettings(3, correct_scale=True)
            ).translation_m,
            judge,
        )


def test_the_official_office_path_against_a_drifting_copy_equals_evo(samples, wander):
    truth = read_trajectory(samples / "or_kt0/traj0.gt.freiburg").trajectory.T_world_camera
    drift = wander(1, n=len(truth)).reference.log() * 0.01
    pairs = Pairs.of_poses(truth, SE3.exp([1, 2, 3, 0.3, 0.2, 0.5]) @ truth @ SE3.exp(drift))
    for method in ("none", "origin", "se3", "sim3"):
        ours = absolute_error_of_pairs(pairs, AlignmentSettings(method))
        assert_equal(
            ours.translation_m, evo_ape(pairs, method, None, metrics.PoseRelation.translation_part)
        )
    judge = metrics.RPE(metrics.PoseRelation.translation_part, 0.5, metrics.Unit.meters, 0.1, True)
    judge.process_data((path(pairs.reference), path(pairs.estimate)))
    ours = relative_error_of_pairs(
        pairs, RelativeErrorSettings(0.5, "metres", measured_on="estimate")
    )
    assert_equal(ours.translation_m, judge)
