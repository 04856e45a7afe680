"""`iclnuim compare`: bytes on one kind of processor, tolerance across kinds, and it says which and
why.
"""

import json

import numpy as np
import pytest
from iclnuim.formats.files import write_json
from iclnuim.formats.png import write_png
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.headless.cli import main
from iclnuim.job import shipped_job
from iclnuim.sequences.run_folder import load_trajectory, open_run

RNG = np.random.default_rng(5)
RGB, Z_M = RNG.uniform(0, 1, (30, 40, 3)), RNG.uniform(1, 4, (30, 40))


@pytest.fixture
def run(tmp_path):
    def make(name, rgb=RGB, depth_z_m=Z_M, features=("avx2",), numbers=(0, 1)):
        job = shipped_job("kt2").changed(camera=PinholeCamera.parse("40x30"))
        recipe = {"job": job.to_dict(), "blender": "4.5", "machine": {"features": list(features)}}
        run = open_run(tmp_path / name, recipe, load_trajectory(job))
        for number in numbers:
            run.write_frame(number, rgb, depth_z_m)
        return str(run.path)

    return make


def told(capsys, *arguments):
    code = main(["compare", *arguments, "--json"])
    return code, json.loads(capsys.readouterr().out)


def test_equal_frames_of_one_kind_are_equal_to_the_byte(run, capsys):
    code, values = told(capsys, run("a"), run("b"))
    assert code == 0 and values["same"] and values["by_bytes"] and values["images"] == 2


def test_one_rounding_is_a_difference_on_one_kind_of_processor_and_none_across_kinds(run, capsys):
    a, b = run("a"), run("b", depth_z_m=Z_M + 1e-5)
    code, values = told(capsys, a, b)
    assert code == 3 and list(values["different"]) == ["exr/000000.exr", "exr/000001.exr"]
    code, values = told(capsys, a, run("c", depth_z_m=Z_M + 1e-5, features=("avx2", "avx512f")))
    assert (
        code == 0
        and not values["by_bytes"]
        and values["reason"] == "processor features: avx2 and avx2 avx512f"
    )
    assert told(capsys, a, b, "--tolerance")[0] == 0


@pytest.mark.parametrize("change", [{"depth_z_m": Z_M + 0.002}, {"rgb": RGB * 0.9}])
def test_more_than_the_tolerance_is_a_difference_across_kinds_too(run, capsys, change):
    code, values = told(capsys, run("a"), run("b", features=("sse4_2",), **change))
    assert code == 3 and len(values["different"]) == 2 and values["largest_share"] > 0.5


def test_a_frame_that_only_one_has_is_named(run, capsys):
    code, values = told(capsys, run("a"), run("b", numbers=(0,)))
    assert code == 3 and values["only_in_one"] == ["exr/000001.exr"]


def test_a_folder_without_recipe_is_bad_input(run, tmp_path, capsys):
    assert main(["compare", run("a"), str(tmp_path)]) == 2
    assert "expected a run (sequence.json) or a sequence" in capsys.readouterr().err


def test_the_channels_that_differ_are_named(run, capsys):
    a, b = run("a"), run("b", depth_z_m=Z_M + 1e-5)
    assert told(capsys, a, b)[1]["different"] == {"exr/000000.exr": ["Z"], "exr/000001.exr": ["Z"]}
    assert main(["compare", a, b]) == 3
    lines = capsys.readouterr().out.splitlines()
    assert lines[1:] == ["  2 differ: exr/000000.exr (Z), exr/000001.exr (Z)"]
    assert told(capsys, a, run("c", rgb=RGB * 0.9, features=("sse",)))[1]["different"][
        "exr/000000.exr"
    ] == ["RGB"]
    tinted = told(capsys, a, run("d", rgb=RGB + [0, 0.2, 0]))[1]
    assert tinted["different"]["exr/000001.exr"] == ["G"]


@pytest.mark.parametrize(("units", "same"), [(1000.0, False), (5000.0, True)])
def test_depth_is_compared_in_metres_whatever_its_units(tmp_path, capsys, units, same):
    """Four units apart: 4 mm at 1000 a metre, 0.8 mm at 5000."""
    for name, value in (("a", 2000), ("b", 2004)):
        folder = tmp_path / name
        (folder / "depth").mkdir(parents=True)
        write_json(folder / "recipe.json", {"source": {"run": {"blender": "4.5"}}})
        write_json(
            folder / "camera.json",
            {**PinholeCamera.parse("8x6").to_dict(), "depth_units_per_metre": units},
        )
        write_png(folder / "depth/000000.png", np.full((6, 8), value, np.uint16))
    code, values = told(capsys, str(tmp_path / "a"), str(tmp_path / "b"), "--tolerance")
    assert values["same"] == same and code == (0 if same else 3)
    assert values["different"] == ({} if same else {"depth/000000.png": ["depth"]})


def test_sequences_with_instances_and_normals_are_compared_by_tolerance_too(tmp_path, capsys):
    normal = np.zeros((6, 8, 3), np.uint16) + np.array([32768, 32768, 65535], np.uint16)
    for name, label in (("a", 3), ("b", 4)):
        for kind, image in (("instance", np.full((6, 8), label, np.uint16)), ("normal", normal)):
            (tmp_path / name / kind).mkdir(parents=True)
            write_png(tmp_path / name / kind / "000000.png", image)
        write_json(tmp_path / name / "recipe.json", {})
        write_json(tmp_path / name / "camera.json", PinholeCamera.parse("8x6").to_dict())
    values = told(capsys, str(tmp_path / "a"), str(tmp_path / "b"), "--tolerance")[1]
    assert values["different"] == {"instance/000000.png": ["instance"]}


def test_equal_pixels_compressed_in_another_way_are_equal(tmp_path, capsys, monkeypatch):
    depth = np.tile(np.arange(40, dtype=np.uint16), (30, 1))
    for name, compressor in (("a", "deflate"), ("b", "zlib"), ("c", "zlib")):
        (tmp_path / name / "depth").mkdir(parents=True)
        write_json(tmp_path / name / "recipe.json", {})
        write_json(tmp_path / name / "camera.json", PinholeCamera.parse("40x30").to_dict())
        monkeypatch.setattr("iclnuim.formats.png.COMPRESSORS", (compressor,))
        write_png(tmp_path / name / "depth/000000.png", depth + (name == "c"))
    a, b, c = (str(tmp_path / name) for name in "abc")
    code, values = told(capsys, a, b)
    assert code == 0 and values["by_bytes"] and values["same"]
    assert (tmp_path / "a/depth/000000.png").read_bytes() != (
        tmp_path / "b/depth/000000.png"
    ).read_bytes()
    assert told(capsys, a, c)[1]["different"] == {"depth/000000.png": ["depth"]}
