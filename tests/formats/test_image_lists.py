"""Association files both ways round, and lists of images."""

import numpy as np
import pytest
from iclnuim.errors import InputError
from iclnuim.sequences.associations import (
    Associations,
    ImageList,
    read_associations,
    read_image_list,
    read_image_lists,
    write_associations,
    write_image_list,
)


def images(kind: str, frames: list[int]) -> ImageList:
    return ImageList(
        tuple(round(1 + i / 30, 6) for i in frames), tuple(f"{kind}/{i:06}.png" for i in frames)
    )


@pytest.mark.parametrize("order", ["tum", "icl-nuim"])
@pytest.mark.parametrize("frames", [[0], [0, 1, 2], [3, 90, 91, 1509]])
def test_both_orders_keep_pairs_and_stamps(tmp_path, order, frames):
    written = Associations(images("rgb", frames), images("depth", frames), order)
    write_associations(tmp_path / "a.txt", written, order)
    back = read_associations(tmp_path / "a.txt")
    assert back.order == order
    assert (back.rgb.paths, back.depth.paths) == (written.rgb.paths, written.depth.paths)
    np.testing.assert_allclose(back.rgb.stamps_s, written.rgb.stamps_s, atol=1e-9)
    np.testing.assert_allclose(back.depth.stamps_s, written.depth.stamps_s, atol=1e-9)


def test_the_orders_are_laid_out_as_the_originals(tmp_path):
    pairs = Associations(images("rgb", [1, 2]), images("depth", [1, 2]))
    write_associations(tmp_path / "tum.txt", pairs)
    assert (tmp_path / "tum.txt").read_text().splitlines()[
        0
    ] == "1.033333 rgb/000001.png 1.033333 depth/000001.png"
    write_associations(tmp_path / "icl.txt", pairs, "icl-nuim")
    assert (
        tmp_path / "icl.txt"
    ).read_text() == "1 depth/000001.png 1 rgb/000001.png\n2 depth/000002.png 2 rgb/000002.png\n"


def test_the_official_file_has_depth_first_and_frame_numbers(samples):
    pairs = read_associations(samples / "or_kt0/associations.txt")
    assert len(pairs) == 120 and pairs.order == "icl-nuim"
    assert (pairs.rgb.paths[0], pairs.depth.paths[0]) == ("rgb/600.png", "depth/600.png")
    np.testing.assert_allclose(
        pairs.rgb.stamps_s, 1 + np.arange(600, 720) / 30, atol=5.1e-7, rtol=0
    )


def test_stamps_of_a_recording_are_seconds_in_either_order(tmp_path):
    (tmp_path / "a.txt").write_text(
        "# made by hand\n1305031102.17 depth/a.png 1305031102.18 rgb/b.png\n"
    )
    pairs = read_associations(tmp_path / "a.txt")
    assert pairs.rgb.stamps_s == (1305031102.18,) and pairs.depth.stamps_s == (1305031102.17,)


def test_image_lists_keep_paths_and_stamps(tmp_path):
    written = images("rgb", [0, 1, 7])
    write_image_list(tmp_path / "rgb.txt", written)
    back = read_image_list(tmp_path / "rgb.txt")
    assert back.paths == written.paths
    np.testing.assert_allclose(back.stamps_s, written.stamps_s, atol=1e-9)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "a.txt: expected a list of images, found an empty file"),
        ("# x\n", "found comments alone"),
        (
            "0 rgb/0.png 0 depth/0.png\n1 rgb/1.png\n",
            "a.txt:2: expected 4 columns.* found 2 columns",
        ),
        (
            "x rgb/0.png 0 depth/0.png\n",
            "a.txt:1: expected a stamp in seconds in column 1, found 'x'",
        ),
        ("0 rgb/0.png nan depth/0.png\n", "column 3, found 'nan'"),
        ("0 a.png 0 b.png\n", "the word depth in one of the two paths.* found a.png and b.png"),
        (
            "0 rgb/0.png 0 depth/0.png\n1 depth/1.png 1 rgb/1.png\n",
            "a.txt:2: expected the word depth in .* always in the same column",
        ),
        (
            "1 rgb/0.png 0 depth/0.png\n1 rgb/1.png 1 depth/1.png\n",
            "a.txt:2: expected a stamp above the 1 of line 1, found 1",
        ),
        ("<!doctype html>", "a web page"),
    ],
)
def test_what_is_wrong_with_associations_is_said(tmp_path, content, message):
    (tmp_path / "a.txt").write_text(content)
    with pytest.raises(InputError, match=message):
        read_associations(tmp_path / "a.txt")


@pytest.mark.parametrize("order", ["tum", "icl-nuim"])
def test_paths_that_would_break_the_columns_are_not_written(tmp_path, order):
    bad = ImageList((0.0,), ("my rgb/0.png",))
    with pytest.raises(InputError, match="without blanks"):
        write_associations(tmp_path / "a.txt", Associations(bad, images("depth", [0])), order)
    assert not list(tmp_path.iterdir())


def test_seconds_between_frames_are_not_written_as_frame_numbers(tmp_path):
    late = ImageList((0.01,), ("rgb/0.png",))
    with pytest.raises(InputError, match="frame numbers"):
        write_associations(tmp_path / "a.txt", Associations(late, images("depth", [0])), "icl-nuim")


def test_lists_of_unequal_length_are_no_pairs():
    with pytest.raises(InputError, match="as many depth as colour"):
        Associations(images("rgb", [0, 1]), images("depth", [0]))
    with pytest.raises(InputError, match="as many paths as stamps"):
        ImageList((0.0,), ())


@pytest.mark.parametrize(
    ("line", "stamp_s"),
    [
        ("{n} rgb/{n}.png {n} depth/{n}.png", 1 + 600 / 30),
        ("{n} rgb/{n:06}.png {n} depth/{n:06}.png", 1 + 600 / 30),
        ("{n}.0 rgb/{n}.png {n}.0 depth/{n}.png", 600),
        ("{n} rgb/1{n}.png {n} depth/1{n}.png", 600),
        ("1305030{n} rgb/1305030{n}.png 1305030{n} depth/1305030{n}.png", 1305030600),
    ],
    ids=["swapped", "six digits", "decimals", "other names", "epoch"],
)
def test_whole_numbers_that_name_the_images_are_frame_numbers_also_in_tums_order(
    tmp_path, line, stamp_s
):
    lines = [line.format(n=n) for n in (600, 601)]
    (tmp_path / "associations.txt").write_text("\n".join(lines))
    pairs = read_associations(tmp_path / "associations.txt")
    assert pairs.order == "tum" and pairs.rgb.stamps_s[0] == pairs.depth.stamps_s[
        0
    ] == pytest.approx(stamp_s)
    for name, part in (("rgb.txt", slice(2)), ("depth.txt", slice(2, 4))):
        (tmp_path / name).write_text("\n".join(" ".join(one.split()[part]) for one in lines))
    assert [
        one.stamps_s[0] for one in read_image_lists(tmp_path / "rgb.txt", tmp_path / "depth.txt")
    ] == [pytest.approx(stamp_s)] * 2
