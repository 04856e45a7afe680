"""The extension's zip: complete, valid by Blender's own validator, the same bytes each time, and at
home in Blender.
"""

import json
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import iclnuim
import pytest
from iclnuim.headless.commands.extension import build
from patience import patience

DRIVER = Path(__file__).with_name("gui_driver_background.py")


@pytest.fixture(scope="module")
def archive(tmp_path_factory) -> Path:
    return build(tmp_path_factory.mktemp("zip"))


@pytest.fixture(scope="module")
def estimate(repository, tmp_path_factory) -> Path:
    """kt2, every pose moved by a centimetre to and fro along x."""
    lines = (repository / "trajectories/living_room/kt2.txt").read_text().splitlines()
    rows = [line.split() for line in lines if line and not line.startswith("#")]
    path = tmp_path_factory.mktemp("estimate") / "estimate.txt"
    path.write_text(
        "".join(
            f"{r[0]} {float(r[1]) + 0.01 * (-1) ** k} {' '.join(r[2:])}\n"
            for k, r in enumerate(rows)
        )
    )
    return path


@pytest.fixture(scope="module")
def driven(archive, estimate, tmp_path_factory) -> dict:
    """What gui_driver_background.py found in a clean profile, far from the checkout."""
    pytest.importorskip("bpy", reason="needs the bpy package")
    home = tmp_path_factory.mktemp("home")
    clean = {
        "PATH": "/usr/bin:/bin",
        "HOME": str(home),
        "BLENDER_USER_RESOURCES": str(home / "profile"),
    }
    done = subprocess.run(
        [sys.executable, str(DRIVER), str(archive), str(home / "out"), str(estimate)],
        capture_output=True,
        text=True,
        timeout=patience(900),
        env=clean,
        cwd=home,
    )
    line = next((line for line in done.stdout.splitlines() if line.startswith("RESULT ")), None)
    assert line, done.stdout + done.stderr
    found = json.loads(line[7:])
    assert "traceback" not in found, found["traceback"]
    return {**found, "home": home}


def test_scenes_trajectories_and_code_are_in_the_zip(archive, repository):
    names = set(zipfile.ZipFile(archive).namelist())
    scenes = {
        str(p.relative_to(repository))
        for kind in ("*.blend", "light/*/*")
        for p in (repository / "blend").glob(kind)
    }
    paths = {
        f"trajectories/{room}/kt{k}.txt" for room in ("living_room", "office") for k in range(4)
    }
    package = repository / "addon/iclnuim"
    left_out = {
        "__pycache__",
        "odometry",
        "fusion",
        "checkout.py",
        "__main__.py",
    }
    files = {p.relative_to(package) for p in package.rglob("*.py")}
    code = {str(p) for p in files if not left_out & set(p.parts)}
    assert not any(left_out & set(name.split("/")) for name in names)
    assert scenes | paths | code | {"blender_manifest.toml"} <= names
    assert scenes


def test_the_zip_is_the_same_bytes_each_time(archive, tmp_path):
    assert build(tmp_path).read_bytes() == archive.read_bytes()


def test_the_manifest_has_the_version_of_the_package(repository):
    manifest = tomllib.loads((repository / "addon/iclnuim/blender_manifest.toml").read_text())
    assert manifest["version"] == iclnuim.__version__
    assert "network" not in manifest["permissions"]


def test_blenders_own_validator_accepts_the_zip(archive):
    bpy = pytest.importorskip("bpy", reason="needs the bpy package")
    validator = Path(bpy.utils.system_resource("SCRIPTS")) / "addons_core/bl_pkg/cli/blender_ext.py"
    done = subprocess.run(
        [sys.executable, str(validator), "validate", str(archive)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_nothing_stays_behind_after_unregistering(driven):
    assert (
        driven["left_after_unregister"]
        == driven["left_at_the_end"]
        == driven["left_when_disabled"]
        == {}
    )


def test_an_older_blender_is_refused_in_one_line_and_nothing_is_registered(driven):
    assert "Blender 4.2 or newer" in driven["older_blender"] and "4.1.1" in driven["older_blender"]
    assert "\n" not in driven["older_blender"]


def test_every_button_works_without_a_window(driven):
    refused = {
        "no folder chosen",
        "no folder",
        "wrong trajectory",
        "no camera",
        "cancel",
        "another recipe",
    }
    assert {name for name, result in driven["pressed"].items() if result != "FINISHED"} == refused


def test_a_button_that_can_do_nothing_is_greyed_and_its_tooltip_says_why(driven):
    for name, reason in {
        "remove_scene": "try Show the Scene",
        "resume": "saving this file",
        "open_folder": "saving this file",
        "view": "saving this file",
        "cancel": "nothing is running",
        "evaluate": "Estimate",
        "plot": "try Evaluate first",
    }.items():
        assert reason.lower() in driven["greyed"][name].lower(), name


def test_the_page_of_the_output_shows_both_sequences_and_the_estimate(driven):
    assert driven["messages"]["view"].startswith("the page is ")
    page = driven["page"]
    assert [(one["name"], len(one["frames"])) for one in page["sequences"]] == [
        ("clean", 3),
        ("noisy", 3),
    ]
    truth, estimate = page["trajectories"]
    assert truth["is_truth"] and ", ATE " in estimate["label"]


def test_nothing_is_drawn_or_read_before_the_panel_was_used(driven):
    assert driven["not_used"] == [[], []]
    assert driven["path_before_use"] == []


def test_what_is_hidden_for_a_shown_scene_is_shown_again_when_it_is_removed(driven):
    shown, removed, again = driven["hidden"][:3]
    assert shown[:-1] == again[:-1] == ["Cube", "Light"] and shown[-1] != "World"
    assert removed == ["World"]
    assert "Cube, Light" in driven["messages"]["load_scene"]


def test_it_is_said_how_a_shown_file_was_read(driven):
    assert " up" in driven["read_as"][0] and "metre" in driven["read_as"][0]


def test_refusals_say_what_to_do(driven):
    said = driven["messages"]
    assert "choosing one as Output Folder, or saving this file" in said["no folder chosen"]
    assert "Output Folder" in said["no folder"]
    assert "trajectory" in said["wrong trajectory"]
    assert "Add > Camera" in driven["pressed"]["no camera"]
    assert "another Output Folder" in said["another recipe"]


def test_render_and_resume_leave_frames_and_sequences(driven):
    assert driven["frames"] == ["000000.exr", "000002.exr", "000004.exr"]
    kinds = {name.split("/")[0] for name in driven["sequences"]}
    assert kinds == {"clean", "noisy"} and len(driven["sequences"]) == 6


def test_the_keyed_camera_stands_where_the_pose_says(driven, repository):
    rows = (repository / "trajectories/living_room/kt2.txt").read_text().splitlines()
    pose = [line.split() for line in rows if line and not line.startswith("#")][100]
    assert driven["camera_at_100"] == pytest.approx([float(v) for v in pose[1:4]], abs=1e-6)


def test_the_path_is_saved_as_it_is_rendered(driven, repository):
    import numpy as np

    shipped = np.loadtxt(repository / "trajectories/living_room/kt2.txt")
    assert np.allclose(np.loadtxt(driven["saved_path"].splitlines()), shipped, rtol=0, atol=1e-7)


def test_a_path_through_a_wall_is_warned_of_and_one_inside_the_room_is_not(driven):
    assert driven["no_wall"] == ""
    assert "passes through a surface" in driven["wall"]


def test_evaluation_is_shown_in_words_and_as_a_picture(driven):
    assert "ATE rmse 10.000 mm" in driven["evaluation"][0]
    assert driven["images"] == ["ICL-NUIM error", "ICL-NUIM preview"]


def test_a_bad_estimate_is_explained_as_by_the_command(driven):
    assert driven["no_warning"] == []
    assert "it may be in millimetres" in driven["warnings"][0]


def test_the_panel_knows_whether_the_cache_holds_the_light_of_somebodys_own_file(driven):
    assert "not in the cache" in driven["light_before"]
    assert "is in the cache" in driven["light_after"]
    assert "not in the cache" in driven["light_counts_as_another"]
    assert (driven["home"] / "out_file/run/raw/exr/000100.exr").is_file()


def test_settings_come_back_with_the_blend_and_presets_as_they_were_saved(driven):
    assert driven["factory"] == 0
    assert driven["opened_again"] == [7, ["euroc", "tum"], "kt2"]
    assert driven["own_preset"] == [7, ["euroc", "tum"]]
    assert driven["path_of_the_opened_file"]


def test_the_open_file_with_its_camera_gives_the_same_depth_as_the_shipped_sequence(driven):
    import numpy as np
    from iclnuim.blender.render import worker
    from iclnuim.formats.exr import read_exr
    from iclnuim.geometry.camera import PinholeCamera
    from iclnuim.job import shipped_job

    own, out = driven["home"] / "out_own", driven["home"] / "same"
    camera = PinholeCamera.parse("64x48,48.120300751879697,48,31.5,23.5")
    job = shipped_job("kt2").changed(camera=camera, light="path", samples=1, denoise=False)
    with worker.Session(job, out, lambda event: None) as session:
        session.render([100], lambda: False)
    a, b = (read_exr(folder / "exr/000100.exr")["Z"] for folder in (own / "raw", out))
    assert np.abs(a - b).max() < 0.01 and np.median(np.abs(a - b)) < 1e-5


def test_nothing_is_written_outside_the_output_folder_and_the_profile(driven):
    chosen = {"out", "out_own", "out_file", "out_saved", "profile"}
    assert {p.name for p in driven["home"].iterdir()} - {"same"} <= chosen | {".cache"}
    assert not (driven["home"] / ".cache/iclnuim").exists()
