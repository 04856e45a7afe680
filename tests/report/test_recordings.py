"""Recordings for Rerun, read back by Rerun's own reader: images to the byte, poses, curves, flags,
a surface with its errors; refused in one line.
"""

import subprocess
import sys

import numpy as np
import pytest
from iclnuim.benchmark.fusion.recording import record_surface
from iclnuim.benchmark.fusion.surface_error import SurfaceError
from iclnuim.benchmark.odometry.protocol import OdometryResult, OdometryStatus, failure
from iclnuim.benchmark.odometry.recording import record_runs
from iclnuim.benchmark.odometry.run import OdometryRun
from iclnuim.benchmark.odometry.track import Tracked
from iclnuim.errors import InputError, WorkError
from iclnuim.formats.png import read_depth16
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.postprocess import frames_from
from iclnuim.report.recording import check_recording, record_sequence
from iclnuim.sequences.stored_sequence import StoredSequence
from iclnuim.sequences.writer import write_sequence
from patience import patience

TIMES = np.array([0.0, 0.0, 0.0, 0.4, 0.0, 0.1])
TRUTH = Trajectory.at_rate(
    SE3.exp(
        np.arange(8)[:, None] * TIMES + np.sin(np.arange(8))[:, None] * [0.2, 0.1, 0.3, 0, 0, 0]
    )
)
CAMERA = PinholeCamera.parse("40x30")


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    """Eight frames of 40 x 30."""
    folder, (v, u) = tmp_path_factory.mktemp("recordings") / "room", np.mgrid[0:30, 0:40]
    light = np.stack([u / 40, v / 30, 0.2 + 0 * u], -1) / 2
    write_sequence(
        frames_from(
            CAMERA, TRUTH, lambda number: (light + number / 20, 1.0 + v / 30 + number / 10)
        ),
        folder,
        workers=1,
    )
    return folder


def read(path):
    """entity -> component -> [(stamp in seconds or None, value)] by whichever reader this version
    of rerun has; stamps in order.
    """
    rerun = pytest.importorskip("rerun", reason="recordings: pip install rerun-sdk")
    if rerun.__version__.startswith("0.23"):
        return _read_by_dataframe(rerun.dataframe.load_recording(path))
    from rerun.chunk import RrdReader

    found = {}
    for chunk in RrdReader(path).stream().to_chunks():
        rows = chunk.to_record_batch().to_pydict()
        stamps = [
            None if t is None else t.total_seconds()
            for t in rows.get("time", [None] * chunk.num_rows)
        ]
        for name in rows.keys() - {"time", "frame", "log_time", "log_tick", "rerun.controls.RowId"}:
            component = found.setdefault(chunk.entity_path, {}).setdefault(
                name.rpartition(":")[2].lower(), []
            )
            component += [(t, v) for t, v in zip(stamps, rows[name], strict=True) if v is not None]
    return {
        e: {c: sorted(r, key=lambda row: row[0] or 0.0) for c, r in parts.items()}
        for e, parts in found.items()
    }


#: What rerun 0.23 calls a component -> what later versions do.
TODAY = {
    "scalar": "scalars",
    "transformmat3x3": "mat3x3",
    "translation3d": "translation",
    "imagebuffer": "buffer",
    "position3d": "positions",
}


def _read_by_dataframe(recording):
    view, found = recording.view(index="time", contents="/**"), {}
    static, timed = (
        table.read_all().to_pydict() for table in (view.select_static(), view.select())
    )
    stamps = (
        [t / np.timedelta64(1, "s") for t in np.array(timed.pop("time"), "m8[ns]")]
        if "time" in timed
        else []
    )
    for name, values in (*static.items(), *timed.items()):
        entity, _, component = name.partition(":")
        times = [None] if name in static else stamps
        if component and (values is static.get(name) or name not in static):
            rows = [(t, v) for t, v in zip(times, values, strict=True) if v is not None]
            found.setdefault(entity, {})[TODAY.get(component.lower(), component.lower())] = rows
    return found


def verified(path):
    """Rerun's own check of the file."""
    pytest.importorskip("rerun", reason="recordings: pip install rerun-sdk")
    done = subprocess.run(
        [sys.executable, "-m", "rerun", "rrd", "verify", str(path)],
        capture_output=True,
        timeout=patience(60),
    )
    assert done.returncode == 0, done.stderr
    return read(path)


def test_a_sequence_is_read_back_to_the_byte(sequence, tmp_path):
    pytest.importorskip("rerun", reason="recordings: pip install rerun-sdk")
    record_sequence(tmp_path / "room.rrd", sequence)
    found, pairs = verified(tmp_path / "room.rrd"), StoredSequence(sequence).pairs
    images, truth = (
        found["/world/camera/image/rgb"]["blob"],
        StoredSequence(sequence).truth.T_world_camera,
    )
    assert [t for t, _ in images] == pytest.approx([pair.stamp_s for pair in pairs], abs=1e-9)
    assert [np.asarray(v[0], np.uint8).tobytes() for _, v in images] == [
        pair.rgb.read_bytes() for pair in pairs
    ]
    depths = [
        np.frombuffer(np.asarray(v[0], np.uint8).tobytes(), "<u2").reshape(30, 40)
        for _, v in found["/world/camera/image/depth"]["buffer"]
    ]
    assert all(
        np.array_equal(depth, read_depth16(pair.depth))
        for depth, pair in zip(depths, pairs, strict=True)
    )
    pose = found["/world/camera"]
    # by columns, 32 bits
    rotations = np.array([v[0] for _, v in pose["mat3x3"]]).reshape(-1, 3, 3).swapaxes(1, 2)
    assert np.abs(rotations - truth.rotation).max() < 1e-6
    assert np.abs(np.array([v[0] for _, v in pose["translation"]]) - truth.translation).max() < 1e-6


def test_a_run_is_read_back_with_errors_residuals_and_flags(sequence, tmp_path):
    pytest.importorskip("rerun", reason="recordings: pip install rerun-sdk")
    off = SE3.exp([0.3, -0.2, 0.1, 0.2, 0.4, -0.1])
    results = [OdometryResult(SE3.identity(), residual=k / 10, inliers=0.9) for k in range(8)]
    results[3] = failure("image: no contrast")
    results[5] = OdometryResult(
        SE3.identity(), OdometryStatus.DEGENERATE, converged=False, residual=0.5
    )
    frames = [
        Tracked(float(t), off @ TRUTH.T_world_camera[k], results[k])
        for k, t in enumerate(TRUTH.stamps_s)
    ]
    record_runs(
        tmp_path / "run.rrd", sequence, [OdometryRun("baseline:mine", frames, TRUTH)], CAMERA
    )
    found = verified(tmp_path / "run.rrd")
    stamps = [t for k, t in enumerate(TRUTH.stamps_s) if k != 3]
    residuals = found["/residual/baseline_mine"]["scalars"]
    assert [t for t, _ in residuals] == pytest.approx(stamps, abs=1e-9)
    assert [v[0] for _, v in residuals] == [0.0, 0.1, 0.2, 0.4, 0.5, 0.6, 0.7]
    assert max(v[0] for _, v in found["/error_m/baseline_mine"]["scalars"]) < 1e-9
    flags = [(t, v[0]) for t, v in found["/flags/baseline_mine"]["text"]]
    assert [text for _, text in flags] == ["lost: image: no contrast", "degenerate, not converged"]
    assert [t for t, _ in flags] == pytest.approx(TRUTH.stamps_s[[3, 5]], abs=1e-9)
    places = np.array([v[0] for _, v in found["/world/baseline_mine/camera"]["translation"]])
    assert np.abs(places - TRUTH.positions_m).max() < 1e-6  # aligned with the truth
    assert {"/world/truth", "/world/baseline_mine/trajectory"} <= found.keys()


def test_a_surface_is_read_back_with_its_errors(tmp_path):
    pytest.importorskip("rerun", reason="recordings: pip install rerun-sdk")
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 2]], float)
    error = SurfaceError(np.array([0.0, 0.001, 0.005, 0.2]), SE3.identity())
    for triangles in (np.array([[0, 1, 2], [0, 2, 3]]), np.zeros((0, 3), int)):
        record_surface(tmp_path / "surface.rrd", tmp_path, points, triangles, error, 10.0)
        surface = verified(tmp_path / "surface.rrd")["/world/surface"]
        place = surface.get("vertex_positions") or surface["positions"]
        assert np.array_equal(np.array(place[0][1]), points)
        (errors_mm,) = [rows for name, rows in surface.items() if name.endswith("error_mm")]
        assert np.array(errors_mm[0][1]) == pytest.approx([0, 1, 5, 200])


def test_the_commands_write_them(sequence, tmp_path, command_here):
    pytest.importorskip("rerun", reason="recordings: pip install rerun-sdk")
    assert command_here("inspect", sequence, "--rerun", tmp_path / "a.rrd")[0] in (0, 2)
    assert len(read(tmp_path / "a.rrd")["/world/camera/image/rgb"]["blob"]) == 8


def test_what_cannot_be_written_is_refused_before_the_work(
    sequence, tmp_path, command_here, monkeypatch
):
    code, _, said = command_here("inspect", sequence, "--rerun", tmp_path / "run.txt")
    assert code == 2 and "run.txt: expected a recording's name ending in .rrd, found .txt" in said
    with pytest.raises(InputError):
        check_recording(tmp_path / "nowhere/run.rrd")
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(WorkError, match=r"rerun-sdk .*; try: pip install rerun-sdk"):
        check_recording(tmp_path / "run.rrd")
