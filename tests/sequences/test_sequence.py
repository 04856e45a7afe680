"""Frames to TUM sequences: readable by others, the same bytes in any order, nothing wraps, nothing
is mixed.
"""

import json
import shutil

import numpy as np
import pytest
from iclnuim.errors import InputError, WorkError
from iclnuim.evaluation.associate import associate
from iclnuim.formats.depth_units import count_invalid, depth16_from_metres, metres_from_depth16
from iclnuim.formats.exr import read_exr, write_exr
from iclnuim.formats.files import locked
from iclnuim.formats.png import read_rgb8, write_png
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.postprocess import frames_from
from iclnuim.sensor.models import depth_model, rgb_model
from iclnuim.sequences.associations import read_associations
from iclnuim.sequences.frame_hashes import JOURNAL
from iclnuim.sequences.frame_source import image_frames, run_frames
from iclnuim.sequences.recipe import read_recipe
from iclnuim.sequences.run_folder import open_run
from iclnuim.sequences.sequence_formats import FORMATS as SEQUENCE_FORMATS
from iclnuim.sequences.sequence_options import SequenceSettings
from iclnuim.sequences.stored_sequence import StoredSequence
from iclnuim.sequences.writer import SequenceWriter, write_sequence
from iclnuim.trajectory_files.trajectories import write_trajectory
from sequences.conftest import sloping_m

NOISY = SequenceSettings(depth_model("released"), rgb_model("released"), seed=7)
SIZE = (48, 64)


def fill(run, out, settings=NOISY, frames="::", **options):
    write_sequence(run_frames(run.path, frames), out, settings, **options)
    return out


def contents(path):
    """All files of a finished sequence."""
    return {
        str(p.relative_to(path)): p.read_bytes() for p in sorted(path.rglob("*")) if p.is_file()
    }


def test_the_same_bytes_alone_in_parts_backwards_or_at_once(run, tmp_path):
    whole = fill(run, tmp_path / "whole")
    for frames in ("3", "1::-1", "2"):
        parts = fill(run, tmp_path / "parts", frames=frames, workers=1)
    assert contents(parts) == contents(whole)
    again = fill(run, tmp_path / "again", workers=7)
    assert contents(again) == contents(whole)


def test_clean_and_noisy_together_are_those_made_apart(run, tmp_path):
    both = {tmp_path / "both/clean": SequenceSettings(), tmp_path / "both/noisy": NOISY}
    writer = SequenceWriter(run_frames(run.path), both)
    assert writer.missing == [0, 1, 2, 3]
    writer.write()
    assert contents(tmp_path / "both/clean") == contents(
        fill(run, tmp_path / "clean", SequenceSettings())
    )
    assert contents(tmp_path / "both/noisy") == contents(fill(run, tmp_path / "noisy"))


def test_another_seed_gives_other_noise_and_clean_depth_is_exact(run, tmp_path):
    cv2 = pytest.importorskip("cv2")
    noisy = fill(run, tmp_path / "noisy")
    other = fill(run, tmp_path / "other", SequenceSettings(NOISY.depth, NOISY.rgb, seed=8))
    for image in ("depth/000002.png", "rgb/000002.png"):
        assert (noisy / image).read_bytes() != (other / image).read_bytes()
    clean = fill(run, tmp_path / "clean", SequenceSettings())
    depth = cv2.imread(str(clean / "depth/000002.png"), cv2.IMREAD_UNCHANGED)
    assert depth.dtype == np.uint16
    assert np.abs(depth / 5000 - sloping_m(2)).max() <= 0.5 / 5000 + 1e-6


def test_a_run_of_0_1_0_goes_on_with_its_own_stamps(run, tmp_path):
    """i / 30 s with nine digits: nowhere are both bases mixed, and frame numbers stay right."""
    poses = run.truth().T_world_camera
    write_trajectory(run.path / "groundtruth.txt", Trajectory(np.arange(4) / 30, poses), "tum")
    out = fill(run, tmp_path / "out", formats=("tum", "icl-nuim"))
    for name in ("rgb.txt", "depth.txt", "groundtruth.txt"):
        stamps = [line.split()[0] for line in (out / "tum" / name).read_text().splitlines()[1:]]
        assert stamps == ["0.000000", "0.033333333", "0.066666667", "0.100000"]
    assert np.loadtxt(out / "icl-nuim/groundtruth.gt.freiburg")[:, 0].tolist() == [1, 2, 3]
    first = "0 depth/000000.png 0 rgb/000000.png\n1 "
    assert (out / "icl-nuim/associations.txt").read_text().startswith(first)


@pytest.mark.parametrize(
    ("key", "words"),
    [
        ("trajectory_sha256", "found other poses or stamps of the trajectory office/kt0; try"),
        ("scene_sha256", "found another version of the scene office; try"),
    ],
)
def test_a_run_of_a_changed_room_or_trajectory_is_refused_by_its_name(run, tmp_path, key, words):
    job = {**run.recipe["job"], "scene": "office", "trajectory": "office/kt0"}
    recipe = {**run.recipe, "job": job}
    open_run(tmp_path / "begun", recipe, run.truth())
    with pytest.raises(InputError, match=words):
        open_run(tmp_path / "begun", {**recipe, key: "other"}, run.truth())


def test_independent_readers_pair_every_frame(run, tmp_path):
    file_interface = pytest.importorskip("evo.tools.file_interface")
    cv2 = pytest.importorskip("cv2")
    out = fill(run, tmp_path / "out", frames="1:")
    truth = file_interface.read_tum_trajectory_file(str(out / "groundtruth.txt"))
    pairs = read_associations(out / "associations.txt")
    assert np.allclose(truth.timestamps, pairs.rgb.stamps_s) and len(pairs) == 3
    assert truth.timestamps.tolist() == [1.033333, 1.066667, 1.1]
    for rgb, depth in zip(pairs.rgb.paths, pairs.depth.paths, strict=True):
        assert cv2.imread(str(out / rgb)).shape == (48, 64, 3)
        assert cv2.imread(str(out / depth), cv2.IMREAD_UNCHANGED).shape == SIZE


def _tum_rule(first, second, most_s=0.02):
    """The association rule of the TUM benchmark: of all pairs closer than 20 ms the closest first,
    each stamp once.
    """
    close = sorted((abs(a - b), a, b) for a in first for b in second if abs(a - b) < most_s)
    pairs = []
    for _, a, b in close:
        if a in first and b in second:
            first.remove(a)
            second.remove(b)
            pairs.append((a, b))
    return sorted(pairs)


def test_the_rule_of_the_tum_benchmark_pairs_every_frame_with_its_own_depth_and_pose(run, tmp_path):
    out = fill(run, tmp_path / "out")

    def stamps(name):
        rows = [
            line.split()
            for line in (out / name).read_text().splitlines()
            if not line.startswith("#")
        ]
        return {float(row[0]): row[1:] for row in rows}

    rgb, depth, truth = (stamps(name) for name in ("rgb.txt", "depth.txt", "groundtruth.txt"))
    for other in (depth, truth):
        pairs = _tum_rule(list(rgb), list(other))
        assert len(pairs) == len(rgb) == 4
        assert all(a == pytest.approx(b, abs=1e-8) for a, b in pairs)
    assert all(
        rgb[a][0].removeprefix("rgb") == depth[b][0].removeprefix("depth")
        for a, b in _tum_rule(list(rgb), list(depth))
    )


def test_damaged_and_absent_images_are_made_again_and_whole_ones_are_not(run, tmp_path):
    out = fill(run, tmp_path / "out")
    before = contents(out)
    (out / "rgb/000001.png").write_bytes(before["rgb/000001.png"][:500])
    (out / "depth/000002.png").unlink()
    untouched = (out / "rgb/000003.png").stat().st_mtime_ns
    writer = SequenceWriter(run_frames(run.path), {out: NOISY})
    assert writer.missing == [1, 2]
    written = writer.write()[0]
    assert (written.made, written.found) == (2, 2)
    assert (out / "rgb/000003.png").stat().st_mtime_ns == untouched
    assert contents(out) == before


def test_a_journal_cut_by_a_crash_costs_one_frame(run, tmp_path):
    out = fill(run, tmp_path / "out")
    whole = contents(out)
    journal = (out / "frames.jsonl").read_bytes()
    (out / "frames.jsonl").write_bytes(journal[:-30])
    assert len(SequenceWriter(run_frames(run.path), {out: NOISY}).missing) == 1
    assert contents(fill(run, out)) == whole


def test_a_folder_of_another_recipe_or_of_other_people_is_refused(run, tmp_path):
    fill(run, tmp_path / "out")
    with pytest.raises(InputError, match="seed 7 there, 9 requested"):
        fill(run, tmp_path / "out", SequenceSettings(NOISY.depth, NOISY.rgb, seed=9))
    other = SequenceSettings(depth_model("released", {"sigma_d": 0.5}), NOISY.rgb, seed=7)
    with pytest.raises(InputError, match="depth_noise sigma_d 0.16.* there, 0.5 requested"):
        fill(run, tmp_path / "out", other)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/diary.txt").write_text("private")
    with pytest.raises(InputError, match="other files"):
        fill(run, tmp_path / "mine")
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError, match="expected an empty folder.*found a file"):
        fill(run, tmp_path / "file")


def test_the_recipe_holds_every_parameter_and_what_became_of_depth(run, tmp_path):
    channels = read_exr(run.frame_file(2))
    channels["Z"][0, :6] = [np.nan, np.inf, -np.inf, -1, 14, 0]
    write_exr(run.frame_file(2), channels)
    (run.path / JOURNAL).unlink()  # as of a run without hashes
    recipe = json.loads(
        (fill(run, tmp_path / "out", SequenceSettings()) / "recipe.json").read_text()
    )
    settings = SequenceSettings().to_dict()
    assert {key: recipe[key] for key in settings} == settings
    assert recipe["source"]["run"] == run.recipe
    assert recipe["schema_version"] == 1 and recipe["finished"] is True
    assert recipe["frames"] == {"count": 4, "first": 0, "last": 3}
    counted = {"background": 1, "nan": 1, "infinite": 2, "negative": 1, "beyond_range": 1}
    assert recipe["invalid_depth_pixels"] == {
        **counted,
        "beyond_range_after_noise": 0,
        "no_distance_after_noise": 0,
    }


def test_counts_survive_a_stop_and_a_resume(run, tmp_path):
    channels = read_exr(run.frame_file(1))
    channels["Z"][:2] = np.inf
    write_exr(run.frame_file(1), channels)
    (run.path / JOURNAL).unlink()
    fill(run, tmp_path / "out", frames=":2")
    fill(run, tmp_path / "out")
    recipe = json.loads((tmp_path / "out/recipe.json").read_text())
    assert recipe["invalid_depth_pixels"]["infinite"] == 2 * 64


def test_depth_that_does_not_fit_becomes_no_measurement_and_never_wraps():
    metres = np.array([[0.0, 13.107, 13.1072, 65.0, np.inf, np.nan, -1.0, 0.0002, 1.0]], np.float32)
    units = depth16_from_metres(metres)
    assert units.tolist() == [[0, 65535, 0, 0, 0, 0, 0, 1, 5000]]
    assert count_invalid(metres) == {
        "background": 1,
        "nan": 1,
        "infinite": 1,
        "negative": 1,
        "beyond_range": 2,
    }
    assert metres_from_depth16(units)[0, -1] == 1.0


def _spoil(run, what):
    """Make frame 2 unusable, in a run without hashes."""
    (run.path / JOURNAL).unlink()
    file = run.frame_file(2)
    data, channels = bytearray(file.read_bytes()), read_exr(file)
    if what == "truncated":
        file.write_bytes(data[: len(data) // 2])
    elif what == "foreign":
        file.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(200))
    elif what == "no Z":
        write_exr(file, {c: channels[c] for c in "RGB"})
    elif what == "half Z":
        write_exr(file, {**channels, "Z": channels["Z"].astype(np.float16)})
    elif what == "size":
        write_exr(file, {name: values[:-1] for name, values in channels.items()})
    elif what == "terabyte":
        place = data.index(b"box2i\0") + len(b"box2i\0") + 4
        data[place : place + 16] = np.array([0, 0, 999999, 999999], "<i4").tobytes()
        file.write_bytes(data)


def test_frames_that_other_threads_finished_beside_a_bad_one_are_not_made_again(run, tmp_path):
    good = run.frame_file(2).read_bytes()
    _spoil(run, "truncated")
    out = tmp_path / "out"
    with pytest.raises(InputError, match="000002.exr"):
        fill(run, out, workers=4)
    whole = {int(p.stem) for p in (out / "rgb").glob("*.png")} & {
        int(p.stem) for p in (out / "depth").glob("*.png")
    }
    run.frame_file(2).write_bytes(good)
    assert set(SequenceWriter(run_frames(run.path), {out: NOISY}).missing) == {0, 1, 2, 3} - whole
    assert contents(fill(run, out)) == contents(fill(run, tmp_path / "never stopped"))


@pytest.mark.parametrize(
    ("what", "message"),
    [
        ("truncated", "000002.exr: expected a whole EXR image, found a truncated file"),
        ("foreign", "000002.exr: expected an EXR image, found PNG"),
        ("no Z", "000002.exr: expected channels R, G, B and Z, found no Z among B, G, R"),
        ("half Z", "000002.exr: expected Z as 32-bit float"),
        ("size", "000002.exr: expected 64 x 48 as in camera.json, found 64 x 47"),
        ("terabyte", "000002.exr: expected .* a header with 1000000 x 1000000"),
    ],
)
def test_a_bad_frame_is_one_line_and_the_finished_ones_stay(run, tmp_path, what, message):
    _spoil(run, what)
    out = tmp_path / "out"
    with pytest.raises(InputError, match=message) as error:
        fill(run, out, workers=1)
    assert "\n" not in str(error.value)
    made = sorted(p.name for p in out.rglob("*.png"))
    assert made[:4] == ["000000.png"] * 2 + ["000001.png"] * 2 and "000002.png" not in made
    assert not list(out.rglob("*.tmp*"))
    run.write_frame(2, np.full((48, 64, 3), 0.5), np.full((48, 64), 2.0))
    writer = SequenceWriter(run_frames(run.path), {out: NOISY})
    assert 2 in writer.missing and not {0, 1}.intersection(writer.missing)
    writer.write()


def test_a_full_disk_is_one_line_nothing_half_written_and_the_same_command_goes_on(
    run, tmp_path, file_size_limit
):
    out = tmp_path / "out"
    with file_size_limit(3000), pytest.raises(WorkError, match="cannot write"):
        fill(run, out, workers=1)
    assert not list(out.rglob("*.tmp*"))
    assert contents(fill(run, out)) == contents(fill(run, tmp_path / "never stopped"))


def test_a_folder_that_is_no_run_is_named(run, tmp_path):
    with pytest.raises(InputError, match="expected a run with frames exr/000000.exr"):
        run_frames(tmp_path / "nowhere")
    with pytest.raises(InputError, match="at least one of the frames 0..3, found 9:"):
        run_frames(run.path, "9:")
    run.frame_file(3).rename(run.frame_file(9))
    with pytest.raises(InputError, match="frames of the 4 poses in groundtruth.txt, found frame 9"):
        run_frames(run.path)


def test_a_users_own_noise_is_seeded_named_in_the_recipe_and_checked(run, tmp_path, monkeypatch):
    (tmp_path / "noise_of_mine.py").write_text(
        "def depth(depth_z_m, camera, rng):\n    return depth_z_m + 0.1 * rng.random(depth_z_m.shape, 'float32')\n"
        "def wrong(depth_z_m, camera, rng):\n    return depth_z_m[:3]\n"
        "def lossy(depth_z_m, camera, rng):\n    return depth_z_m * [[float('nan')] * 60 + [100, -1, 1, 1]]\n"
        "def wide(light, rng):\n    return (1000 * light).astype('uint16')\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    own = SequenceSettings(depth_model("noise_of_mine:depth"), seed=3)
    out = fill(run, tmp_path / "out", own)
    assert contents(out) == contents(fill(run, tmp_path / "again", own))
    assert (
        json.loads((out / "recipe.json").read_text())["depth_noise"]["model"]
        == "noise_of_mine:depth"
    )
    with pytest.raises(
        InputError,
        match="an array .48, 64. of float from the noise noise_of_mine:wrong, found .3, 64.",
    ):
        fill(run, tmp_path / "wrong", SequenceSettings(depth_model("noise_of_mine:wrong")))
    lossy = fill(run, tmp_path / "lossy", SequenceSettings(depth_model("noise_of_mine:lossy")))
    lost = json.loads((lossy / "recipe.json").read_text())["invalid_depth_pixels"]
    assert (lost["no_distance_after_noise"], lost["beyond_range_after_noise"]) == (
        4 * 48 * 61,
        4 * 48,
    )
    with pytest.raises(
        InputError, match="an array .* of uint8 from the noise noise_of_mine:wide, found .* uint16"
    ):
        fill(run, tmp_path / "wide", SequenceSettings(rgb=rgb_model("noise_of_mine:wide")))


CAMERA = PinholeCamera.parse("64x48")
LINE = Trajectory.at_rate(SE3.exp(np.arange(4)[:, None] * [0.1, 0, 0, 0, 0, 0]))


def grey(number, level=0.2, dtype=np.float32):
    return np.full((*SIZE, 3), level, dtype), np.full(SIZE, 1.0 + number, np.float32)


def test_a_function_that_gives_other_frames_or_poses_is_refused_and_the_same_goes_on(tmp_path):
    def broken(number):
        if number == 2:
            raise RuntimeError("the simulator stopped")
        return grey(number)

    with pytest.raises(RuntimeError, match="the simulator stopped"):
        write_sequence(frames_from(CAMERA, LINE, broken), tmp_path / "a", workers=1)
    with pytest.raises(InputError, match="found another image of frame 0; try another folder"):
        write_sequence(frames_from(CAMERA, LINE, lambda n: grey(n, 0.3)), tmp_path / "a", workers=1)
    with pytest.raises(InputError, match="another"):
        write_sequence(frames_from(CAMERA, LINE[1:], grey), tmp_path / "a", workers=1)
    with pytest.raises(InputError, match="format tum there, icl-nuim requested"):
        write_sequence(frames_from(CAMERA, LINE, grey), tmp_path / "a", formats=("icl-nuim",))
    done = write_sequence(frames_from(CAMERA, LINE, grey), tmp_path / "a", workers=1)
    assert done.made + done.found == 4 and done.made < 4


@pytest.mark.parametrize("changed", [0, 3])
def test_a_function_whose_frames_changed_is_refused_and_the_finished_sequence_stays_as_it_is(
    tmp_path, changed
):
    write_sequence(frames_from(CAMERA, LINE, grey), tmp_path / "a", workers=1)
    before = contents(tmp_path / "a")
    other = frames_from(CAMERA, LINE, lambda n: grey(n, 0.3 if n == changed else 0.2))
    with pytest.raises(
        InputError, match=f"found another image of frame {changed}; try another folder"
    ):
        write_sequence(other, tmp_path / "a", workers=1)
    assert contents(tmp_path / "a") == before


def test_a_sequence_compressed_by_another_library_goes_on(tmp_path, monkeypatch):
    monkeypatch.setattr("iclnuim.formats.png.COMPRESSORS", ("zlib",))
    write_sequence(frames_from(CAMERA, LINE, grey), tmp_path / "a", workers=1)
    before = contents(tmp_path / "a")
    monkeypatch.undo()
    assert write_sequence(frames_from(CAMERA, LINE, grey), tmp_path / "a", workers=1).found == 4
    assert {k: v for k, v in contents(tmp_path / "a").items() if k.endswith(".png")} == {
        k: v for k, v in before.items() if k.endswith(".png")
    }


@pytest.mark.parametrize(
    ("images", "words"),
    [
        (lambda n: None, r"load\(0\) to return RGB and depth, found NoneType"),
        (
            lambda n: grey(n, 51, np.uint8),
            "RGB with 1 = white, as floating-point numbers, found uint8",
        ),
        (
            lambda n: (grey(n)[0], np.full(SIZE, 2000, np.uint16)),
            "depth in metres, as floating-point numbers",
        ),
        (lambda n: (grey(n)[0][:20], grey(n)[1]), "frame 0 of the camera's size"),
        (lambda n: (grey(n)[0], grey(n)[1][:20]), "frame 0 of the camera's size"),
    ],
)
def test_what_a_function_returns_is_checked(tmp_path, images, words):
    with pytest.raises(InputError, match=words):
        write_sequence(frames_from(CAMERA, LINE, images), tmp_path / "a", workers=1)


def test_images_whose_input_has_changed_are_made_again_and_no_others(run, tmp_path):
    fill(run, tmp_path / "clean", SequenceSettings())
    source = image_frames(tmp_path / "clean")
    first = write_sequence(source, tmp_path / "noisy", NOISY)
    before = contents(tmp_path / "noisy")
    assert write_sequence(source, tmp_path / "noisy", NOISY).made == 0 < first.made
    changed = tmp_path / "clean/rgb/000001.png"
    write_png(changed, 255 - read_rgb8(changed))
    assert write_sequence(image_frames(tmp_path / "clean"), tmp_path / "noisy", NOISY).made == 1
    after = contents(tmp_path / "noisy")
    differ = [name for name in after if after[name] != before[name] and name.endswith(".png")]
    assert differ == ["rgb/000001.png"]


def test_frames_that_another_process_finished_meanwhile_stay_in_the_sequence(run, tmp_path):
    first, second = (
        SequenceWriter(run_frames(run.path, part), {tmp_path / "a": NOISY}) for part in (":2", "2:")
    )
    first.write()
    second.write()
    assert contents(tmp_path / "a") == contents(fill(run, tmp_path / "whole"))


def test_a_frame_that_another_process_repaired_meanwhile_stays_in_the_lists(run, tmp_path):
    fill(run, tmp_path / "a", frames=":3")
    (tmp_path / "a/rgb/000000.png").unlink()
    first, second = (
        SequenceWriter(run_frames(run.path, part), {tmp_path / "a": NOISY}) for part in (":2", "3:")
    )
    first.write()
    second.write()
    assert contents(tmp_path / "a") == contents(fill(run, tmp_path / "whole"))


def test_frames_that_another_process_made_meanwhile_are_not_made_again(run, tmp_path):
    first, second = (
        SequenceWriter(run_frames(run.path), {tmp_path / "a": NOISY}) for _ in range(2)
    )
    first.write()
    image = (tmp_path / "a/rgb/000001.png").stat().st_mtime_ns
    second.write()
    assert (tmp_path / "a/rgb/000001.png").stat().st_mtime_ns == image
    assert contents(tmp_path / "a") == contents(fill(run, tmp_path / "whole"))


def test_two_processes_do_not_write_one_sequence(run, tmp_path):
    fill(run, tmp_path / "a", frames=":2")
    with locked(tmp_path / "a"), pytest.raises(WorkError, match="another process is writing here"):
        fill(run, tmp_path / "a")
    assert '"finished": true' in (tmp_path / "a/recipe.json").read_text()
    assert contents(fill(run, tmp_path / "a")) == contents(fill(run, tmp_path / "whole"))


def test_a_sequence_needs_a_format(run, tmp_path):
    with pytest.raises(InputError, match="at least one format"):
        fill(run, tmp_path / "a", formats=())
    assert not (tmp_path / "a").exists()


@pytest.mark.parametrize("separator", ["\u0085", "\u2028", "\f", "\v", "\x1e"])
def test_some_frames_keep_their_poses_whatever_a_comment_contains(run, tmp_path, separator):
    fill(run, tmp_path / "a", SequenceSettings())
    truth = tmp_path / "a/groundtruth.txt"
    poses = [line for line in truth.read_text().splitlines() if not line.startswith("#")]
    truth.write_text(f"# recorded{separator}by hand\n" + "\n".join(poses) + "\n")
    write_sequence(image_frames(tmp_path / "a", "2:3"), tmp_path / "b")
    assert (
        tmp_path / "b/groundtruth.txt"
    ).read_text() == f"# recorded{separator}by hand\n{poses[2]}\n"


@pytest.mark.parametrize("name", list(SEQUENCE_FORMATS))
def test_the_finished_frames_of_an_interrupted_sequence_are_read_with_poses(run, tmp_path, name):
    writer = SequenceWriter(run_frames(run.path), {tmp_path / "a": NOISY}, (name,))
    for number in (0, 1):
        writer.note(writer.make(number))
    pairs = StoredSequence(tmp_path / "a").pairs
    assert len(pairs) == 2
    truth = StoredSequence(tmp_path / "a").truth
    stamps_s = [pair.stamp_s for pair in pairs]
    posed = associate(truth.stamps_s, stamps_s).second.tolist()
    # there image 0 has no pose, as in the original
    assert posed == list(range(len(pairs)))[name == "icl-nuim" :]
    whole = fill(run, tmp_path / "whole", formats=(name,))
    assert contents(fill(run, tmp_path / "a", formats=(name,))) == contents(whole)


def test_a_sequence_begins_before_the_objects_of_its_scene_are_listed(labelled_run, tmp_path):
    raw = shutil.copytree(labelled_run, tmp_path / "raw")
    (raw / "objects.json").unlink()
    writer = SequenceWriter(run_frames(raw), {tmp_path / "a": NOISY})
    assert (tmp_path / "a/groundtruth.txt").is_file() and not (tmp_path / "a/classes.csv").exists()
    shutil.copy(labelled_run / "objects.json", raw)
    writer.write()
    assert (tmp_path / "a/classes.csv").is_file()


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({"kind": "run"}, "the recipe of a sequence, found run"),
        ({"schema_version": "1"}, "the recipe of a sequence, found sequence"),
        ({"schema_version": 2}, "a recipe of schema 1 or older, found 2"),
        ({"lens": 1}, "the keys of a sequence's recipe, found lens"),
    ],
)
def test_what_is_no_recipe_of_ours_is_refused(run, tmp_path, changed, expected):
    file = fill(run, tmp_path / "out", SequenceSettings(), frames="0") / "recipe.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | changed))
    with pytest.raises(InputError, match=expected):
        read_recipe(file)
