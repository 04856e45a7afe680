"""The lines of README, and of each quick start, run one after the other, as they stand, in one folder
that has only what they name: with fewer frames and a smaller camera where a line would take minutes.
"""

import re
import shlex
import subprocess
import sys

import numpy as np
import pytest
from iclnuim.formats.png import write_png
from patience import patience

PAGES = (
    "README.md",
    "docs/guide/start_slam.md",
    "docs/guide/start_images.md",
    "docs/guide/start_blender.md",
    "docs/guide/start_benchmark.md",
)
#: Word of a line -> words put in by the test; nothing else of a line is changed.
SMALL = {
    "make kt2": ("--frames", ":8", "--camera", "160x120"),
    "make office/kt0": ("--frames", ":2", "--camera", "160x120"),
    "benchmark": ("--frames", ":6", "--no-surfaces"),
    "stress": ("--frames", ":6"),
    "evaluate rpe": ("--delta", "4"),
    "trajectory make": ("--viewpoints", "auto:2"),
    "make --scene": ("--frames", ":2", "--camera", "80x60"),
}
#: Lines that the test leaves out: hours, and a third-party system.
LEFT_OUT = ("make all", "run orbslam3")


def shown_lines(repository, page):
    """The words of a page's lines `iclnuim ...`, in order."""
    text = (repository / page).read_text()
    blocks = re.findall(r"```sh\n(.*?)```", text, re.S)
    found = re.findall(r"^(?:.* && )?(?:\.venv/bin/)?iclnuim (.*)$", "\n".join(blocks), re.M)
    return [shlex.split(line, comments=True) for line in found]


def outputs(words):
    """What a line writes: its -o or --out, or the second folder of `noise` and `convert`."""
    given = [words[k + 1] for k, word in enumerate(words) if word in ("-o", "--out")]
    return given or words[2:3] if words[0] in ("noise", "convert") else given


@pytest.mark.parametrize("page", PAGES)
def test_no_two_lines_write_to_the_same_place(repository, page):
    written = [out for words in shown_lines(repository, page) for out in outputs(words)]
    assert sorted(set(written)) == sorted(written)


@pytest.mark.parametrize("page", PAGES)
def test_every_file_that_a_line_reads_was_written_by_a_line_before_it(repository, page):
    there = {"your_scene.glb", "my_images", "ORBvoc.txt"}  # the reader's own
    for words in shown_lines(repository, page):
        written = outputs(words)
        for word in words[1:]:
            if re.search(r"\.(txt|ply|glb)$", word) and word not in written:
                place = word.split("/")[0]
                assert word in there or place in there, f"{shlex.join(words)}: {word}"
        there |= {*written, "out"} if words[0] == "make" else set(written)
        there |= {"paths"} & set(written)


def test_a_line_that_needs_something_of_the_readers_says_so(repository):
    text = (repository / "README.md").read_text()
    for mine in ("my_images", "--scene", "orbslam3"):
        line = re.search(rf"^iclnuim .*{mine}.*$", text, re.M)[0]
        assert re.search(r"# (your|needs)\b", line), line


def test_a_line_of_more_than_ten_seconds_says_how_long(repository):
    text = (repository / "README.md").read_text()
    slow = ("make kt2 ", "make office", "make all", "odometry", "fuse", "surface", "benchmark")
    for name in (*slow, "stress", "trajectory make", "make --scene"):
        (line,) = re.findall(rf"^iclnuim (?:evaluate )?{name}.*$", text, re.M)
        assert re.search(r"#.*\b(minutes?|\d+ s|three times)\b", line), line


def test_the_full_command_of_the_tests_is_that_of_the_project_and_a_short_one_stands_beside_it(
    repository,
):
    text = (repository / "README.md").read_text()
    assert "./setup.sh test && .venv/bin/python -m pytest\n" in text
    (short,) = re.findall(r"^\.venv/bin/python -m pytest (.+)$", text, re.M)
    assert all((repository / folder).is_dir() for folder in short.split())


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES)
def test_the_lines_of_a_page_run_in_order(repository, tmp_path, page):
    lay_out(tmp_path, repository)
    for words in shown_lines(repository, page):
        line = " ".join(words)
        if line.startswith(LEFT_OUT):
            continue
        done = subprocess.run(
            [sys.executable, "-m", "iclnuim", *smaller(line, words)],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=patience(900),
        )
        assert done.returncode == 0, f"{line}: {done.stderr[-600:]}"
        assert all((tmp_path / written).exists() for written in outputs(words))


def smaller(line, words):
    """The words of a line with what SMALL puts in, in place of the same options and --quick; the
    reader's scene is an OBJ.
    """
    extra = next((more for name, more in SMALL.items() if line.startswith(name)), ())
    kept = [word for word in words if word != "--quick" or not extra]
    for option in extra[::2]:
        if option in kept:
            k = kept.index(option)
            del kept[k : k + 2]
    kept = [word.replace("scene.glb", "scene.obj") for word in kept]
    return [*kept, *extra]


def lay_out(folder, repository):
    """The reader's own files: images without lists, and a scene."""
    for kind, dtype, shape in (
        ("rgb", np.uint8, (480, 640, 3)),
        ("depth", np.uint16, (480, 640)),
    ):
        place = folder / "my_images" / kind
        place.mkdir(parents=True)
        for number in range(2):
            write_png(place / f"{number}.png", np.full(shape, 2000, dtype))
    (folder / "your_scene.obj").write_text((repository / "tests/room.obj").read_text())
