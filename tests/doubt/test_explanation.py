"""What explains a bad estimate is named, over kinds of mistakes, motions, errors of odometers and
formats of files, and nothing is named where the estimate is as it should be.
"""

import json
from collections import Counter

import corrupted_estimates
import numpy as np
import pytest
from corrupted_estimates import KINDS, OF_TIME, corrupted, estimate_of, truth_of
from iclnuim.doubt.against_truth import explain
from iclnuim.doubt.constant_transform import rotation_name
from iclnuim.errors import InputError
from iclnuim.evaluation.absolute_error import AbsoluteErrorSettings, absolute_error
from iclnuim.evaluation.relative_error import RelativeErrorSettings, relative_error
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.headless import cli
from iclnuim.report.trajectory_report import ComparedFile, Report
from iclnuim.trajectory_files.trajectories import read_trajectory, write_trajectory

RPE = RelativeErrorSettings(10.0)
SETTINGS = (AbsoluteErrorSettings(), RPE)
#: What may be named for a kind of mistake. The arm of another body can be below the error.
RIGHT = {
    **dict.fromkeys(("opengl", "flu", "ned", "rotation", "truth rotation"), {"rotation"}),
    **dict.fromkeys(("inverse", "truth inverse"), {"inverse"}),
    **dict.fromkeys(("wxyz", "truth wxyz"), {"wxyz", "xyzw"}),
    **dict.fromkeys(("scale", "unit"), {"scale"}),
    **dict.fromkeys(("mirror", "mirrored positions"), {"mirror"}),
    "offset": {"offset"},
    **dict.fromkeys(OF_TIME, {"rate", "rows", "offset"}),
    "lever": {"arm"},
    "extrinsic": {"body", "rotation"},
    "axes": {"axes"},
    "rotations inverse": {"inverse rotations"},
}
STAMPED = ("tum", "euroc", "vslam-lab")
UNSTAMPED = ("kitti", "replica")


class Case:
    """A pair of files, right and with a mistake."""

    def __init__(self, kind, seed, folder):
        rng = np.random.default_rng(seed)
        stamped = kind in ("offset", *OF_TIME) or "wxyz" in kind
        unstamped = bool(rng.random() < 0.3) and not stamped
        names = UNSTAMPED if unstamped else STAMPED
        whole = unstamped or kind in ("renumbered", "rows")
        formats = tuple(rng.choice(names, 2))
        truth = truth_of(rng)
        estimate = estimate_of(rng, truth, whole)
        self.kind = kind
        self.folder = folder
        self.right = self.written("right", truth, estimate, formats)
        self.given = self.right
        if kind == "renumbered":
            estimate = estimate[:: int(rng.integers(1, 6))]
        if kind != "right":
            pair = corrupted(kind, rng, truth, estimate, formats)
            self.given = self.written("given", *pair, formats)

    def written(self, name, truth, estimate, formats):
        paths = []
        for file, trajectory, format in zip("te", (truth, estimate), formats, strict=True):
            path = self.folder / f"{name}_{file}.{format}"
            write_trajectory(path, trajectory, format)
            paths.append((path, format))
        return paths

    def files(self, paths):
        return [ComparedFile(str(path), read_trajectory(path, format)) for path, format in paths]

    @property
    def counts(self):
        """Whether ATE or RPE as given are at least twice those of the right files; None if they
        cannot be compared.
        """
        if self.kind == "right":
            return False
        try:
            right, given = (errors_m(*self.files(paths)) for paths in (self.right, self.given))
        except InputError:
            return None
        return bool((given >= 2 * right).any())


def errors_m(truth, estimate):
    both = truth.loaded.trajectory, estimate.loaded.trajectory
    ate = absolute_error(*both).translation_m.rmse
    return np.array([ate, relative_error(*both, RPE).translation_m.rmse])


def named(case, settings):
    explained = Report.of(*case.files(case.given), settings).explained
    return explained and frozenset(explained.explanation.kinds)


def counted(kinds, seeds, folder):
    """How often each kind was noticed, and named right and wrong."""
    table = {}
    for kind in kinds:
        table[kind] = Counter()
        for seed in seeds:
            case = Case(kind, seed, folder)
            counts = case.counts
            if counts is None:
                table[kind]["refused"] += 1
                continue
            found = named(case, SETTINGS[seed % 2])
            if not counts:
                table[kind]["others"] += 1
                # a mistake of a little less than twice the error may be named by its kind
                table[kind]["others named"] += not (found or set()) <= RIGHT.get(kind, set())
                continue
            table[kind]["all"] += 1
            table[kind]["noticed"] += found is not None
            table[kind]["right"] += bool((found or set()) & RIGHT[kind])
            table[kind]["wrong"] += not (found or set()) <= RIGHT[kind]
    return table


def test_each_kind_is_named(tmp_path):
    table = counted(KINDS, [1], tmp_path)
    total = sum(table.values(), Counter())
    assert total["all"] >= 15
    assert total["noticed"] >= 0.98 * total["all"], table
    assert total["right"] >= 0.95 * total["all"], table
    assert total["others named"] == 0, table


def test_nothing_is_named_for_estimates_as_they_should_be(tmp_path):
    assert counted(["right"], range(12), tmp_path)["right"]["others named"] == 0


@pytest.mark.slow
def test_a_thousand_mistakes(tmp_path):
    table = counted(KINDS, range(1000, 1056), tmp_path)
    print(json.dumps(table, indent=1))
    total = sum(table.values(), Counter())
    assert total["all"] + total["others"] + total["refused"] >= 1000
    assert total["noticed"] >= 0.98 * total["all"]
    assert total["right"] >= 0.90 * total["all"]
    assert total["wrong"] <= 0.02 * total["all"]
    assert total["others named"] == 0


@pytest.mark.slow
def test_five_hundred_right_estimates(tmp_path):
    assert counted(["right"], range(2000, 2500), tmp_path)["right"]["others named"] == 0


@pytest.mark.slow
@pytest.mark.parametrize("metric", [["ate"], ["rpe", "--delta", "10"]], ids=["ate", "rpe"])
def test_the_command_warns_of_each_kind(tmp_path, capsys, metric):
    total = Counter()
    for kind in KINDS:
        for seed in (3000, 3001, 3002):
            case = Case(kind, seed, tmp_path)
            if not case.counts:
                continue
            (truth, truth_format), (estimate, format) = case.given
            words = [str(truth), str(estimate), "--from", format, "--reference-from", truth_format]
            assert cli.main(["evaluate", *metric, *words, "--json"]) == 0
            values = json.loads(capsys.readouterr().out)
            total["all"] += 1
            total["noticed"] += bool(values["warnings"])
    assert total["all"] >= 40 and total["noticed"] >= 0.98 * total["all"]


def failed(truth, kind, rng):
    """Estimates that failed, which no reading explains."""
    poses = truth.T_world_camera
    frames = len(truth)
    step_m = np.median(truth.step_lengths_m())
    if kind == "another motion":
        sigma = np.r_[[step_m] * 3, [0.01] * 3]
        return SE3.exp(np.cumsum(rng.normal(size=(frames, 6)) * sigma, axis=0))
    if kind == "another motion, much smaller":
        sigma = np.r_[[step_m / 100] * 3, [0.01] * 3]
        return SE3.exp(np.cumsum(rng.normal(size=(frames, 6)) * sigma, axis=0))
    if kind == "other rotations":
        turns = np.cumsum(rng.normal(0, 0.05, (frames, 3)), axis=0)
        other = SE3.exp(np.column_stack([np.zeros((frames, 3)), turns]))
        return SE3(other.rotation, poses.translation)
    half = np.arange(frames) < frames // 2
    jump = SE3.exp(rng.normal(0, 1.0, 6)) @ poses
    still = np.where(half, np.arange(frames), frames // 2)
    if kind == "lost half way":
        return poses[still]
    return SE3(
        np.where(half[:, None, None], poses.rotation, jump.rotation),
        np.where(half[:, None], poses.translation, jump.translation),
    )


@pytest.mark.parametrize(
    "kind",
    [
        "another motion",
        "another motion, much smaller",
        "other rotations",
        "lost half way",
        "jump half way",
    ],
)
def test_a_failed_estimate_is_given_no_explanation(kind):
    for seed in range(2):
        rng = np.random.default_rng(seed)
        truth = truth_of(rng)
        assert explain(truth, Trajectory(truth.stamps_s, failed(truth, kind, rng))) is None


def test_what_the_rotation_is_called_and_by_how_much_the_rpe_is_better(tmp_path):
    truth = corrupted_estimates.flight(np.random.default_rng(1))
    for kind, words in (
        ("opengl", "OpenCV's and OpenGL's axes"),
        ("flu", "OpenCV's and FLU axes"),
        ("ned", "OpenCV's and NED axes"),
    ):
        _, given = corrupted(kind, np.random.default_rng(1), truth, truth)
        files = []
        for name, trajectory in (("t", truth), ("e", given)):
            write_trajectory(tmp_path / name, trajectory, "tum")
            files.append(ComparedFile(name, read_trajectory(tmp_path / name, "tum")))
        warning = Report.of(*files, AbsoluteErrorSettings()).warnings[0]
        assert words in warning and "a constant rotation of" in warning
        assert "RPE over 10 frames" in warning and "instead of" in warning


@pytest.mark.parametrize(("off_deg", "is_named"), [(2.0, True), (4.0, False)])
def test_a_usual_rotation_is_named_within_a_few_degrees(off_deg, is_named):
    off = SE3.exp(np.r_[0, 0, 0, np.radians(off_deg), 0, 0]).rotation
    name = rotation_name(corrupted_estimates.FLIPPED @ off)
    assert ("OpenGL's" in name) == is_named


def test_positions_without_rotations_are_given_scale_mirror_and_offset():
    rng = np.random.default_rng(5)
    truth = corrupted_estimates.flight(rng)
    noisy = truth.positions_m + rng.normal(0, 0.01, (len(truth), 3))
    for kind, positions_m, late_s in (
        (None, noisy, 0.0),
        ("scale", 3 * noisy, 0.0),
        ("mirror", noisy * [1, 1, -1], 0.0),
        ("offset", noisy, 1.0),
    ):
        still = SE3(np.broadcast_to(np.eye(3), (len(truth), 3, 3)), positions_m)
        found = explain(truth, Trajectory(truth.stamps_s + late_s, still))
        assert (found.kinds if found else [None]) == [kind]


def test_a_part_of_an_explanation_is_named_if_it_explains_nearly_as_much():
    rng = np.random.default_rng(6)
    truth = corrupted_estimates.flight(rng)
    shake = SE3.exp(rng.normal(0, 1e-2, (len(truth), 6)))
    tilt = SE3.exp(np.r_[0, 0, 0, 0.02, 0, 0])
    for turn, kinds in (
        (tilt, ["scale"]),
        (SE3(corrupted_estimates.FLIPPED, np.zeros(3)), ["rotation", "scale"]),
    ):
        poses = truth.T_world_camera @ shake @ turn
        given = Trajectory(truth.stamps_s, SE3(poses.rotation, 3 * poses.translation))
        found = explain(truth, given)
        assert found.kinds == kinds
        assert found.changes[-1].parameters["scale"] == pytest.approx(1 / 3, rel=0.01)
