"""Label images against a sequence's classes and instances: found by name or number in any form,
read by a table of classes, refused in one line.
"""

import json
import shutil
import struct
import tarfile
import zlib

import numpy as np
import pytest
from iclnuim import label_errors, read_class_map
from iclnuim.errors import InputError
from iclnuim.formats.png import chunk, read_depth16, write_png
from iclnuim.labels.classes import BUILT_IN, class_map
from iclnuim.labels.frames import label_frames, read_ids, true_classes
from iclnuim.labels.images import read_label_image
from iclnuim.sequences.frame_source import run_frames
from iclnuim.sequences.sequence_formats import FORMATS
from iclnuim.sequences.writer import write_sequence


def png(path, pixels, bits, colour, palette=None, extra=()):
    """A PNG of any kind: rows of packed samples without a filter."""
    height, width = pixels.shape[:2]
    samples = pixels.reshape(height, -1)
    if bits == 16:
        rows = samples.astype(">u2").view(np.uint8).reshape(height, -1)
    elif bits == 8:
        rows = samples.astype(np.uint8)
    else:
        bit = (samples[..., None] >> np.arange(bits - 1, -1, -1)) & 1
        rows = np.packbits(bit.reshape(height, -1).astype(np.uint8), axis=1)
    data = zlib.compress(b"".join(b"\0" + row.tobytes() for row in rows))
    header = struct.pack(">IIBBBBB", width, height, bits, colour, 0, 0, 0)
    parts = [b"\x89PNG\r\n\x1a\n", *chunk(b"IHDR", header)]
    if palette is not None:
        parts += chunk(b"PLTE", np.asarray(palette, np.uint8).tobytes())
    for kind, content in extra:
        parts += chunk(kind, content)
    parts += [*chunk(b"IDAT", data), *chunk(b"IEND", b"")]
    path.write_bytes(b"".join(parts))


@pytest.fixture(scope="module")
def truth(labelled_formats):
    return labelled_formats / "tum"


def predicted(truth, out, change=lambda ids: ids):
    """A copy of the class images, changed."""
    out.mkdir()
    for frame in label_frames(truth):
        write_png(out / frame.classes.name, change(read_ids(frame.classes)).astype(np.uint16))
    return out


@pytest.mark.parametrize("name", FORMATS)
def test_a_sequence_is_its_own_perfect_prediction_in_every_format(labelled_formats, name):
    found = label_errors(labelled_formats / name, labelled_formats / name)
    values = found.to_dict()
    assert values["frames"] == 4 and not found.missing and not found.unknown
    for figure in ("mean_iou", "mean_iou_per_frame", "pixel_accuracy", "panoptic_quality"):
        assert values[figure] == 1


@pytest.mark.parametrize("name", FORMATS)
def test_predictions_are_found_by_the_names_of_the_truth_or_by_numbers(
    labelled_formats, name, tmp_path
):
    sequence = labelled_formats / name
    out = predicted(sequence, tmp_path / "out")
    assert label_errors(out, sequence).to_dict()["mean_iou"] == 1
    for number, image in enumerate(sorted(out.iterdir())):
        image.rename(out / f"semantic_class_{number}.png")
    assert label_errors(out, sequence).to_dict()["mean_iou"] == 1


def test_frames_without_an_image_are_named_and_numbers_of_other_frames_refused(truth, tmp_path):
    out = predicted(truth, tmp_path / "out")
    (out / "000001.png").unlink()
    found = label_errors(out, truth)
    assert found.missing == ("000001",) and found.to_dict()["frames"] == 3
    for number in (0, 2, 3):
        (out / f"00000{number}.png").rename(out / f"label_{number + 2}.png")
    with pytest.raises(InputError, match="named as the frames, such as 000000.png, found numbers"):
        label_errors(out, truth)
    shutil.copy(out / "label_2.png", out / "other_2.png")
    with pytest.raises(InputError, match="found label_2.png and other_2.png"):
        label_errors(out, truth)


def test_labels_in_another_numbering_are_read_by_its_table(truth, tmp_path):
    listed = true_classes(truth)
    for name in BUILT_IN[1:]:
        table = class_map(name, listed)
        ids = np.zeros(1 << 16, int)
        for kind in listed.classes:
            index = table.of_truth(kind)
            ids[kind.id] = table.classes[index - 1].id if index else 0
        found = label_errors(
            predicted(truth, tmp_path / name, lambda own, ids=ids: ids[own]), truth, name
        )
        assert found.figures.mean_iou == 1 and found.figures.unlabelled == 0
        assert dict(found.without).keys() == {"backdrop"}


def test_every_kind_of_png_is_read(tmp_path):
    rng = np.random.default_rng(0)
    path = tmp_path / "a.png"
    for bits in (1, 2, 4, 8, 16):
        ids = rng.integers(0, 1 << bits, (5, 7))
        png(path, ids, bits, 0)
        assert np.array_equal(read_label_image(path).ids, ids)
        if bits < 16:
            palette = rng.integers(0, 256, (1 << bits, 3))
            png(path, ids, bits, 3, palette, [(b"tRNS", b"\0")])
            image = read_label_image(path)
            assert np.array_equal(image.ids, ids)
            assert np.array_equal(image.colours, palette[ids])
    for bits in (8, 16):
        ids = rng.integers(0, 1 << bits, (5, 7))
        png(path, np.stack([ids, ids * 0 + 200], -1), bits, 4)
        assert np.array_equal(read_label_image(path).ids, ids)
        png(path, np.stack([ids, ids, ids], -1), bits, 2)
        assert np.array_equal(read_label_image(path).ids, ids)
    colours = rng.integers(0, 256, (5, 7, 4))
    png(path, colours, 8, 6)
    image = read_label_image(path)
    assert image.ids is None and np.array_equal(image.colours, colours[..., :3])
    png(path, colours[..., :3], 16, 2)
    with pytest.raises(InputError, match="8-bit colours, found 7 x 5, 16-bit RGB"):
        read_label_image(path)
    png(path, ids % 4, 8, 3, np.zeros((2, 3)))
    with pytest.raises(InputError, match="indices into the palette of 2 colours, found 3"):
        read_label_image(path)


def test_labels_in_colours_are_read_by_the_colours_of_a_table(truth, tmp_path):
    table = tmp_path / "mine.csv"
    kinds = true_classes(truth).classes
    rows = ["name,class_id,red,green,blue"]
    rows += [f"{kind.name},{100 + kind.id},{kind.id},0,255" for kind in kinds]
    table.write_text("\n".join(rows) + "\n")
    out = tmp_path / "out"
    out.mkdir()
    for frame in label_frames(truth):
        ids = read_ids(frame.classes)
        colours = np.stack([ids, ids * 0, np.where(ids, 255, 0)], -1).astype(np.uint8)
        colours[0, 0] = 9
        write_png(out / frame.classes.name, colours)
    found = label_errors(out, truth, str(table))
    assert found.unknown == (("#090909", 4),)
    assert found.figures.pixel_accuracy > 0.99
    with pytest.raises(InputError, match="grey values or indices into a palette, found colours"):
        label_errors(out, truth)
    for image in out.iterdir():
        pixels = np.stack([read_depth16(truth / "class" / image.name)], -1)[..., 0]
        png(image, pixels, 8, 3, [(k, 0, 255 * (k > 0)) for k in range(256)])
    assert label_errors(out, truth, str(table)).figures.mean_iou == 1
    assert label_errors(out, truth).figures.mean_iou == 1


def test_unknown_ids_are_counted_and_named_and_void_never_counts(truth, tmp_path):
    def change(ids):
        ids = ids.astype(np.uint16)
        ids[:2] = 999
        ids[2] = 0
        return ids

    found = label_errors(predicted(truth, tmp_path / "out", change), truth)
    assert found.unknown == (("999", 4 * 2 * 64),)
    assert found.figures.unlabelled == pytest.approx((3 * 64 - 12) / (48 * 64 - 16))
    assert "999" in json.dumps(found.to_dict())


def test_tables_that_are_none_are_refused_in_one_line(truth, tmp_path):
    table = tmp_path / "table.csv"
    for text, message in (
        ("a,b\n1,2\n", "columns id and class in the first line, found a, b"),
        ("id,class\n", "a table of classes, found none"),
        ("id,class\n1,wall\n1,floor\n", "each id once, found 1 2 times"),
        ("id,class\n1,wall\n2,wall\n", "each class once, found wall 2 times"),
        ("id,class,truth\n1,wall,a|b\n2,floor,b\n", "each truth once, found b"),
        ("id,class,red,green,blue\n1,a,0,0,9\n2,b,0,0,9\n", "each colour once"),
        ("id,class\n-1,wall\n", "table.csv:2: expected an id of 0 to 65535, found -1"),
        ("id,class\n70000,wall\n", "an id of 0 to 65535, found 70000"),
        ("id,class\n1,\n", "the name of a class, found nothing"),
        ("id,class\n1,wall,x\n", "2 columns, found 3"),
        ("id,class,red,green,blue\n1,a,0,0,\n", "blue of 0 to 255, found nothing"),
        ("id,class,thing\n1,a,2\n", "thing of 0 to 1, found 2"),
    ):
        table.write_text(text)
        with pytest.raises(InputError, match=message):
            read_class_map(str(table))
    with pytest.raises(InputError, match="ours, nyu40, scannet20, replica, or a table"):
        read_class_map("coco")


def test_zero_is_a_class_if_the_table_says_so(tmp_path):
    table = tmp_path / "table.csv"
    table.write_text("id,class\n0,wall\n1,floor\n255,ignore\n")
    found = read_class_map(str(table)).indices(np.array([0, 1, 255, 7, -3, 1 << 20]))
    assert found.values.tolist() == [1, 2, 0, 0, 0, 0]
    assert found.unknown == {"7": 1, "-3": 1, "1048576": 1}
    assert read_class_map("replica").indices(np.array([0])).values.tolist() == [0]


def test_the_tables_have_their_published_numbers():
    for name, id, word in (
        ("nyu40", 40, "otherprop"),
        ("scannet20", 39, "otherfurniture"),
        ("replica", 93, "wall"),
        ("replica", 101, "set-of-clothing"),
        ("ours", 47, "vent"),
    ):
        assert {k.id: k.name for k in read_class_map(name).classes}[id] == word
    counts = [len(read_class_map(name).classes) for name in BUILT_IN]
    assert counts == [47, 40, 20, 101]
    things = read_class_map("nyu40")
    assert [
        name for name, is_thing in zip(things.names, things.is_thing, strict=True) if not is_thing
    ] == ["unlabelled", "wall", "floor", "ceiling"]


def test_the_command_prints_writes_and_draws(truth, tmp_path, command_here):
    out = predicted(truth, tmp_path / "out", lambda ids: np.where(ids == 9, 1, ids))
    options = ("--truth", truth, "--csv", tmp_path / "c.csv", "--plot", tmp_path / "c.png")
    code, text, notes = command_here("evaluate", "labels", out, *options)
    assert code == 0 and "mean IoU" in text and "9 sofa" in text
    assert (tmp_path / "c.png").stat().st_size > 10_000
    code, text, _ = command_here("evaluate", "labels", out, *options, "--json")
    values = json.loads(text)
    rows = (tmp_path / "c.csv").read_text().splitlines()
    assert rows[0].startswith("truth,wall,floor")
    counts = np.array([row.split(",")[1:] for row in rows[1:]], int)
    assert counts.sum() == values["compared"]
    assert values["mean_iou"] < 1 and "panoptic_quality" not in values
    code, _, error = command_here("evaluate", "labels", out, "--truth", truth, "--classes", "x")
    assert code == 2 and len(error.splitlines()) == 1


def test_what_does_not_fit_is_refused_in_one_line(truth, labelled_formats, all_formats, tmp_path):
    with pytest.raises(InputError, match="class images, found none; try a sequence that was"):
        label_errors(truth, all_formats / "tum")
    with pytest.raises(InputError, match="no such folder"):
        label_errors(tmp_path / "none", truth)
    out = predicted(truth, tmp_path / "out", lambda ids: ids[::2, ::2])
    with pytest.raises(InputError, match="64 x 48, as the true image, found 32 x 24"):
        label_errors(out, truth)
    shutil.rmtree(out)
    out = predicted(truth, tmp_path / "out")
    mine = tmp_path / "mine.csv"
    mine.write_text("id,class\n1,zebra\n")
    with pytest.raises(InputError, match="classes of the ground truth that are in"):
        label_errors(out, truth, str(mine))
    shutil.copytree(truth / "instance", out / "instance")
    assert "panoptic_quality" in label_errors(out, truth).to_dict()
    (out / "instance/000002.png").unlink()
    with pytest.raises(InputError, match="an instance image for each class image"):
        label_errors(out, truth)


def test_the_class_of_a_name_with_a_comma_survives(labelled_run, tmp_path):
    objects = json.loads((labelled_run / "objects.json").read_text())
    objects["classes"][-1]["name"] = 'a "long", name'
    copied = tmp_path / "raw"
    shutil.copytree(labelled_run, copied)
    (copied / "objects.json").write_text(json.dumps(objects))
    write_sequence(run_frames(copied), tmp_path / "out")
    assert true_classes(tmp_path / "out").classes[-1].name == 'a "long", name'


def test_convert_notes_labels_that_it_leaves_out(labelled_formats, tmp_path, command_here):
    for name, folder in (("tum", "class/"), ("replica", "semantic_class/")):
        command = ("convert", labelled_formats / name, tmp_path / name)
        code, _, notes = command_here(*command)
        assert code == 0 and folder in notes and "not converted" in notes


def test_labels_are_in_the_archive_of_every_format(labelled_formats, tmp_path, command_here):
    for name in ("tum", "replica"):
        out = tmp_path / f"{name}.tar.gz"
        command = ("pack", labelled_formats / name, "-o", out, "--no-preview")
        assert command_here(*command, "--author", "A", "--licence", "CC0-1.0")[0] == 0
        with tarfile.open(out) as archive:
            listed = archive.getnames()
        assert sum("class" in path and path.endswith(".png") for path in listed) == 4


def test_labels_that_are_moved_by_one_are_named(truth, tmp_path):
    right = label_errors(predicted(truth, tmp_path / "right"), truth)
    assert right.warnings == ()
    (warning,) = label_errors(
        predicted(truth, tmp_path / "zero", lambda ids: ids - 1), truth
    ).warnings
    assert "numbered from 0: moved by +1" in warning and "100.0% of the labels" in warning
