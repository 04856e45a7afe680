"""`noise calibrate` gives back the settings of each model from rendered walls, boards and an edge:
scenes of triangles, seen by Embree, recorded through the model as images of whole millimetres.
"""

import json

import numpy as np
import pytest
from iclnuim import noisy_depth
from iclnuim.formats.png import write_png
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.headless.cli import main
from iclnuim.sensor.camera_fits import LIKE
from iclnuim.sensor.models import depth_model

FRAMES = 24
#: Turned to the side and up (degrees), distance along the optical axis, width (metres), albedo.
WALLS = {
    "wall1": (20, 5, 0.8, 20, 0.95),
    "wall2": (-30, 10, 2.0, 20, 0.95),
    "wall3": (45, -10, 3.2, 40, 0.95),
    "wall4": (20, 0, 0.55, 20, 0.95),
    "wall5": (60, 5, 0.6, 40, 0.95),
    "wall6": (60, 0, 0.3, 20, 0.95),
    "wall7": (55, 10, 1.6, 30, 0.3),
    "wall8": (70, 0, 1.5, 30, 0.02),
}
BOARD_M = 0.4
OF_D435 = {"baseline_m", "subpixel_px", "window_px", "search_px", "pattern_range_m"}
OF_D435 |= {"fat_px", "ragged_px"}
OF_AZURE = {"base_m", "noise_m", "power", "wiggle_m", "near_m", "dark_range_m", "amplitude_noise"}
OF_PHONE = {"dots", "sigma_m", "sigma_per_m"}
CASES = [
    ("d435", {}, OF_D435),
    (
        "d435",
        {
            "subpixel_px": 0.15,
            "window_px": 13.0,
            "baseline_m": 0.055,
            "fat_px": 3.0,
            "ragged_px": 0.7,
        },
        OF_D435,
    ),
    ("azure_kinect", {}, OF_AZURE),
    (
        "azure_kinect",
        {"noise_m": 0.0015, "power": 1.0, "wiggle_m": 0.004, "amplitude_noise": 0.15},
        OF_AZURE,
    ),
    ("phone", {}, OF_PHONE),
    ("phone", {"dots": 20, "sigma_m": 0.006, "sigma_per_m": 0.003}, OF_PHONE),
]


def rectangle(turned_deg, up_deg, distance_m, width_m, tilted_deg=0.0):
    """Corners (4, 3) of a square before the camera (x right, y down, z forward)."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_euler("yxz", [turned_deg, up_deg, tilted_deg], degrees=True)
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * width_m / 2
    return turn.apply(corners) + [0, 0, distance_m]


def rendered(camera, *rectangles):
    """Planar depth (h, w), by a ray through every pixel."""
    caster = pytest.importorskip("iclnuim.raycast.caster", reason="needs embreex")
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    triangles = np.concatenate([faces + 4 * k for k in range(len(rectangles))])
    surface = caster.RayCaster(np.concatenate(rectangles), triangles)
    return surface.depth(camera, np.eye(4)).astype(np.float32)


def record(folder, camera, model, settings, walls):
    """Images of walls and of a board before a wall, as `noise calibrate` takes them."""
    scenes = {
        name: (rendered(camera, rectangle(*wall[:4])), wall[4]) for name, wall in walls.items()
    }
    board = rectangle(0, 0, 1.0, BOARD_M, tilted_deg=4), rectangle(0, 0, 2.0, 20)
    scenes["board1"] = rendered(camera, *board), 0.9
    for number, (name, (depth_z_m, albedo)) in enumerate(scenes.items()):
        (folder / name).mkdir(parents=True)
        for frame in range(FRAMES):
            noisy_m = noisy_depth(depth_z_m, model, camera, number, frame, settings, albedo=albedo)
            millimetres = np.rint(1000 * noisy_m).astype(np.uint16)
            write_png(folder / name / f"{frame}.png", millimetres)
    albedos = [f"{name} {wall[4]}" for name, wall in walls.items()]
    (folder / "walls.txt").write_text("\n".join(albedos))
    (folder / "boards.txt").write_text(f"board1 {BOARD_M}")
    described = camera.to_dict() | {"depth_units_per_metre": 1000}
    (folder / "camera.json").write_text(json.dumps(described))


@pytest.mark.slow
@pytest.mark.parametrize("model, settings, determined", CASES)
def test_each_setting_that_is_determined_is_within_5_percent(
    tmp_path, capsys, model, settings, determined
):
    camera = PinholeCamera(424, 240, 424.0, 424.0, 211.5, 119.5)
    record(tmp_path, camera, model, settings, WALLS)
    assert main(["noise", "calibrate", str(tmp_path), "--json"]) == 0
    best = json.loads(capsys.readouterr().out)["cameras"][0]
    assert best["model"] == model and best["misfit"] < LIKE
    assert set(best["settings"]) == determined
    truth = depth_model(model, settings).to_dict()
    for name, value in best["settings"].items():
        assert value == pytest.approx(truth[name], rel=0.05), name
