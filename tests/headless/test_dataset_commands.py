"""The commands dataset, noise, inspect and pack as a user types them; postprocess as a script calls
it.
"""

import json

import numpy as np
import pytest
from iclnuim import postprocess
from iclnuim.formats.files import read_json, write_json
from iclnuim.formats.png import read_depth16, write_png
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.headless.cli import main
from iclnuim.sequences.frame_source import image_frames
from iclnuim.sequences.run_folder import open_run, read_run


@pytest.fixture
def raw(tmp_path):
    """Three frames, 64 x 48."""
    camera = {"width": 64, "height": 48, "fx": 48.0, "fy": 48.0, "cx": 31.5, "cy": 23.5}
    recipe = {
        "job": {"camera": camera},
        "trajectory_sha256": "a",
        "scene_sha256": "b",
        "blender": "none",
    }
    run = open_run(
        tmp_path / "raw",
        recipe,
        Trajectory.at_rate(SE3.exp(np.random.default_rng(1).normal(0, 0.001, (3, 6)))),
    )
    v, u = np.mgrid[0:48, 0:64]
    for number in range(3):
        run.write_frame(
            number, np.stack([u / 64, v / 48, (u + v) / 112], -1), 1.0 + v / 30 + u / 100
        )
    return run.path


def test_dataset_reports_as_json_goes_on_and_refuses_in_one_line(raw, tmp_path, capsys):
    command = [
        "dataset",
        str(raw),
        str(tmp_path / "out"),
        "--depth-noise",
        "paper",
        "--rgb-noise",
        "paper",
        "--json",
    ]
    assert main([*command, "--quiet"]) == 0
    assert json.loads(capsys.readouterr().out)["frames_written"] == 3
    assert main([*command, "--quiet"]) == 0
    assert json.loads(capsys.readouterr().out)["frames_already_written"] == 3
    assert main([*command, "--seed", "5"]) == 2
    error = capsys.readouterr().err.strip()
    assert "seed 0 there, 5 requested" in error and "\n" not in error
    assert main(["dataset", str(tmp_path / "nowhere"), str(tmp_path / "x")]) == 2
    assert (
        main(
            [
                *command[:2],
                str(tmp_path / "y"),
                "--depth-noise",
                "paper",
                "--depth-settings",
                '{"a": 1}',
            ]
        )
        == 2
    )
    assert "settings of the noise model 'paper'" in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["depth", "rgb"])
@pytest.mark.parametrize(
    "text", ["[" * 100_000, "9" * 5000, "NaN", "{"], ids=["nested", "digits", "nan", "half"]
)
def test_noise_settings_that_are_not_json_are_refused_in_one_line(
    kind, text, raw, tmp_path, capsys
):
    assert (
        main(
            [
                "dataset",
                str(raw),
                str(tmp_path / "out"),
                f"--{kind}-noise",
                "paper",
                f"--{kind}-settings",
                text,
            ]
        )
        == 2
    )
    assert "expected noise settings in JSON, found" in capsys.readouterr().err


@pytest.mark.parametrize("job", ["x", None, 3, []])
def test_a_recipe_whose_job_is_no_object_is_refused(job, raw, tmp_path, capsys):
    write_json(raw / "sequence.json", {"job": job})
    assert main(["dataset", str(raw), str(tmp_path / "out")]) == 2
    assert (
        "raw/sequence.json: expected the recipe of a run, with its job" in capsys.readouterr().err
    )


def test_a_frame_that_is_named_by_no_decimal_number_is_left_out(raw, tmp_path, capsys):
    for name in ("\u00b2\u00b3", "0\u00b2"):
        (raw / f"exr/{name}.exr").write_bytes(b"")
    assert main(["dataset", str(raw), str(tmp_path / "out"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["frames_written"] == 3
    assert read_run(raw).frame_numbers() == [0, 1, 2]


def test_frames_that_start_with_a_minus_are_refused_with_the_way_to_write_them(
    raw, tmp_path, capsys
):
    with pytest.raises(SystemExit, match="2"):
        main(["dataset", str(raw), "--frames", "-3:", str(tmp_path / "out")])
    assert capsys.readouterr().err.endswith(
        "argument --frames: expected one argument; try --frames=-3:\n"
    )
    with pytest.raises(SystemExit, match="2"):
        main(["dataset", str(raw), "-o", "x.txt", str(tmp_path / "out"), "--frames"])
    assert capsys.readouterr().err.endswith(
        "argument --frames: expected one argument; try iclnuim dataset --help\n"
    )


def test_an_image_that_is_a_loop_of_links_is_one_line(raw, tmp_path, capsys):
    out = tmp_path / "sequence"
    assert main(["dataset", str(raw), str(out)]) == 0
    (out / "rgb/000001.png").unlink()
    (out / "rgb/000001.png").symlink_to("000001.png")
    (tmp_path / "loop").symlink_to("loop")
    capsys.readouterr()
    assert main(["inspect", str(out)]) == 0
    assert "do not exist: 000001.png" in capsys.readouterr().out
    assert main(["convert", str(out), str(tmp_path / "other")]) == 0
    assert "1 images are missing, the first rgb/000001.png" in capsys.readouterr().err
    assert main(["pack", str(tmp_path / "loop")]) == 2
    assert "loop: expected a sequence" in capsys.readouterr().err


@pytest.mark.parametrize(
    "change", [{"fx": -1.0}, {"depth_units_per_metre": 0}, {"depth_units_per_metre": "x"}]
)
def test_a_value_of_the_camera_that_is_wrong_names_its_file(change, raw, tmp_path, capsys):
    out = tmp_path / "sequence"
    assert main(["dataset", str(raw), str(out)]) == 0
    write_json(out / "camera.json", {**read_json(out / "camera.json"), **change})
    assert main(["noise", str(out), str(tmp_path / "noisy"), "--depth-noise", "paper"]) == 2
    assert f"{out / 'camera.json'}: " in capsys.readouterr().err


def test_depth_in_millimetres_is_said_beside_the_images_and_read_back_in_metres(
    raw, tmp_path, capsys
):
    out = tmp_path / "out"
    assert main(["dataset", str(raw), str(out), "--depth-units", "1000", "--quiet"]) == 0
    millimetres = read_depth16(out / "depth/000001.png")
    v, u = np.mgrid[0:48, 0:64]
    assert np.abs(millimetres - 1000 * (1.0 + v / 30 + u / 100)).max() <= 0.5
    assert json.loads((out / "camera.json").read_text())["depth_units_per_metre"] == 1000
    _, depth_z_m = image_frames(out).load(1)
    np.testing.assert_allclose(depth_z_m, millimetres / 1000, rtol=1e-6)
    assert (
        main(
            [
                "dataset",
                str(raw),
                str(tmp_path / "x"),
                "--depth-units",
                "1000",
                "--format",
                "icl-nuim",
            ]
        )
        == 2
    )
    assert "5000 depth units per metre" in capsys.readouterr().err
    assert main(["dataset", str(raw), str(tmp_path / "y"), "--depth-units", "nan"]) == 2


def test_bags_come_with_it(raw, tmp_path, capsys):
    pytest.importorskip("rosbags")
    command = ["dataset", str(raw), str(tmp_path / "out"), "--rosbag", "--quiet", "--compress-bags"]
    assert main([*command, "--bag-storage", "mcap"]) == 0 and main(command) == 0
    assert {"out.bag", "out_ros2"} <= {p.name for p in tmp_path.iterdir()}
    assert (tmp_path / "out_ros2/out_ros2.mcap").is_file()


def test_noise_goes_on_a_sequence_of_png_and_inspect_finds_it_sound(raw, tmp_path, capsys):
    clean, noisy = str(tmp_path / "clean"), str(tmp_path / "noisy")
    assert main(["dataset", str(raw), clean, "--quiet"]) == 0
    assert (
        main(
            [
                "noise",
                clean,
                noisy,
                "--depth-noise",
                "kinect2012",
                "--rgb-noise",
                "released",
                "--quiet",
            ]
        )
        == 0
    )
    assert main(["inspect", noisy, "--json"]) == 0
    out = capsys.readouterr().out
    found = json.loads(out[out.index('{\n  "folder": ') :])
    assert found["errors"] == [] and found["figures"]["pairs"] == 3
    (tmp_path / "noisy/rgb/000001.png").write_bytes(b"")
    assert main(["inspect", noisy]) == 2
    assert "ERROR: " in capsys.readouterr().out
    assert main(["noise", clean, str(tmp_path / "x")]) == 2
    assert "expected a noise" in capsys.readouterr().err


RGB_STAMPS = ("1305031102.175304", "1305031102.211214", "1305031102.243211")
DEPTH_STAMPS = ("1305031102.160407", "1305031102.226738", "1305031102.262886")
TRUTH = """# ground truth trajectory
# timestamp tx ty tz qx qy qz qw
1305031098.6659 1.3563 0.6305 1.6380 0.6132 0.5962 -0.3311 -0.3986
1305031102.1758 1.3405 0.6266 1.6575 0.6574 0.6126 -0.2949 -0.3248
1305031102.2758 1.30 .6256 1.6565 0.6579 0.6161 -0.2933 -0.3189
"""


@pytest.fixture
def freiburg(raw, tmp_path):
    """Laid out as the sequences of the TUM benchmark: names are stamps, those of depth are others."""
    own = tmp_path / "fr1"
    for kind, stamps in (("rgb", RGB_STAMPS), ("depth", DEPTH_STAMPS)):
        (own / kind).mkdir(parents=True)
        lines = [f"{stamp} {kind}/{stamp}.png" for stamp in stamps]
        (own / f"{kind}.txt").write_text(
            "# file: 'rgbd.bag'\n# timestamp filename\n" + "\n".join(lines) + "\n"
        )
    for number, names in enumerate(zip(RGB_STAMPS, DEPTH_STAMPS, strict=True)):
        write_png(own / f"rgb/{names[0]}.png", np.full((48, 64, 3), 60 * number + 40, np.uint8))
        write_png(own / f"depth/{names[1]}.png", np.full((48, 64), 9000 + number, np.uint16))
    (own / "groundtruth.txt").write_text(TRUTH)
    return own


def data(file):
    return [line for line in file.read_text().splitlines() if not line.startswith("#")]


@pytest.mark.parametrize("associated", [False, True])
def test_noise_keeps_the_names_and_stamps_of_a_sequence_to_the_character(
    freiburg, tmp_path, capsys, associated
):
    pairs = [
        f"{a} rgb/{a}.png {b} depth/{b}.png" for a, b in zip(RGB_STAMPS, DEPTH_STAMPS, strict=True)
    ]
    if associated:
        (freiburg / "associations.txt").write_text("\n".join(pairs) + "\n")
    out, camera = tmp_path / "out", ["--camera", "64x48", "--units", "5000"]
    assert (
        main(["noise", str(freiburg), str(out), "--depth-noise", "paper", *camera, "--quiet"]) == 0
    )
    for name in ("rgb.txt", "depth.txt", "groundtruth.txt"):
        assert data(out / name) == data(freiburg / name)
    assert data(out / "associations.txt") == pairs
    assert (out / "groundtruth.txt").read_text() == TRUTH
    for kind in ("rgb", "depth"):
        assert sorted(p.name for p in (out / kind).iterdir()) == sorted(
            p.name for p in (freiburg / kind).iterdir()
        )
    assert "Camera.fps: 29\n" in (out / "orb_slam3.yaml").read_text()
    assert list(image_frames(out).stamps_s.values()) == [float(stamp) for stamp in RGB_STAMPS]


def test_noise_on_some_frames_lists_those_and_other_formats_have_names_of_their_own(
    freiburg, tmp_path, capsys
):
    camera = ["--camera", "64x48", "--depth-noise", "paper", "--quiet"]
    assert main(["noise", str(freiburg), str(tmp_path / "part"), "--frames", "1:", *camera]) == 0
    assert data(tmp_path / "part/depth.txt") == data(freiburg / "depth.txt")[1:]
    both = ["--format", "tum", "--format", "euroc"]
    assert main(["noise", str(freiburg), str(tmp_path / "both"), *camera, *both]) == 0
    assert (tmp_path / f"both/tum/depth/{DEPTH_STAMPS[0]}.png").is_file()
    assert (tmp_path / "both/euroc/mav0/cam0/data/1305031102175304000.png").is_file()


@pytest.mark.parametrize(
    ("options", "is_said"),
    [
        (("--units", "1000"), True),
        (("--units", "5000"), False),
        (("--units", "1000", "--depth-units", "5000"), False),
        (("--units", "1000", "--format", "vslam-lab"), False),
    ],
)
def test_convert_says_that_depth_keeps_units_that_readers_of_tum_do_not_expect(
    freiburg, tmp_path, command_here, options, is_said
):
    camera = ("--camera", "64x48,48,48,31.5,23.5")
    code, _, notes = command_here("convert", freiburg, tmp_path / "a", *camera, *options)
    assert code == 0 and ("keeps its 1000 units" in notes and "expect 5000" in notes) == is_said


@pytest.mark.parametrize("command", [("convert",), ("noise", "--rgb-noise", "paper")])
def test_images_of_another_size_are_refused_before_anything_is_written(
    freiburg, tmp_path, command_here, command
):
    camera = ("--camera", "32x24,48,48,15.5,11.5")
    code, _, said = command_here(command[0], freiburg, tmp_path / "a", *camera, *command[1:])
    assert code == 2 and "with the size of the images" in said
    assert "frames to write" not in said and not (tmp_path / "a").exists()


@pytest.mark.parametrize("through", ["tum", "eth3d", "rtabmap", "euroc", "vslam-lab"])
def test_convert_keeps_stamps_to_the_character_through_every_format_that_has_them(
    freiburg, tmp_path, capsys, through
):
    camera = ["--camera", "64x48,48,48,31.5,23.5"]
    assert main(["convert", str(freiburg), str(tmp_path / "a"), "--format", through, *camera]) == 0
    assert (
        main(["convert", str(tmp_path / "a"), str(tmp_path / "b"), "--format", "tum", "--quiet"])
        == 0
    )
    stamps = [line.split()[0] for line in data(tmp_path / "b/rgb.txt")]
    assert stamps == list(RGB_STAMPS)
    if through not in (
        "euroc",
        "rtabmap",
    ):  # one stamp for both images of a pair, or in the name of both
        assert [line.split()[0] for line in data(tmp_path / "b/depth.txt")] == list(DEPTH_STAMPS)
    if through in ("tum", "eth3d", "rtabmap"):
        assert (tmp_path / "b/groundtruth.txt").read_text() == TRUTH
    if through == "rtabmap":
        assert sorted(p.name for p in (tmp_path / "a/rgb_sync").iterdir()) == [
            f"{stamp}.png" for stamp in RGB_STAMPS
        ]
    for number in range(3):  # files that are stored alike are copied
        one, other = (
            sorted(folder.glob("rgb*/*"))[number] for folder in (freiburg, tmp_path / "b")
        )
        assert one.read_bytes() == other.read_bytes()


def test_convert_notes_what_a_format_does_not_hold(freiburg, tmp_path, capsys):
    camera = ["--camera", "64x48,48,48,31.5,23.5"]
    longer = {f"{stamp} ": f"{stamp}1234 " for stamp in RGB_STAMPS}
    text = (freiburg / "rgb.txt").read_text()
    for old, new in longer.items():
        text = text.replace(old, new)
    (freiburg / "rgb.txt").write_text(text)
    everything = [word for name in ("euroc", "scannet", "tartanair") for word in ("--format", name)]
    assert main(["convert", str(freiburg), str(tmp_path / "a"), *everything, *camera]) == 0
    said = capsys.readouterr().err
    assert (
        "euroc: stamps have 9 digits after the decimal point, those of the source up to 10" in said
    )
    assert (
        "scannet: this format has no stamps" in said and "scannet: colour is stored as JPEG" in said
    )
    assert "scannet: depth is stored in 1000 units per metre; the source has 5000" in said
    assert "tartanair: its programs support only the camera 640x480,320,320,319.5,239.5" in said


def test_convert_notes_what_rtabmap_takes_for_granted(freiburg, tmp_path, capsys):
    stamps = ("0.000000", "0.033333", "0.066667")
    rows = zip(stamps, RGB_STAMPS, DEPTH_STAMPS, strict=True)
    (freiburg / "associations.txt").write_text(
        "".join(f"{t} rgb/{a}.png {t} depth/{b}.png\n" for t, a, b in rows)
    )
    (freiburg / "groundtruth.txt").unlink()
    camera = ["--camera", "64x48,48,48,31.5,23.5", "--units", "10000"]
    assert (
        main(["convert", str(freiburg), str(tmp_path / "a"), "--format", "rtabmap", *camera]) == 0
    )
    said = capsys.readouterr().err
    assert (
        "rtabmap: its programs treat a stamp of 0 as missing, and fail; the stamps are not changed"
        in said
    )
    assert "rtabmap: depth is stored in 5000 units per metre; the source has 10000" in said
    depth = sorted((tmp_path / "a/depth_sync").iterdir())[0]
    assert depth.name == "0000000000.000000.png" and (read_depth16(depth) == 4500).all()


def test_some_frames_carry_only_their_own_poses(freiburg, tmp_path, capsys):
    dense = [f"{1305031102.0 + i / 200:.4f} {i / 1000} 0 0 0 0 0 1" for i in range(80)]
    (freiburg / "groundtruth.txt").write_text("# mocap\n" + "\n".join(dense) + "\n")
    camera = ["--camera", "64x48,48,48,31.5,23.5", "--quiet"]
    assert main(["convert", str(freiburg), str(tmp_path / "a"), "--frames", "1:2", *camera]) == 0
    kept = (tmp_path / "a/groundtruth.txt").read_text().splitlines()
    assert kept[0] == "# mocap" and set(kept[1:]) < set(dense)
    assert (
        all(abs(float(line.split()[0]) - float(RGB_STAMPS[1])) < 0.02 for line in kept[1:])
        and len(kept) > 5
    )
    # frames without a pose are left out where every frame needs one
    (freiburg / "groundtruth.txt").write_text("\n".join(dense[30:45]) + "\n")
    assert (
        main(["convert", str(freiburg), str(tmp_path / "b"), "--format", "replica", *camera[:2]])
        == 0
    )
    assert "replica: 1 of 3 frames have no pose and are left out: 2" in capsys.readouterr().err
    assert (
        len(data(tmp_path / "b/traj.txt")) == len(list((tmp_path / "b/results").glob("*.jpg"))) == 2
    )
    (freiburg / "groundtruth.txt").unlink()
    assert (
        main(["convert", str(freiburg), str(tmp_path / "c"), "--format", "replica", *camera[:2]])
        == 2
    )
    assert (
        "a pose for every frame for the format replica, found no ground truth"
        in capsys.readouterr().err
    )


def test_the_originals_poses_keep_every_character_in_their_own_format(raw, tmp_path, capsys):
    own = tmp_path / "own"
    assert main(["dataset", str(raw), str(own), "--format", "icl-nuim", "--quiet"]) == 0
    poses = "1 0 0 -2.25 0 0 0 1\n2 0.0004725 0.0089707 -2.2506 -0.00101357 0.000506464 -0.000268899 0.999999\n"
    (own / "groundtruth.gt.freiburg").unlink()
    (own / "traj9.gt.freiburg").write_text(poses)
    command = [
        "noise",
        str(own),
        str(tmp_path / "out"),
        "--depth-noise",
        "paper",
        "--camera",
        "64x48",
        "--quiet",
    ]
    assert main([*command, "--format", "icl-nuim"]) == 0
    assert (tmp_path / "out/groundtruth.gt.freiburg").read_text() == poses
    assert (tmp_path / "out/associations.txt").read_text() == (own / "associations.txt").read_text()


def test_names_that_could_not_stand_in_another_folder_are_replaced(freiburg, tmp_path, capsys):
    lines = [
        f"{a} rgb/{a}.png {b} ../fr1/depth/{b}.png"
        for a, b in zip(RGB_STAMPS, DEPTH_STAMPS, strict=True)
    ]
    (freiburg / "associations.txt").write_text("\n".join(lines))
    command = [
        "noise",
        str(freiburg),
        str(tmp_path / "deep/out"),
        "--camera",
        "64x48",
        "--rgb-noise",
        "paper",
    ]
    assert main([*command, "--quiet"]) == 0
    assert sorted(p.name for p in (tmp_path / "deep/out/depth").iterdir()) == [
        f"00000{n}.png" for n in range(3)
    ]


def test_calibrate_prints_settings_that_the_other_commands_take(tmp_path, capsys):
    wall = np.tile(
        np.linspace(0.45, 0.5, 64, dtype=np.float32), (48, 1)
    )  # 1 / depth, linear on a plane
    (tmp_path / "sensor/depth").mkdir(parents=True)
    for frame in range(20):
        noisy = postprocess.noisy_depth(
            1 / wall, "paper", seed=1, frame=frame, settings={"lateral": False}
        )
        write_png(tmp_path / f"sensor/depth/{frame}.png", np.rint(noisy * 5000).astype(np.uint16))
    assert main(["noise", "calibrate", str(tmp_path / "sensor"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["depth"]
    assert found["frames"] == 20 and found["fixed_sigma_s"]
    assert found["sigma_d"] == pytest.approx(1 / 6, rel=0.05)
    assert main(["noise", "calibrate", str(tmp_path / "sensor")]) == 0
    settings = capsys.readouterr().out.split("--depth-settings '")[1].split("'")[0]
    assert set(json.loads(settings)) == {"sigma_d", "sigma_s_px"}
    for file in sorted(
        (tmp_path / "sensor/depth").iterdir()
    ):  # millimetres, which only camera.json says
        noisy = postprocess.noisy_depth(
            1 / wall, "paper", seed=1, frame=int(file.stem), settings={"lateral": False}
        )
        write_png(file, np.rint(noisy * 1000).astype(np.uint16))
    camera = {
        "width": 64,
        "height": 48,
        "fx": 48.0,
        "fy": 48.0,
        "cx": 31.5,
        "cy": 23.5,
        "depth_units_per_metre": 1000,
    }
    (tmp_path / "sensor/camera.json").write_text(json.dumps(camera))
    assert main(["noise", "calibrate", str(tmp_path / "sensor"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["depth"]["sigma_d"] == pytest.approx(1 / 6, rel=0.1)
    assert main(["noise", "calibrate", str(tmp_path)]) == 2


def test_calibrate_says_which_camera_a_recording_resembles(tmp_path, capsys):
    camera = "160x120,131,131,79.5,59.5"
    u = np.arange(160) / 160
    for name, near, far in (("wall1", 1 / 0.9, 1 / 1.2), ("wall2", 1 / 2, 1 / 3)):
        depth_z_m = np.tile(1 / (near + (far - near) * u), (120, 1)).astype(np.float32)
        (tmp_path / name).mkdir()
        for frame in range(8):
            noisy = postprocess.noisy_depth(
                depth_z_m, "d435", frame=frame, camera=camera, albedo=0.5
            )
            millimetres = np.rint(noisy * 1000).astype(np.uint16)
            write_png(tmp_path / name / f"{frame}.png", millimetres)
    (tmp_path / "walls.txt").write_text("wall1 0.5\nwall2 0.5\n")
    words = ["noise", "calibrate", str(tmp_path), "--units", "1000"]
    assert main([*words, "--camera", camera, "--json"]) == 0
    best, *others = json.loads(capsys.readouterr().out)["cameras"]
    assert best["model"] == "d435" and best["misfit"] < min(fit["misfit"] for fit in others)
    assert best["settings"]["subpixel_px"] == pytest.approx(0.08, rel=0.1)
    assert main([*words, "--camera", camera]) == 0
    settings = capsys.readouterr().out.split("--depth-noise d435 --depth-settings '")[1]
    postprocess.noisy_depth(
        depth_z_m, "d435", settings=json.loads(settings.split("'")[0]), camera=camera, albedo=0.5
    )
    assert main(words) == 0
    assert "are not fitted without the camera" in capsys.readouterr().err
    assert main([*words[:-1], "0"]) == 2
    assert "depth units per metre, found 0" in capsys.readouterr().err
    assert main([*words, "--camera", "80x60"]) == 2
    assert "expected images of the camera's size 80x60, found (160, 120)" in capsys.readouterr().err
    (tmp_path / "wall2").rename(tmp_path / "board1")  # a wall is no board before one
    (tmp_path / "walls.txt").write_text("wall1 0.5\n")
    assert main([*words, "--camera", camera]) == 2
    assert "boards.txt" in capsys.readouterr().err
    for text in ("# board width\n", "board1 wide\n", "wall1 0.4\n"):
        (tmp_path / "boards.txt").write_text(text)
        assert main([*words, "--camera", camera]) == 2
        assert "expected lines `board1 0.4` for each board" in capsys.readouterr().err
    (tmp_path / "boards.txt").write_text("board1 0.4\n")
    assert main([*words, "--camera", camera]) == 0
    heard = capsys.readouterr()
    assert "board1 is not used: expected a board clearly before a wall" in heard.err
    assert "not determined by these recordings" in heard.out and "fat_px" in heard.out
    (tmp_path / "walls.txt").write_text("wall3 0.5\n")
    assert main([*words, "--camera", camera]) == 2
    assert "walls.txt:1: expected lines `wall1 0.95`" in capsys.readouterr().err


def test_calibrate_reads_an_exposure_series_and_gives_back_its_noise(tmp_path, capsys):
    scene = np.geomspace(0.004, 1.0, 160 * 120).reshape(120, 160, 1) * np.array([1.0, 0.8, 0.6])
    lines = ["# exposure image"]
    for k, exposure in enumerate((0.25, 0.5, 1.0, 2.0, 4.0)):
        for repeat in range(6):
            image = postprocess.noisy_rgb(
                scene,
                "paper",
                frame=10 * k + repeat,
                settings={"exposure": exposure, "sigma_c": 0.003, "sigma_s": 0.02},
            )
            write_png(tmp_path / f"{k}_{repeat}.png", image)
            lines.append(f"{exposure} {k}_{repeat}.png")
    (tmp_path / "exposures.txt").write_text("\n".join(lines))
    assert main(["noise", "calibrate", str(tmp_path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["rgb"]
    assert found["response"] == "srgb"
    assert [found["sigma_c"], found["sigma_s"]] == pytest.approx([0.003, 0.02], rel=0.05)
    (tmp_path / "exposures.txt").write_text("inf 0_0.png\n1 1_0.png\n")
    assert main(["noise", "calibrate", str(tmp_path)]) == 2
    assert (
        "exposures.txt: expected two or more exposures, finite and > 0" in capsys.readouterr().err
    )


def test_a_preview_has_a_column_of_errors_only_with_poses_and_pack(raw, tmp_path, capsys):
    cv2 = pytest.importorskip("cv2")
    out = tmp_path / "sequence"
    assert main(["dataset", str(raw), str(out), "--depth-noise", "released", "--quiet"]) == 0
    assert main(["inspect", str(out), "--preview", str(tmp_path / "pictures"), "--quiet"]) == 0
    sheet = cv2.imread(str(tmp_path / "pictures/preview.png"))
    assert sheet.shape == (28 + 3 * 24, 3 * 32, 3) and sheet.std() > 20  # captions, three rows
    film = next((tmp_path / "pictures").glob("preview.[mg]*"))
    for file in out.glob("groundtruth.txt"):
        file.unlink()
    assert main(["inspect", str(out), "--preview", str(tmp_path / "unposed"), "--quiet"]) == 0
    assert cv2.imread(str(tmp_path / "unposed/preview.png")).shape == (28 + 3 * 24, 2 * 32, 3)
    assert cv2.VideoCapture(str(film)).read()[1].shape == (24, 64, 3)
    assert main(["pack", str(out), "--licence", "CC0-1.0", "--quiet"]) == 0
    assert (tmp_path / "sequence.tar.gz").is_file()
    assert main(["pack", str(raw)]) == 2


def test_postprocess_is_the_commands_without_the_command_line(raw, tmp_path):
    written = postprocess.make_sequence(raw, tmp_path / "a", "released", "released", seed=2)
    assert written.made == 3
    main(
        [
            "dataset",
            str(raw),
            str(tmp_path / "b"),
            "--depth-noise",
            "released",
            "--rgb-noise",
            "released",
            "--seed",
            "2",
        ]
    )
    for image in ("rgb/000001.png", "depth/000002.png"):
        assert (tmp_path / "a" / image).read_bytes() == (tmp_path / "b" / image).read_bytes()
    clean = postprocess.make_sequence(raw, tmp_path / "clean").folders[0]
    depth = read_depth16(clean / "depth/000000.png") / np.float32(5000)
    assert postprocess.noisy_depth(depth).shape == (48, 64)
    assert postprocess.noisy_rgb(np.full((48, 64, 3), 0.5)).dtype == np.uint8
    truth = clean / "groundtruth.txt"
    assert postprocess.absolute_trajectory_error(truth, truth).translation_m.rmse == pytest.approx(
        0, abs=1e-9
    )


def test_a_users_own_noise_lies_in_the_working_folder(raw, tmp_path, monkeypatch, capsys):
    (tmp_path / "dust_of_test.py").write_text(
        "def specks(depth_z_m, camera, rng):\n    return depth_z_m * (rng.random(depth_z_m.shape) > 0.1)\n"
    )
    monkeypatch.chdir(tmp_path)
    assert (
        main(["dataset", str(raw), "out", "--depth-noise", "dust_of_test:specks", "--quiet"]) == 0
    )
    depth = read_depth16(tmp_path / "out/depth/000000.png")
    assert 0.07 < (depth == 0).mean() < 0.13
    assert (
        main(["dataset", str(raw), "out2", "--depth-noise", "dust_of_test:absent", "--quiet"]) == 2
    )
    assert "a function absent in the module dust_of_test" in capsys.readouterr().err
