"""Which files of a folder are listed, in which order, and the numbers in their names."""

import pytest
from iclnuim.formats.image_names import files_in, numbers_in_names


def test_names_sort_as_numbers_and_hidden_files_are_left_out(tmp_path):
    for name in ("frame10.png", "frame9.png", "frame_.png", "frame1.jpg", "note.txt"):
        (tmp_path / name).touch()
        (tmp_path / f"._{name}").touch()
    (tmp_path / "Thumbs.db").touch()
    listed = [path.name for path in files_in(tmp_path, "frame*.png", "*.jpg")]
    assert listed == ["frame1.jpg", "frame9.png", "frame10.png", "frame_.png"]
    assert len(files_in(tmp_path)) == 5
    assert files_in(tmp_path / "none") == []


@pytest.mark.parametrize(
    ("names", "numbers"),
    [
        (["frame0.jpg", "frame10.jpg"], [0, 10]),
        (["000001_left.png", "000012_left.png"], [1, 12]),
        (["cam1_07.png", "cam1_08.png"], [7, 8]),
        (["07_cam1.png", "08_cam1.png"], [7, 8]),
        (["run2_3.png"], [3]),
        (["a.png", "b.png"], None),
        (["a1.png", "a1b2.png"], None),
        (["1.png", "01.png"], None),
        ([], None),
    ],
)
def test_the_number_of_an_image_is_the_last_that_differs_in_every_name(names, numbers):
    assert numbers_in_names(names) == numbers
