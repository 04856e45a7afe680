"""The plan: every missing frame in exactly one chunk, whatever the sizes; the cores of a machine
shared without rest; the record of a run.
"""

import shutil
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from iclnuim.errors import InputError
from iclnuim.geometry.se3 import SE3
from iclnuim.headless.farm.chunks import (
    chunks_of,
    local_size,
    numbers_from,
    numbers_text,
    size_for_seconds,
    split,
)
from iclnuim.headless.farm.run_plan import RECORD, RunPlan, read_plan
from iclnuim.job import shipped_job
from iclnuim.sensor.imu import ImuOnCamera
from iclnuim.sequences.sequence_options import SequenceOptions
from iclnuim.trajectory_files.paths import path_of


@given(st.lists(st.integers(0, 10**6), unique=True, max_size=300), st.integers(1, 400))
def test_each_frame_is_in_one_chunk_in_its_order_and_none_is_too_long(frames, size):
    chunks = chunks_of(frames, size)
    assert [n for chunk in chunks for n in chunk] == frames
    assert all(1 <= len(chunk) <= size for chunk in chunks)
    lengths = [len(chunk) for chunk in chunks] or [0]
    assert max(lengths) - min(lengths) <= 1


@given(st.integers(0, 10**5), st.integers(1, 256))
def test_local_chunks_keep_all_workers_busy_to_the_end(frames, workers):
    size = local_size(frames, workers)
    assert 1 <= size <= 25 and (size == 1 or workers == 1 or frames / size >= 8 * workers)


def test_chunks_for_a_cluster_fill_the_time():
    assert size_for_seconds(300, 0.1) == 3000
    assert size_for_seconds(300, 1000) == 1
    with pytest.raises(InputError, match="above 0"):
        size_for_seconds(300, 0)


@given(st.integers(1, 200))
def test_every_core_has_one_worker_and_every_worker_two_cores(count):
    shares = split(None, list(range(count)))
    assert sorted(core for share in shares for core in share) == list(range(count))
    assert all(len(share) >= min(2, count) for share in shares)


def test_of_more_workers_than_pairs_of_cores_two_share_a_pair_and_there_are_no_more():
    assert split(3, [0, 1, 2, 3, 4]) == [[0, 1], [2, 3, 4], [0, 1]]
    assert split(5, [0, 1, 2, 3]) == [[0, 1], [2, 3]] * 2


@given(st.lists(st.integers(0, 2000), unique=True, min_size=1, max_size=300))
def test_frame_numbers_go_into_text_and_back(numbers):
    assert numbers_from(numbers_text(numbers)) == tuple(sorted(numbers))


def test_frame_numbers_are_written_as_ranges_and_others_are_refused():
    assert numbers_text([5, 0, 1, 2, 7]) == "0-2,5,7"
    for wrong in ("", "1-", "a", "1,,2"):
        with pytest.raises(InputError, match="0-24,30"):
            numbers_from(wrong)


def test_a_record_is_read_and_written_with_the_same_bytes(repository, tmp_path):
    record = tmp_path / RECORD
    record.parent.mkdir()
    shutil.copy(repository / "tests/farm/run_record.json", record)
    written = record.read_bytes()
    plan = read_plan(tmp_path)
    assert plan.job.light == "path" and plan.sequences.formats == ("tum", "nerf")
    assert (plan.numbers, plan.farm.worker_timeout_s) == ((0, 1, 2, 3), 90.0)
    record.unlink()
    plan.write_record()
    assert record.read_bytes() == written


def test_the_record_of_a_run_keeps_its_imu(tmp_path):
    imu = ImuOnCamera(200.0, tuple(SE3.identity().matrix.ravel().tolist()), path_of("kt2").recipe)
    plan = RunPlan(
        replace(shipped_job("kt2"), imu=imu), tmp_path, (0, 1), SequenceOptions(imu_noise="bmi055")
    )
    plan.write_record()
    again = read_plan(tmp_path)
    assert again.job == plan.job and again.sequences == plan.sequences
    clean, noisy = again.variants().values()
    assert (clean.imu.name, noisy.imu.name) == ("none", "bmi055")
    without = replace(plan, job=shipped_job("kt2"), sequences=SequenceOptions()).to_dict()
    assert "imu" not in without["job"] and "imu_noise" not in without["sequences"]
