"""The view of a sequence that a system is given, its settings files, and its own file's mistakes."""

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from iclnuim.benchmark.systems.staging import StagedSequence
from iclnuim.benchmark.systems.system import built_in, read_system
from iclnuim.formats.png import read_depth16
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.headless import cli
from iclnuim.sequences.associations import read_image_list
from iclnuim.sequences.slam_settings import SLAM_SETTINGS


def staged(tmp_path):
    return next(tmp_path.glob("out/cells/*/*/stage"))


def lines(file):
    return file.read_text().splitlines()


def test_images_are_links_by_number_beside_tums_lists_without_the_ground_truth(
    run, fake, sequence, tmp_path
):
    run(fake("good"), "--stage-only")
    stage = staged(tmp_path)
    assert sorted(path.name for path in stage.iterdir()) == [
        "associations.txt",
        "depth",
        "depth.txt",
        "rgb",
        "rgb.txt",
    ]
    assert (
        lines(stage / "associations.txt")[1] == "1.033333 rgb/000001.png 1.033333 depth/000001.png"
    )
    assert (stage / "rgb/000059.png").readlink() == sequence / "rgb.png"
    assert read_image_list(stage / "depth.txt").paths[0] == "depth/000000.png"


def test_images_by_stamp_depth_first_in_other_units(run, fake, tmp_path):
    stage = '[stage]\nnames = "stamp"\nrgb = "rgb_sync"\ndepth = "depth_sync"\norder = "depth-first"\ndepth_units = 5000'
    run(fake("good", stage), "--stage-only", "--first", "3")
    stage = staged(tmp_path)
    assert (
        lines(stage / "associations.txt")[2]
        == "1.066667 depth_sync/1.066667.png 1.066667 rgb_sync/1.066667.png"
    )
    assert not (stage / "depth_sync/1.000000.png").is_symlink()
    assert (read_depth16(stage / "depth_sync/1.000000.png") == 5000).all()


def test_depth_that_is_no_png_is_written_as_one(run, fake, sequence, tmp_path):
    assert (
        cli.main(
            [
                "convert",
                str(sequence),
                str(tmp_path / "kt2/air"),
                "--format",
                "tartanair",
                "--quiet",
            ]
        )
        == 0
    )
    run(fake("good"), "--stage-only", "--first", "2", folder=tmp_path / "kt2/air")
    stage = staged(tmp_path)
    units = read_depth16(stage / "depth/000001.png")
    assert (
        (stage / "rgb/000001.png").is_symlink()
        and (units == units[0, 0]).all()
        and units[0, 0] in (1000, 5000)
    )


def test_placeholders_stand_for_camera_rate_units_and_files(run, fake, tmp_path):
    words = (
        "width",
        "height",
        "fx",
        "fy",
        "cx",
        "cy",
        "units",
        "rate",
        "frames",
        "settings",
        "associations",
        "mode",
    )
    tables = (
        '[options]\nmode = "fast"\n[stage]\nsettings = "orb_slam2"\nsettings_file = "camera.yaml"'
    )
    system = fake("good", tables, arguments=[f"{{{word}}}" for word in words])
    run(system, "--set", "mode=slow")
    found = json.loads(next(tmp_path.glob("out/cells/good/*/run_1/out/arguments.json")).read_text())
    assert found[:7] == ["8", "6", "7.5", "7.25", "3.5", "2.5", "1000.0"] and float(
        found[7]
    ) == pytest.approx(30, abs=0.01)
    assert found[8] == "60" and found[9].endswith("/stage/camera.yaml") and found[11] == "slow"
    assert "Camera.fy: 7.25\n" in (staged(tmp_path) / "camera.yaml").read_text()


@pytest.mark.parametrize("kind", ["orb_slam3", "orb_slam2", "stella_vslam", "camera_info"])
def test_settings_files_hold_the_camera_as_their_readers_see_it(run, fake, tmp_path, kind):
    cv2 = pytest.importorskip("cv2")
    run(fake("good", f'[stage]\nsettings = "{kind}"'), "--stage-only")
    file = staged(tmp_path) / "settings.yaml"
    if kind == "stella_vslam":  # no OpenCV file: YAML of its own
        text = [line.strip() for line in lines(file)]
        assert "fx: 7.5" in text and "depthmap_factor: 1000.0" in text and "cols: 8" in text
        return
    read = cv2.FileStorage(str(file), cv2.FILE_STORAGE_READ)
    if kind == "camera_info":
        data = read.getNode("camera_matrix").getNode("data")
        K = np.array([data.at(i).real() for i in range(9)]).reshape(3, 3)
        np.testing.assert_array_equal(K, [[7.5, 0, 3.5], [0, 7.25, 2.5], [0, 0, 1]])
        return
    prefix, units = (
        ("Camera1", "RGBD.DepthMapFactor") if kind == "orb_slam3" else ("Camera", "DepthMapFactor")
    )
    assert [read.getNode(f"{prefix}.{name}").real() for name in ("fx", "fy", "cx", "cy")] == [
        7.5,
        7.25,
        3.5,
        2.5,
    ]
    assert read.getNode(units).real() == 1000 and read.getNode("Camera.fps").real() == 30


@pytest.mark.parametrize(
    "camera", [PinholeCamera(), PinholeCamera(320, 240, 320 / 1.33, 240, 159.5, 119.5)]
)
def test_points_are_near_up_to_the_distance_of_orb_slams_own_tum_files(camera):
    """bf 40 and ThDepth 40 at 640 columns: 1600 / 481.2 = 3.325 m, at any resolution."""
    three, two = (SLAM_SETTINGS[kind](camera, 30, 5000) for kind in ("orb_slam3", "orb_slam2"))
    value = {
        key: float(number)
        for key, number in re.findall(r"^(Stereo\.b|Stereo\.ThDepth): (\S+)$", three, re.M)
    }
    assert value["Stereo.b"] * value["Stereo.ThDepth"] == pytest.approx(3.325, abs=1e-4)
    old = {
        key: float(number)
        for key, number in re.findall(r"^(Camera\.bf|ThDepth): (\S+)$", two, re.M)
    }
    assert old["Camera.bf"] * old["ThDepth"] / camera.fx == pytest.approx(3.325, abs=1e-4)


@pytest.mark.parametrize("name", built_in())
def test_every_system_in_the_box_is_described_and_on_the_page(name, repository):
    system = read_system(
        name, {"vocabulary": "v.txt"} if name in ("orbslam2", "orbslam3", "stella_vslam") else {}
    )
    values = dict.fromkeys(
        ("stage", "out", "settings", "associations", "units", "rate", "fx", "fy", "cx", "cy"), "x"
    )
    command = system.filled(system.settings.command, {**values, "width": 8, "height": 6})
    assert not any("{" in word for word in command)
    assert f"`{name}`" in (repository / "docs/guide/systems.md").read_text()


@pytest.mark.parametrize(
    ("change", "options", "code", "said"),
    [
        (("about", "abuot"), (), 2, "found abuot"),
        (('file = "final.txt"', "file = 3"), (), 2, "found 3"),
        (("[trajectories", "[trajectory"), (), 2, "found trajectory"),
        (("{stage}", "{stag}"), (), 2, "found {stag}"),
        (("about =", "about"), (), 2, "expected TOML"),
        (("command =", '[options]\nvocabulary = ""\n[x]\ncommand ='), (), 2, "expected"),
        (
            ("program = ", "program = 'no_such_program' #"),
            (),
            3,
            "needs the program no_such_program; try asking",
        ),
        (("about =", 'check = ["false"]\nabout ='), (), 3, "cannot run with"),
        ((), ("--set", "speed=3"), 2, "expected options program, found speed"),
        ((), ("--set", "speed"), 2, "--set: expected NAME=VALUE"),
    ],
)
def test_a_mistake_is_one_line(run, fake, change, options, code, said):
    path = fake("good", 'install = "asking the authors"')
    path.write_text(path.read_text().replace(*change) if change else path.read_text())
    _, err = run(path, *options, code=code)
    assert said in err and err.startswith("iclnuim run: ") and len(err.splitlines()) == 1


def test_a_missing_option_and_an_unknown_system_are_named(run):
    assert (
        "expected a value for vocabulary, found none; try --set vocabulary=VALUE"
        in run("orbslam3", code=2)[1]
    )
    assert "orbslam3" in run("orb", code=2)[1]


def test_a_command_may_name_its_program_itself(run, fake, tmp_path):
    path = fake("good")
    text = (
        path.read_text().replace('"{program}"', '"{here}/python"').replace("program =", "title =")
    )
    path.write_text(text)
    (tmp_path / "python").symlink_to(sys.executable)
    rows, _ = run(path)
    assert rows[sys.executable]["coverage"] == 1


def test_users_add_their_own_by_folder(run, fake, monkeypatch, tmp_path):
    fake("good").rename(tmp_path / "mine.toml")
    monkeypatch.setenv("ICLNUIM_SYSTEMS", str(tmp_path))
    assert run("mine")[0]["mine"]["coverage"] == 1


def test_a_packed_file_among_the_options_is_unpacked_once(run, fake, tmp_path):
    import lzma

    (tmp_path / "words.txt.xz").write_bytes(lzma.compress(b"a vocabulary"))
    system = fake("good", '[options]\nvocabulary = ""', arguments=["{vocabulary}"])
    run(system, "--vocabulary", tmp_path / "words.txt.xz")
    (given,) = json.loads(
        next(tmp_path.glob("out/cells/good/*/run_1/out/arguments.json")).read_text()
    )
    assert Path(given).read_text() == "a vocabulary" and given.endswith("out/options/words.txt")


def test_sequences_of_two_rooms_are_told_apart_by_their_recipes(make_sequence, tmp_path):
    names = []
    for room in ("living_room", "office"):
        folder = make_sequence(tmp_path / room / "kt2/clean")
        recipe = {"source": {"run": {"job": {"sequence": f"{room}/kt2"}}}}
        (folder / "recipe.json").write_text(json.dumps(recipe))
        names.append(StagedSequence.of(folder).name)
    (folder / "recipe.json").write_text('{"source": []}')
    assert [*names, StagedSequence.of(folder).name] == [
        "living_room/kt2/clean",
        "office/kt2/clean",
        "kt2/clean",
    ]


def test_a_dry_run_says_how_long_the_runs_last_and_runs_nothing(fake, sequence, tmp_path, capsys):
    words = ["run", fake("good"), sequence, "-o", tmp_path / "out", "--runs", "3", "--dry-run"]
    assert cli.main([str(word) for word in words]) == 0
    out = capsys.readouterr().out
    assert out.startswith("3 runs of") and "60 frames, in real time: about 6 s" in out
    assert not list(tmp_path.rglob("results.json"))
