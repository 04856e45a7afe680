"""The model of many machines keeps to its own laws; a measured split makes sense; the charts draw."""

from dataclasses import asdict

import pytest
from hypothesis import given
from hypothesis import strategies as st
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.job import shipped_job
from iclnuim.tools.farm_model import Model, figures

models = st.builds(
    Model,
    name=st.just("any"),
    startup_s=st.floats(0.1, 100),
    frame_s=st.floats(0.01, 300),
    workers_a_node=st.integers(1, 64),
    sequences=st.integers(1, 10_000),
    frames_a_sequence=st.integers(1, 2000),
    bytes_a_second=st.floats(1e8, 1e12),
)


@given(models, st.integers(1, 5000))
def test_more_nodes_never_take_longer_and_no_node_does_more_than_its_work(model, nodes):
    assert model.seconds(nodes + 1) <= model.seconds(nodes)
    assert 0 < model.efficiency(nodes) < 1


@given(models)
def test_beyond_its_limit_more_nodes_change_nothing(model):
    limit, _ = model.stops_scaling()
    assert model.seconds(10 * limit + 10) == pytest.approx(model.seconds(10**9))


@given(models)
def test_chunks_hold_all_frames(model):
    assert model.chunks * model.frames_a_chunk >= model.sequences * model.frames_a_sequence
    assert (
        model.chunks - model.sequences
    ) * model.frames_a_chunk < model.sequences * model.frames_a_sequence


def test_a_machine_alone_takes_the_sum_of_start_and_frames():
    model = Model(
        "by hand", startup_s=10, frame_s=2, workers_a_node=1, sequences=2, frames_a_sequence=300
    )
    assert (model.frames_a_chunk, model.chunks, model.chunk_seconds) == (150, 4, 310)
    assert model.seconds(1) == 4 * 310 and model.seconds(2) == 2 * 310 and model.seconds(100) == 310
    assert model.stops_scaling() == (4, "every worker has one chunk")
    assert figures(model, 2)["efficiency"] == round(300 / 310, 3)


def test_a_store_that_is_full_ends_the_scaling():
    slow = Model(
        "slow disk", startup_s=0, frame_s=1, workers_a_node=1, sequences=100, bytes_a_second=2.5e7
    )
    assert slow.stops_scaling() == (10, "the file system at 0.025 GB/s is the limit")
    assert slow.seconds(10) == pytest.approx(slow.seconds(1000)) == pytest.approx(9000)


def test_a_measured_split_makes_sense_and_is_drawn(repository, tmp_path):
    pytest.importorskip("bpy", reason="needs the bpy package")
    from iclnuim.report import charts as plots
    from iclnuim.tools import farm_chart, farm_model, farm_throughput, measured_tables

    small = {"scene": str(repository / "tests/room.obj"), "camera": PinholeCamera.parse("80x60")}
    job = shipped_job("kt2").changed(light="path", samples=1, denoise=False, **small)
    r = farm_throughput.measure(job, 1, 2, 24)
    assert (r.workers, r.threads, r.frames) == (1, 2, 24)
    assert r.frames_an_hour > 0 and 0 < r.busy_share < 1.1 and 0 < r.startup_s < r.wall_s
    plots.save(farm_chart.figure([r], [farm_model.of(r)], 1000), tmp_path / "farm.png")
    assert (tmp_path / "farm.png").stat().st_size > 10_000
    assert "| 1 x 2 |" in measured_tables.tables({"splits": [asdict(r)]}, "farm-splits")
