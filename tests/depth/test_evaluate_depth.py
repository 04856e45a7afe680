"""`iclnuim evaluate depth` and depth_errors: every way to store a prediction, groups, masks, doubts,
tables and pictures.
"""

import csv
import io
import json

import cv2
import numpy as np
import pytest
from iclnuim import (
    DepthErrorSettings,
    depth_error,
    depth_errors,
    frames_from,
    make_sequence,
    open_sequence,
)
from iclnuim.channels import CHANNELS
from iclnuim.errors import InputError
from iclnuim.formats.exr import write_exr
from iclnuim.formats.png import read_png, write_png
from iclnuim.sequences.sequence_formats import FORMATS

SCALE = DepthErrorSettings(align="scale")


def depths_m(truth):
    return [frame.depth_z_m for frame in open_sequence(truth)]


def as_npy(path, depth_m):
    np.save(path.with_suffix(".npy"), depth_m)


def as_npz(path, depth_m):
    np.savez_compressed(path.with_suffix(".npz"), depth=depth_m, conf=np.ones(3))


def as_png(path, depth_m):
    write_png(path.with_suffix(".png"), np.rint(5000 * depth_m).astype(np.uint16))


def as_exr(path, depth_m):
    write_exr(path.with_suffix(".exr"), {"Y": depth_m.astype(np.float32)})


def as_tiff(path, depth_m):
    cv2.imwrite(str(path.with_suffix(".tiff")), depth_m.astype(np.float32))


def as_tiff16(path, depth_m):
    cv2.imwrite(str(path.with_suffix(".tif")), np.rint(5000 * depth_m).astype(np.uint16))


WRITERS = [as_npy, as_npz, as_png, as_exr, as_tiff, as_tiff16]
NAMES = [
    "{n:06}",
    "depth/{n:06}",
    "{n:06}/depth",
    "frame_{n}_pred",
]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("write", WRITERS)
def test_exact_depth_is_exact_in_every_ending_and_place(truth, tmp_path, write, name):
    for n, depth_m in enumerate(depths_m(truth)):
        path = tmp_path / name.format(n=n)
        path.parent.mkdir(parents=True, exist_ok=True)
        write(path, depth_m)
    found = depth_errors(tmp_path, truth)
    assert found.errors.abs_rel < 1e-7 and found.errors.delta1 == 1 and not found.missing
    assert len(found.errors.frames) == 4 and found.doubts == ()


@pytest.mark.parametrize("format", FORMATS)
def test_the_depth_of_a_sequence_in_every_format_is_its_own_best_prediction(
    labelled_formats, truth, tmp_path, format
):
    for row, depth_m in enumerate(depths_m(truth)):
        pair = open_sequence(labelled_formats / format).pairs[row]
        np.save(tmp_path / f"{pair.rgb.stem}.npy", depth_m)
    assert depth_errors(tmp_path, labelled_formats / format).errors.abs_rel < 2e-4


@pytest.mark.parametrize("name", ["results.npz", "predictions.npz", "all.npy", "channels.npy"])
def test_one_array_for_all_frames_is_read(truth, tmp_path, name):
    stack = np.stack(depths_m(truth)) / 3
    if name == "all.npy":
        np.save(tmp_path / name, stack)
    elif name.endswith(".npy"):
        np.save(tmp_path / name, stack[..., None])
    else:
        np.savez(tmp_path / name, depth=stack[..., None], extrinsics=np.zeros((4, 3, 4)))
    for place in (tmp_path, tmp_path / name):
        found = depth_errors(place, truth, SCALE)
        assert found.errors.scale == pytest.approx(3, rel=1e-6) and found.errors.abs_rel < 1e-6


def test_a_mask_beside_the_depth_makes_pixels_missing(truth, tmp_path):
    for n, depth_m in enumerate(depths_m(truth)):
        mask = np.ones(depth_m.shape, bool)
        mask[:12] = False
        np.savez(tmp_path / f"{n:06}.npz", depth=depth_m, mask=mask)
    assert depth_errors(tmp_path, truth).errors.missing == 0.25


def test_units_are_those_of_the_folder_then_of_the_sequence(truth, tmp_path):
    for n, depth_m in enumerate(depths_m(truth)):
        write_png(tmp_path / f"{n:06}.png", np.rint(1000 * depth_m).astype(np.uint16))
    assert depth_errors(tmp_path, truth).errors.abs_rel == pytest.approx(0.8, abs=1e-3)
    assert depth_errors(tmp_path, truth, units_per_metre=1000).errors.abs_rel < 1e-3
    camera = json.loads((truth / "camera.json").read_text()) | {"depth_units_per_metre": 1000}
    (tmp_path / "camera.json").write_text(json.dumps(camera))
    assert depth_errors(tmp_path, truth).errors.abs_rel < 1e-3


def test_groups_are_those_of_the_ground_truth(truth, predicted):
    folder = predicted(lambda depth_m, row: depth_m * (1.1 if row == 0 else 1.2))
    found = depth_errors(folder, truth, by=["class", "distance", "angle"]).errors
    sequence = open_sequence(truth)
    pixels = {"sofa": 0, "wall": 0}
    of_rays = {}
    for row, frame in enumerate(sequence):
        classes = cv2.imread(str(truth / f"class/{row:06}.png"), cv2.IMREAD_UNCHANGED)
        pixels["sofa"] += int((classes == 9).sum())
        pixels["wall"] += int((classes == 1).sum())
        normal = CHANNELS["normal"].decode(read_png(truth / f"normal/{row:06}.png"), 1.0)
        rays = sequence.camera.rays()
        cosine = -(normal * rays).sum(-1) / np.linalg.norm(rays, axis=-1)
        degrees = np.degrees(np.arccos(cosine[frame.depth_z_m > 0]))
        for low in range(0, 90, 15):
            count = int(((degrees > low) & (degrees <= low + 15)).sum())
            of_rays[f"{low}-{low + 15} deg"] = of_rays.get(f"{low}-{low + 15} deg", 0) + count
    by_class = {group.name: group for group in found.groups["class"]}
    assert {name: by_class[name].pixels for name in pixels} == pixels
    assert {g.name: g.pixels for g in found.groups["angle"]} == {
        k: n for k, n in of_rays.items() if n
    }
    total = sum(group.pixels for group in found.groups["distance"])
    assert total == found.pixels
    mean = sum(g.pixels * g.figures.abs_rel for g in found.groups["distance"]) / total
    assert mean == pytest.approx(
        depth_errors(folder, truth, DepthErrorSettings(pool="pixels")).errors.abs_rel
    )


def test_classes_and_objects_choose_the_pixels_that_count(truth, predicted):
    folder = predicted()
    whole = depth_errors(folder, truth).errors.pixels
    sofas = depth_errors(folder, truth, only=["sofa"]).errors.pixels
    one = depth_errors(folder, truth, only=["sofa_3"]).errors.pixels
    other = depth_errors(folder, truth, only=["sofa_4"]).errors.pixels
    assert 0 < one < sofas == one + other < whole
    assert depth_errors(folder, truth, without=["sofa"]).errors.pixels == whole - sofas
    with pytest.raises(InputError, match="a class or an object of the sequence.*found chair"):
        depth_errors(folder, truth, only=["chair"])


def test_ground_truth_that_is_not_there_is_named(all_formats, predicted):
    for by in ("class", "angle"):
        with pytest.raises(InputError, match="made with"):
            depth_errors(predicted(name=by), all_formats / "tum", by=[by])


RAYS = np.linalg.norm(
    np.stack(np.meshgrid((np.arange(64) - 31.5) / 48, (np.arange(48) - 23.5) / 48), -1), axis=-1
)
NOISE = np.exp(np.random.default_rng(0).normal(0, 0.02, (48, 64)))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d, row: 1000 * d * NOISE, "it seems to be in millimetres"),
        (lambda d, row: d * NOISE / 0.3048, "it seems to be in feet"),
        (lambda d, row: 0.2 * d * NOISE, "its scale seems to be unknown"),
        (lambda d, row: NOISE / d, "it seems to be an inverse depth"),
        (lambda d, row: d * NOISE * np.hypot(1, RAYS), "the distance along the ray"),
        (lambda d, row: d * NOISE, ""),
        (lambda d, row: 1.02 * d * NOISE, ""),
        (lambda d, row: d * NOISE**5, ""),
        (lambda d, row: 1.15 * d * NOISE, ""),
        (lambda d, row: 5 * np.median(d) * NOISE, "unknown"),
    ],
)
def test_what_a_prediction_seems_to_be_is_named(truth, predicted, change, words):
    found = depth_errors(predicted(change), truth).doubts
    assert len(found) == bool(words) and (not words or words in found[0])


def test_an_alignment_leaves_nothing_to_name_but_what_it_cannot_align(truth, predicted):
    settings = DepthErrorSettings(align="affine")
    for name, change, words in (
        ("shifted", lambda d, row: 2 * d * NOISE + 5, ""),
        ("ray", lambda d, row: 2 * d * NOISE * np.hypot(1, RAYS), "the distance along the ray"),
        ("inverse", lambda d, row: NOISE / d, "it seems to be an inverse depth"),
    ):
        found = depth_errors(predicted(change, name), truth, settings).doubts
        assert len(found) == bool(words) and (not words or words in found[0]), name


def test_depth_given_as_its_inverse_is_named(truth, predicted):
    settings = DepthErrorSettings(align="scale", quantity="inverse-depth")
    assert "it seems to be depth" in depth_errors(predicted(), truth, settings).doubts[0]


def test_numbers_of_other_frames_are_named(truth, predicted):
    folder = predicted()
    for row in reversed(range(4)):
        (folder / f"{row:06}.npy").rename(folder / f"{row + 1}.npy")
    with pytest.raises(
        InputError, match="numbers 1 to 4 in 4 files; try the frames' numbers, 0 to 3"
    ):
        depth_errors(folder, truth)


def test_predictions_of_the_next_frames_are_named(tmp_path):
    """A step in depth that moves by three pixels a frame."""
    rng = np.random.default_rng(1)
    u = np.arange(64)
    depth_m = [np.tile(np.where((u + 3 * k) % 32 < 16, 2.0, 3.0), (48, 1)) for k in range(10)]
    poses = np.tile(np.eye(4), (10, 1, 1))
    poses[:, 0, 3] = 0.05 * np.arange(10)

    def load(k):
        return np.zeros((48, 64, 3)), depth_m[k]

    source = frames_from("64x48,60,60,32,24", poses, load)
    make_sequence(source, tmp_path / "truth")
    for shift, words in ((1, "the frames 1 after theirs"), (0, "")):
        folder = tmp_path / f"by {shift}"
        folder.mkdir()
        for row in range(10):
            noisy = depth_m[min(row + shift, 9)] * np.exp(rng.normal(0, 0.002, (48, 64)))
            np.save(folder / f"{row:06}.npy", noisy)
        found = depth_errors(folder, tmp_path / "truth", SCALE).doubts
        assert len(found) == bool(words) and (not words or words in found[0])


def test_frames_without_a_prediction_are_left_out_and_named(truth, predicted):
    folder = predicted()
    (folder / "000002.npy").unlink()
    found = depth_errors(folder, truth)
    assert found.missing == ("000002",) and len(found.errors.frames) == 3


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda f: (f / "000001.npy").write_bytes(b"\x93NUMPY"), "000001.npy: .*a damaged header"),
        (lambda f: np.save(f / "000001.npy", np.ones((48, 64), "i4")), "000001.npy: .*found int32"),
        (lambda f: np.save(f / "000001.npy", np.array([{}])), "000001.npy: "),
        (lambda f: np.save(f / "000001.npy", np.ones((24, 32))), "a prediction of 64 x 48"),
        (lambda f: np.save(f / "000001.npy", np.ones((5, 48, 64))), "5 of them"),
        (lambda f: as_png(f / "000001", np.ones((48, 64))), "one file of a frame"),
    ],
)
def test_a_file_that_cannot_be_compared_is_named(truth, predicted, spoil, words):
    folder = predicted()
    spoil(folder)
    with pytest.raises(InputError, match=words) as error:
        depth_errors(folder, truth)
    assert "\n" not in str(error.value)


def test_pictures_of_depth_are_refused(truth, tmp_path):
    for n, depth_m in enumerate(depths_m(truth)):
        grey = (50 * depth_m).astype(np.uint8)
        write_png(tmp_path / f"{n:06}.png", np.stack([grey] * 3, -1))
    with pytest.raises(InputError, match="8 bits, a picture to look at"):
        depth_errors(tmp_path, truth)


def test_the_command_compares_methods(command_here, truth, predicted, tmp_path):
    a = predicted(lambda d, row: d * NOISE, "sharp")
    b = predicted(lambda d, row: 0.5 * d * NOISE**4, "soft")
    out = [tmp_path / name for name in ("a.csv", "a.png", "b.png")]
    words = ["evaluate", "depth", a, b, "--truth", truth, "--align", "scale", "--by", "distance"]
    words += ["--csv", out[0], "--plot", out[1], "--picture", out[2], "--frame", "2"]
    code, text, notes = command_here(*words)
    assert code == 0 and text.splitlines()[0].split()[:2] == ["AbsRel", "SqRel"]
    assert text.splitlines()[1].startswith("sharp") and "soft by distance" in text
    rows = list(csv.DictReader(io.StringIO(out[0].read_text())))
    assert len(rows) == 8 and {row["method"] for row in rows} == {"sharp", "soft"}
    for path in out[1:]:
        assert cv2.imread(str(path)).shape[0] > 100
    code, text, _ = command_here(*words[:10], "--json")
    values = json.loads(text)
    true_m = np.stack(depths_m(truth))
    expected = depth_error(true_m, true_m * NOISE, "scale")
    assert values["methods"][0]["abs_rel"] == pytest.approx(expected.abs_rel, rel=1e-6)
    assert values["methods"][1]["scale"] == pytest.approx(2, rel=0.05)
    assert float(rows[0]["abs_rel"]) == pytest.approx(expected.frames[0].figures.abs_rel, rel=1e-6)


def test_the_command_names_options_and_doubts(command_here, truth, predicted):
    folder = predicted(lambda d, row: 0.5 * d)
    code, _, notes = command_here("evaluate", "depth", folder, "--truth", truth)
    assert code == 0 and "try --align scale" in notes
    words = ["evaluate", "depth", folder, "--truth", truth, "--quantity", "disparity"]
    code, _, notes = command_here(*words)
    assert code == 2 and "--disparity-factor" in notes and notes.count("\n") == 1


def test_a_picture_does_not_replace_an_image_of_the_sequence(command_here, truth, predicted):
    image = truth / "rgb/000000.png"
    before = image.read_bytes()
    words = ["evaluate", "depth", predicted(), "--truth", truth, "--picture", image]
    code, _, said = command_here(*words)
    assert code == 2 and "--picture" in said and image.read_bytes() == before
