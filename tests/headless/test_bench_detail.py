"""`iclnuim bench detail`: the knee of a curve, what an error counts, and the command from end to
end at its smallest.
"""

import json
import subprocess
import sys

import numpy as np
import pytest
from patience import patience

bpy = pytest.importorskip(
    "bpy", reason="needs the bpy package"
)  # before open3d: both bring a TBB, and bpy 5.2 needs its own
pytest.importorskip("embreex")


def test_the_knee_of_a_bent_line_is_where_it_bends_in_whatever_units():
    from iclnuim.tools.detail import knee

    cost, error = np.array([1, 2, 3, 6, 9]), np.array([10, 5, 1, 0.5, 0])
    assert knee(cost, error) == 2
    assert knee(1000 * cost + 7, error / 1000) == 2
    hyperbola = np.linspace(1, 10, 91)
    assert hyperbola[knee(hyperbola, 1 / hyperbola)] == pytest.approx(np.sqrt(10), abs=0.1)


def test_depth_errors_leave_out_the_sky_and_the_painted_surroundings():
    from iclnuim.tools.detail import depth_error, difference

    finest = np.array([[[1.0, 2.0, 40.0, 0.0]]])
    assert depth_error(finest + [0.001, 0.009, 5, 1], finest)[0] == pytest.approx(0.005)
    assert depth_error(finest + [0.001, 0.009, 5, 1], finest)[2] == 0.5
    psnr_db, median = difference(np.zeros((2, 4, 4, 3)), np.ones((2, 4, 4, 3)))
    assert psnr_db == pytest.approx(0.0, abs=1e-6) and median == pytest.approx(255)


def ball_in_a_box(name, detail):
    """Instead of a room: what has more triangles with more detail, and is built in no time."""
    bpy.ops.mesh.primitive_cube_add(size=8)
    bpy.context.object.data.flip_normals()
    bpy.ops.mesh.primitive_uv_sphere_add(
        segments=int(64 * detail), ring_count=int(32 * detail), radius=1.0
    )


OPTIONS = [
    "bench",
    "detail",
    "living_room",
    "--quiet",
    "--json",
    "--lit",
    "none",
    "--maps",
    "none",
    "--views",
    "3",
]
SMALL = ["--camera", "64x48", "--every", "3000"]


def check_figures(found, details, chart):
    levels = found["levels"]["living_room"]
    assert [level["detail"] for level in levels] == details and found["knee"][
        "living_room"
    ] in details
    assert (
        levels[0]["triangles"] < levels[2]["triangles"]
        and levels[0]["mean_m"] > 0 == levels[2]["mean_m"]
    )
    assert 15 < levels[0]["psnr_db"] < 60 and levels[2]["psnr_db"] is None
    assert 0.5 < found["unseen"][0]["triangles"] < 1
    assert chart.stat().st_size > 10_000


def test_the_command_measures_draws_and_names_the_knee(tmp_path, command_here, monkeypatch):
    from iclnuim.tools import detail, detail_unseen

    monkeypatch.setattr(detail, "build_scene", ball_in_a_box)
    monkeypatch.setattr(detail_unseen, "PIECE_M", 0.5)
    chart = tmp_path / "c.png"
    code, printed, said = command_here(*OPTIONS, *SMALL, "--levels", "0.25,0.5,1", "--plot", chart)
    assert code == 0, said
    check_figures(json.loads(printed), [0.25, 0.5, 1.0], chart)


@pytest.mark.slow
def test_the_command_measures_the_living_room(tmp_path):
    command = [sys.executable, "-m", "iclnuim", *OPTIONS, *SMALL, "--levels", "0.15,0.2,0.3"]
    chart = tmp_path / "c.png"
    done = subprocess.run(
        [*command, "--plot", str(chart)], capture_output=True, text=True, timeout=patience(300)
    )
    assert done.returncode == 0, done.stderr
    check_figures(json.loads(done.stdout), [0.15, 0.2, 0.3], chart)


@pytest.mark.parametrize(
    "options, words", [(["cellar"], "living_room, office"), (["--levels", "1,2"], "three levels")]
)
def test_unknown_rooms_and_too_few_levels_are_refused_in_a_line(options, words):
    command = [sys.executable, "-m", "iclnuim", "bench", "detail", *options]
    done = subprocess.run(command, capture_output=True, text=True, timeout=patience(60))
    assert (
        done.returncode == 2 and words in done.stderr and len(done.stderr.strip().splitlines()) == 1
    )
