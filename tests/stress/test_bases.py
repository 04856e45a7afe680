"""Perturbations of clean and of noisy frames: what acts before the sensor's noise and after it, and
frames that are written for systems elsewhere.
"""

import json
import shutil

import cv2
import numpy as np
import pytest
from iclnuim.benchmark.perturbations.plan import BASES, CLEAN, NOISY, SCENE, SENSOR, read_plan
from iclnuim.benchmark.systems.staging import StagedSequence
from iclnuim.sequences.stored_sequence import StoredSequence

PLAN = read_plan()
#: Perturbations of colour alone: depth stays as it is without them.
COLOUR = (
    "flat_texture",
    "low_light",
    "exposure_steps",
    "lens_dirt",
    "gamma_steps",
    "gaussian_blur",
)


def images(segment, name, severity, base, number=None):
    perturbed = PLAN.apply(name, severity, segment, base)
    return perturbed.load(perturbed.numbers[1] if number is None else number)


@pytest.mark.parametrize("severity", range(1, 6))
def test_noise_of_a_factor_is_that_factor_on_every_base(segment, severity):
    for a, b in zip(*(images(segment, "noise", severity, base) for base in BASES), strict=True):
        np.testing.assert_array_equal(a, b)


def test_the_unperturbed_noisy_frames_are_those_of_the_noise_at_factor_one(segment):
    one = PLAN.perturbations["noise"].levels.index(1) + 1
    for a, b in zip(
        images(segment, "", 0, NOISY), images(segment, "noise", one, CLEAN), strict=True
    ):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("name", COLOUR)
def test_what_changes_colour_alone_leaves_noisy_depth_noisy(segment, name):
    depth = images(segment, name, 3, NOISY)[1]
    np.testing.assert_array_equal(depth, images(segment, "", 0, NOISY)[1])
    assert (depth != images(segment, name, 3, CLEAN)[1]).mean() > 0.1


def test_an_object_of_the_scene_has_the_sensors_noise_and_a_fault_of_the_sensor_has_none(segment):
    clean, noisy = (images(segment, "bare_wall", 5, base)[1] for base in (CLEAN, NOISY))
    on_wall = np.diff(clean, axis=1)[(clean[:, 1:] > 0) & (clean[:, :-1] > 0)].std()
    assert np.diff(noisy, axis=1)[(noisy[:, 1:] > 0) & (noisy[:, :-1] > 0)].std() > 2 * on_wall
    black = PLAN.apply("black_frames", 5, segment, NOISY)
    loaded = [black.load(number) for number in black.numbers]
    assert any(not colour.any() and not depth.any() for colour, depth in loaded)


def test_every_perturbation_acts_somewhere_and_only_objects_have_masks():
    acts_on = {name: p.acts_on for name, p in PLAN.perturbations.items()}
    assert [name for name, where in acts_on.items() if where not in (SCENE, SENSOR)] == ["noise"]
    objects = {name for name, p in PLAN.perturbations.items() if p.puts_in}
    assert all(acts_on[name] == SCENE for name in objects) and {"people", "glass"} <= objects


@pytest.mark.parametrize(
    "name", sorted(name for name, p in PLAN.perturbations.items() if p.puts_in)
)
def test_a_mask_is_where_a_perturbation_changes_the_frame(segment, name):
    """Outside of it the frame is as rendered; inside of it depth or nearly every colour is not."""
    number = segment.middle
    on = PLAN.put_in(name, 4, segment, number)
    before, after = segment.load(number), PLAN.apply(name, 4, segment).load(number)
    changed = (before[0] != after[0]).any(-1) | (before[1] != after[1])
    assert not (changed & ~on).any() and on.any()
    assert changed[on].mean() > 0.9


def test_written_frames_are_those_that_a_system_is_given_and_resumed(
    command_here, folder, tmp_path
):
    words = ("stress", folder, "--frames", ":6", "--starts", "1", "--only", "people", "--quiet")
    words += ("--severities", "2,5", "--base", "clean")
    assert command_here(*words, "--write", tmp_path / "w")[0] == 0
    places = sorted(p.parent for p in (tmp_path / "w/sequences").rglob("rgb.txt"))
    assert [place.name for place in places] == ["clean", "people_2", "people_5"]
    from dataclasses import replace

    from iclnuim.benchmark.experiments.inputs import Input
    from iclnuim.benchmark.experiments.recipes.stress.recipe import Stress, write_segment
    from iclnuim.benchmark.odometry.run import Sequence

    one = Input.of(Sequence(folder), "box")
    plan = replace(PLAN, frames=6)
    stress = Stress(plan, {"box": one}, (), (), ("people",), (2, 5), 1, "best", 1, CLEAN)
    for key, place in zip(stress.segment_keys(), places, strict=True):
        staged = tmp_path / "staged" / place.name
        write_segment(stress.segment(key), staged)
        for file in (f for f in staged.rglob("*") if f.suffix in (".png", ".txt", ".yaml")):
            assert file.read_bytes() == (place / file.relative_to(staged)).read_bytes(), file
        assert StagedSequence.of(staged).images_sha256 == StagedSequence.of(place).images_sha256
    masks = sorted((tmp_path / "w/masks").rglob("*.png"))
    assert len(masks) == 12
    for mask in masks:
        on = cv2.imread(str(mask), cv2.IMREAD_UNCHANGED)
        assert set(np.unique(on)) <= {0, 65535} and on.shape == (
            one.sequence.camera.pinhole.height,
            one.sequence.camera.pinhole.width,
        )
    before = {f: f.stat().st_mtime_ns for f in (tmp_path / "w").rglob("*.png")}
    assert command_here(*words, "--write", tmp_path / "w")[0] == 0
    assert before == {f: f.stat().st_mtime_ns for f in before}


def test_trajectories_from_elsewhere_land_in_the_table_of_systems(command_here, folder, tmp_path):
    words = ("stress", folder, "--frames", ":6", "--starts", "1", "--only", "holes", "--quiet")
    words += ("--severities", "5")
    assert command_here(*words, "--write", tmp_path / "w")[0] == 0
    code, _, err = command_here(*words, "--returned", tmp_path / "w", "-o", tmp_path / "s")
    assert code == 2 and "trajectories/SEQUENCE" in err
    for place in sorted(p.parent for p in (tmp_path / "w/sequences").rglob("rgb.txt")):
        assert "noisy" in place.parts
        target = tmp_path / "w/trajectories" / place.relative_to(tmp_path / "w/sequences")
        target.mkdir(parents=True)
        truth = StoredSequence(place).folder / "groundtruth.txt"
        shutil.copy(truth, target / "mine.txt")
        lines = truth.read_text().splitlines()
        (target / "half.txt").write_text("\n".join(lines[:-4]) + "\n")
    code, out, _ = command_here(
        *words, "--returned", tmp_path / "w", "-o", tmp_path / "s", "--json"
    )
    found = json.loads(out)
    cells = {(cell["method"], cell["severity"]): cell for cell in found["cells"]}
    assert code == 0 and found["base"] == NOISY
    assert set(cells) == {("mine", 0), ("mine", 5), ("half", 0), ("half", 5)}
    assert cells["mine", 5]["ate_m"] < 1e-5 and cells["mine", 5]["coverage"] == 1
    assert cells["half", 0]["coverage"] < 0.7
    assert "run:mine" in (tmp_path / "s/stress.csv").read_text()


def test_a_table_has_the_cells_of_one_base(command_here, folder, tmp_path):
    words = ("stress", folder, "--frames", ":4", "--starts", "1", "--only", "holes", "--quiet")
    words += ("--severities", "5", "--methods", "icp", "--workers", "1", "-o", tmp_path / "s")
    for base in BASES:
        assert command_here(*words, "--base", base)[0] == 0
        rows = (tmp_path / "s/stress.csv").read_text().splitlines()
        assert rows[0].endswith(",base") and {row.split(",")[-1] for row in rows[1:]} == {base}
        file = tmp_path / f"{base}.csv"
        shutil.copy(tmp_path / "s/stress.csv", file)
    assert len(list((tmp_path / "s/cells").rglob("*.cell.json"))) == 4
    other = ("stress", "--report-only", "-o", tmp_path / "none", "--cells", tmp_path / "clean.csv")
    assert command_here(*other, "--methods", "icp", "--quiet", "--base", "noisy")[0] == 3
    assert command_here(*other, "--methods", "icp", "--quiet", "--base", "clean")[0] == 0
    old = (tmp_path / "clean.csv").read_text().splitlines()
    (tmp_path / "clean.csv").write_text("\n".join(row.rpartition(",")[0] for row in old) + "\n")
    assert command_here(*other, "--methods", "icp", "--quiet", "--base", "clean")[0] == 0
