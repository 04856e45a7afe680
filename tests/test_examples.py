"""The scripts and notebooks of examples/ run on a small sequence: one of each kind here, all in the
slow tests.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import iclnuim
import numpy as np
import pytest
from judges import ABSENT, OF_DATA, has

FOLDER = Path(__file__).parents[1] / "examples"
#: script -> its arguments in the empty folder of the test, what its output has, a file that it makes
RUNS = {
    "01_a_sequence.py": (["clean"], "the camera moves 0.", ""),
    "02_noise_on_your_images.py": (["clean", "noisy"], "measured", "noisy/depth/000015.png"),
    "03_ate_of_arrays.py": (["ate.png"], "AbsoluteError(RMSE", "ate.png"),
    "04_your_odometer.py": (["clean", "odometer.png"], "point_to_point", "odometer.png"),
    "05_frame_from_a_pose.py": (["frame.png"], "RenderedFrame(320x240)", "frame.png"),
    "06_pov_trajectory.py": (["poses.txt", "path.png"], "60 poses, 4.8", "path.png"),
    "07_surface_score.py": (["clean", "room.obj", "score.png"], "F at 1 cm", "surface.ply"),
    "08_your_scene.py": (["room.obj", "mine"], "8 frames of 160x120", "mine/rgb/000007.png"),
    "09_held_out_views.py": (["clean", "room.obj", "views.png"], "HeldOutView", "views.txt"),
    "10_ground_truth.py": (["out", "truth.png"], "class, depth, instance, normal", "truth.png"),
    "13_depth_score.py": (["clean", "depth.png"], "affine DepthErrors(AbsRel", "depth.png"),
    "14_point_maps.py": (["clean", "points.png"], "planted 0.4", "points.png"),
    "15_training_loader.py": (["clean", "loss.png"], "16 frames, loss", "loss.png"),
    "19_simulator_depth.py": (["sensors.png"], "azure_kinect 87% measured", "sensors.png"),
}
NOTEBOOKS = (
    "11_first_look.ipynb", "12_sensor_models.ipynb", "16_depth_score.ipynb", "17_point_maps.ipynb", "18_training_loader.ipynb",
)  # fmt: skip
#: They need torch, which no extra has: `.ci/judges data` installs it.
OF_TORCH = ("15_training_loader.py", "18_training_loader.ipynb")
CAMERA = iclnuim.PinholeCamera.parse("160x120")
CORNERS = np.array(np.meshgrid([-2.0, 2.0], [-2.5, 2.5], [0.0, 2.5])).reshape(3, -1).T
FACES = ((0, 2, 6, 4), (1, 3, 7, 5), (0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6))
MOTION = iclnuim.SE3.exp(np.arange(16)[:, None] / 30 * [0.3, 0.05, 0.2, 0.1, 0.3, 0.05])
POSES = iclnuim.SE3.from_quat_xyzw([-0.775, 0.281, -0.193, 0.532], [0.0, 0.0, 1.4]) @ MOTION


def look(number):
    """The inside of a box of 4 x 5 x 2.5 m with a pattern on its walls."""
    T = POSES[number]
    rays = CAMERA.rays() @ T.rotation.T
    walls = np.where(rays > 0, [2.0, 2.5, 2.5], [-2.0, -2.5, 0.0])
    depth_z_m = ((walls - T.translation) / rays).min(axis=-1)
    points = T.translation + rays * depth_z_m[..., None]
    stripes = np.sin(23 * points.sum(-1, keepdims=True))
    return 0.4 + 0.15 * (np.sin(points * [7, 9, 11]) + stripes), depth_z_m


@pytest.fixture
def folder(tmp_path):
    frames = iclnuim.frames_from(CAMERA, POSES, look)
    iclnuim.make_sequence(frames, tmp_path / "clean", workers=1)
    lines = [f"v {x} {y} {z}" for x, y, z in CORNERS]
    for a, b, c, d in FACES:
        lines += [f"f {a + 1} {b + 1} {c + 1}", f"f {a + 1} {c + 1} {d + 1}"]
    (tmp_path / "room.obj").write_text("\n".join(lines) + "\n")
    return tmp_path


def run(command, folder, python=sys.executable):
    library = str(FOLDER.parent / "addon")  # where a Python has no iclnuim installed
    environment = {**os.environ, "MPLBACKEND": "Agg", "SEQUENCE": "clean", "PYTHONPATH": library}
    if python == sys.executable:
        del environment["PYTHONPATH"]
    done = subprocess.run(
        [python, *command], cwd=folder, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def run_script(script, folder):
    words, said, made = RUNS[script]
    python = python_of(script)
    assert said in run([str(FOLDER / script), *words], folder, python)
    assert not made or (folder / made).stat().st_size > 100


def python_of(name):
    """A Python that can run an example. Skips the test if there is none."""
    if name not in OF_TORCH:
        return sys.executable
    if not has(OF_DATA, "torch, cv2, matplotlib"):
        pytest.skip(f"{ABSENT}torch")
    return OF_DATA


def code_of(notebook):
    cells = json.loads((FOLDER / notebook).read_text())["cells"]
    return ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]


def test_the_first_example_runs(folder):
    run_script("01_a_sequence.py", folder)


def test_the_cells_of_a_notebook_run_in_order(folder):
    (folder / "cells.py").write_text("\n".join(code_of("12_sensor_models.ipynb")))
    assert "median " in run(["cells.py"], folder)


@pytest.mark.slow
@pytest.mark.parametrize("script", list(RUNS))
def test_every_example_runs(folder, script):
    run_script(script, folder)


@pytest.mark.slow
@pytest.mark.parametrize("name", [n for n in NOTEBOOKS if n >= "16"])
def test_the_code_of_a_notebook_on_predictions_runs(folder, name):
    (folder / "cells.py").write_text("\n".join(code_of(name)))
    assert run(["cells.py"], folder, python_of(name))


@pytest.mark.slow
@pytest.mark.parametrize("name", [n for n in NOTEBOOKS if n not in OF_TORCH])
def test_every_notebook_runs_where_jupyter_starts_it(folder, name):
    """In its own folder, beside the `out/` of `iclnuim make kt2 --quick`."""
    pytest.importorskip("nbconvert")
    pytest.importorskip("ipykernel")
    (folder / "out/living_room/kt2").mkdir(parents=True)
    (folder / "clean").rename(folder / "out/living_room/kt2/clean")
    (folder / "examples").mkdir()
    shutil.copy(FOLDER / name, folder / "examples")
    words = ["--to", "notebook", "--execute", "--output", "done", f"examples/{name}"]
    environment = {k: v for k, v in os.environ.items() if k not in ("SEQUENCE", "MPLBACKEND")}
    command = [sys.executable, "-m", "nbconvert", *words]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    outputs = [
        output
        for cell in json.loads((folder / "examples/done.ipynb").read_text())["cells"]
        for output in cell.get("outputs", ())
    ]
    assert any("image/png" in output.get("data", ()) for output in outputs)
    assert not any(output.get("name") == "stderr" for output in outputs)
    assert {path.name for path in (folder / "examples").iterdir()} == {name, "done.ipynb"}


def test_every_example_is_run_and_listed_with_a_small_picture():
    files = sorted(path.name for path in FOLDER.glob("[0-9]*"))
    assert files == sorted([*RUNS, *NOTEBOOKS])
    text = (FOLDER / "README.md").read_text()
    for name in files:
        picture = FOLDER / f"pictures/{name[:2]}.jpg"
        assert f"]({name})" in text and f"](pictures/{picture.name})" in text
        assert 2_000 < picture.stat().st_size < 60_000


def test_outputs_of_notebooks_are_small_and_of_no_machine():
    for name in NOTEBOOKS:
        text = (FOLDER / name).read_text()
        assert len(text) < 200_000
        assert not any(place in text for place in ("/home/", "/tmp/", "/root", "/Users/"))
        cells = json.loads(text)["cells"]
        outputs = [output for cell in cells for output in cell.get("outputs", ())]
        assert not any(output.get("name") == "stderr" for output in outputs)
