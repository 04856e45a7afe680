"""COCO's annotations of a sequence: masks are those of its images, by the definition of the run
lengths and, where it is, by pycocotools.
"""

import json
import shutil

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.formats.png import read_png, write_png
from iclnuim.labels import pictures as label_pictures
from iclnuim.labels.classes import read_class_map
from iclnuim.labels.coco import write_coco
from iclnuim.labels.frames import label_frames, read_ids, true_classes
from iclnuim.labels.pictures import class_colours
from iclnuim.sequences.sequence_formats import FORMATS
from judges import judged_by

READ = """
import sys
import numpy as np
from pycocotools import mask
from pycocotools.coco import COCO
coco = COCO(sys.argv[1])
annotations = coco.loadAnns(sorted(coco.getAnnIds()))
masks = [coco.annToMask(annotation) for annotation in annotations]
areas = [int(mask.area(coco.annToRLE(annotation))) for annotation in annotations]
np.savez(sys.argv[2], masks=masks, areas=areas)
"""


@pytest.fixture(scope="module")
def written(labelled_formats, tmp_path_factory):
    path = tmp_path_factory.mktemp("coco") / "coco.json"
    write_coco(path, labelled_formats / "tum")
    return labelled_formats / "tum", path


def decoded(annotation):
    """A mask from its run lengths."""
    height, width = annotation["segmentation"]["size"]
    counts = annotation["segmentation"]["counts"]
    pixels = np.repeat(np.arange(len(counts)) % 2, counts)
    return pixels.reshape(width, height).T.astype(bool)


def test_masks_are_those_of_the_images(written):
    folder, path = written
    content = json.loads(path.read_text())
    classes = {kind.id: kind.name for kind in true_classes(folder).classes}
    assert {kind["id"]: kind["name"] for kind in content["categories"]} == classes
    assert 0 not in classes
    frames = label_frames(folder)
    assert len(content["images"]) == len(frames) == 4
    for image, frame in zip(content["images"], frames, strict=True):
        assert folder / image["file_name"] == frame.pair.rgb
        kinds, instances = read_ids(frame.classes), read_ids(frame.instance)
        again = np.zeros(kinds.shape + (2,), int)
        for annotation in content["annotations"]:
            if annotation["image_id"] != image["id"]:
                continue
            mask = decoded(annotation)
            again[mask] = annotation["category_id"], annotation["instance_id"]
            left, top, width, height = annotation["bbox"]
            assert mask[top : top + height, left : left + width].sum() == mask.sum()
            assert mask.sum() == annotation["area"]
            assert mask[:, [left, left + width - 1]].any(0).all()
            assert mask[[top, top + height - 1]].any(1).all()
        assert np.array_equal(again[..., 0], kinds)
        assert np.array_equal(again[..., 1][kinds > 0], instances[kinds > 0])


def test_pycocotools_reads_the_same_masks(written, tmp_path):
    _, path = written
    masks = tmp_path / "masks.npz"
    judged_by("pycocotools", "pycocotools.coco", "-c", READ, path, masks)
    found = np.load(masks)
    annotations = json.loads(path.read_text())["annotations"]
    assert len(found["masks"]) == len(annotations) == 4 * 5
    for mask, area, annotation in zip(found["masks"], found["areas"], annotations, strict=True):
        assert np.array_equal(mask.astype(bool), decoded(annotation))
        assert area == annotation["area"]


@pytest.mark.parametrize("name", FORMATS)
def test_the_sequence_of_every_format_has_annotations(labelled_formats, name, tmp_path):
    write_coco(tmp_path / "coco.json", labelled_formats / name)
    content = json.loads((tmp_path / "coco.json").read_text())
    for image in content["images"]:
        assert (labelled_formats / name / image["file_name"]).is_file()


def test_inspect_writes_annotations_and_a_picture_of_the_classes(written, tmp_path, command_here):
    folder, path = written
    options = ("--coco", tmp_path / "coco.json", "--preview", tmp_path / "pictures")
    command_here("inspect", folder, *options)
    assert (tmp_path / "coco.json").read_bytes() == path.read_bytes()
    assert (tmp_path / "pictures/classes.png").stat().st_size > 10_000


def test_a_scene_that_names_no_class_has_a_picture_and_annotations_without_classes(
    labelled_formats, tmp_path, command_here, monkeypatch
):
    """As a user's own scene: classes.csv has 0 alone, and all class images are 0."""
    folder = tmp_path / "own"
    shutil.copytree(labelled_formats / "tum", folder)
    head = (folder / "classes.csv").read_text().splitlines(True)[0]
    (folder / "classes.csv").write_text(f"{head}0,unlabelled,0,unlabelled\n")
    for path in (folder / "class").iterdir():
        write_png(path, np.zeros_like(read_png(path)))
    labels = []
    patch = label_pictures.Patch
    monkeypatch.setattr(
        label_pictures, "Patch", lambda **of: labels.append(of["label"]) or patch(**of)
    )
    options = ("--coco", tmp_path / "coco.json", "--preview", tmp_path / "pictures")
    _, _, error = command_here("inspect", folder, *options)
    assert "classes.png written" in error and labels == ["0 unlabelled: no class_name"]
    content = json.loads((tmp_path / "coco.json").read_text())
    assert content["categories"] == content["annotations"] == [] and len(content["images"]) == 4
    assert (tmp_path / "pictures/classes.png").exists()
    code, _, error = command_here("evaluate", "labels", folder, "--truth", folder, "--quiet")
    assert code == 2 and "classes of the ground truth" in error


def test_no_two_classes_of_ours_have_nearly_the_same_colour():
    colours = class_colours()[: 1 + len(read_class_map("ours").classes)].astype(int)
    apart = np.abs(colours[:, None] - colours[None]).max(axis=2)
    assert (apart[~np.eye(len(colours), dtype=bool)] > 18).all()


def test_a_sequence_without_labels_is_refused_in_one_line(all_formats, tmp_path, command_here):
    with pytest.raises(InputError, match="class images, found none"):
        write_coco(tmp_path / "coco.json", all_formats / "tum")
    command = ("inspect", all_formats / "tum", "--coco", tmp_path / "coco.json")
    code, _, error = command_here(*command, "--quiet")
    assert code == 2 and len(error.splitlines()) == 1 and "--ground-truth" in error
    code, _, _ = command_here("inspect", all_formats / "tum", "--preview", tmp_path / "pictures")
    assert not (tmp_path / "pictures/classes.png").exists()
