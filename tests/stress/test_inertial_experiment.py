"""The experiment `inertial`: which images fail and how, the readings that stay, its cells and table."""

import json
import shutil
import sys
from pathlib import Path

import iclnuim
import numpy as np
import pytest
from iclnuim.benchmark.experiments.cell import Measured
from iclnuim.benchmark.experiments.experiment import SequenceKey
from iclnuim.benchmark.experiments.inputs import Input
from iclnuim.benchmark.experiments.recipes.inertial import Inertial
from iclnuim.benchmark.odometry.run import Sequence
from iclnuim.sequences.imu import SequenceImu, write_imu
from iclnuim.sequences.stored_sequence import StoredSequence
from iclnuim.sequences.writer import write_sequence

#: Of the box's frames, 30 a second: 3 whole, then 2 of 4 fail.
TIMES = {"whole_s": 0.095, "failing_s": 0.06, "every_s": 4 / 30}
FAILING = [3, 4, 7, 8]


@pytest.fixture(scope="module")
def with_imu(folder, tmp_path_factory):
    copy = tmp_path_factory.mktemp("inertial") / "box/noisy"
    shutil.copytree(folder, copy)
    write_imu(copy, SequenceImu(iclnuim.imu_of(copy / "groundtruth.txt", noise="bmi055")))
    return copy


@pytest.fixture
def segments(with_imu):
    """kind -> the segment whose images fail so, and the images as they are by number."""
    one = Input.of(Sequence(with_imu), "box")
    experiment = Inertial(**TIMES)
    whole = [one.sequence.images(pair) for pair in one.sequence.pairs]
    return lambda kind: experiment.segment(kind, one), whole


@pytest.mark.parametrize("kind", ["black", "frozen", "blurred", "dark"])
def test_only_the_images_of_a_failure_change(segments, kind):
    segment, whole = segments
    changed = []
    for number, images in enumerate(whole[:9]):
        found = segment(kind).load(number)
        if not all(map(np.array_equal, found, images)):
            changed.append(number)
    assert changed == FAILING


def test_what_becomes_of_images_that_fail(segments):
    segment, whole = segments
    for number, last in ((3, 2), (4, 2), (7, 6), (8, 6)):
        assert not np.any(segment("black").load(number)[0])
        assert not np.any(segment("black").load(number)[1])
        for found, images in zip(segment("frozen").load(number), whole[last], strict=True):
            np.testing.assert_array_equal(found, images)
        blurred, depth_z_m = segment("blurred").load(number)
        steps = [
            np.abs(np.diff(x.astype(float), axis=1)).mean() for x in (blurred, whole[number][0])
        ]
        assert steps[0] < 0.5 * steps[1] and np.array_equal(depth_z_m, whole[number][1])
        assert segment("dark").load(number)[0].mean() < 0.2 * whole[number][0].mean()


def test_the_sequence_that_is_written_has_its_readings_and_poses(with_imu, tmp_path):
    one = Input.of(Sequence(with_imu, frames="1:8:2"), "box")
    write_sequence(Inertial(**TIMES).frames("frozen", one), tmp_path / "frames", workers=1)
    stored, written = StoredSequence(with_imu), StoredSequence(tmp_path / "frames")
    stamps_s = stored.truth.stamps_s[1:8:2]
    np.testing.assert_array_equal(written.truth.stamps_s, stamps_s)
    expected = stored.imu.stream.around(*stamps_s[[0, -1]])
    np.testing.assert_array_equal(written.imu.stream.readings, expected.readings)
    for pair, last in zip(written.pairs, (1, 3, 3, 7), strict=True):  # the third image fails
        for found, image in zip(
            written.images(pair), stored.images(stored.pairs[last]), strict=True
        ):
            np.testing.assert_array_equal(found, image)


def test_its_cells_have_both_modes_with_the_readings_of_the_sequence(
    command_here, with_imu, folder, tmp_path, monkeypatch
):
    stand_in = Path(__file__).parents[1] / "systems/stand_in"
    monkeypatch.setenv("PYTHONPATH", str(stand_in))
    (tmp_path / "words.txt").write_text("a vocabulary")
    settings = {"vocabulary": tmp_path / "words.txt", "program": sys.executable, **TIMES}
    settings |= {"kinds": "black", "runs": 2}
    words = [f"--set={name}={value}" for name, value in settings.items()]
    rest = (*words, "--workers", "1", "--json", "-o", tmp_path / "out")
    code, text, err = command_here("experiment", "inertial", with_imu, *rest)
    assert code == 0, err
    cells = {one["variant"]: one for one in json.loads(text)["cells"]}
    assert list(cells) == ["black/rgbd", "black/rgbd-inertial"]
    assert all(len(one["ate_m"]) == 2 for one in cells.values())
    assert cells["black/rgbd"]["coverage"] == cells["black/rgbd-inertial"]["coverage"] == [1, 1]
    code, _, err = command_here("experiment", "inertial", folder, *rest)
    assert code == 2 and "expected an IMU in the sequence" in err


def test_a_run_without_an_error_or_half_of_the_frames_is_no_success():
    figures = {"ate_m": [0.02, 0.2, None, 0.01], "coverage": [1.0, 1.0, 0.0, 0.4]}
    good = {"ate_m": [0.02] * 4, "coverage": [1.0] * 4}
    cells = [
        Measured(SequenceKey("kt2", f"black/{mode}"), {}, one)
        for mode, one in (("rgbd", figures), ("rgbd-inertial", good))
    ]
    (table,) = Inertial().tables(cells)
    assert table.rows[0] == ("kt2", "black", "1/4, 110", "4/4, 20")
    assert [text.partition(":")[0] for text in table.rows[1]] == ["all", "", "1/4", "4/4"]
