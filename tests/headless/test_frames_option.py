"""`--frames` means a slice wherever frames are chosen; a bare number is refused where it could mean
their number.
"""

import numpy as np
import pytest
from iclnuim.benchmark.odometry.run import Sequence
from iclnuim.benchmark.systems.staging import StagedSequence
from iclnuim.formats.png import write_png
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.headless import cli
from iclnuim.sequences.camera_files import SequenceCamera
from iclnuim.sequences.stored_sequence import StoredSequence

WITH_FRAMES = (
    "odometry icp seq",
    "run orbslam3 seq",
    "bench odometry seq",
    "bench curve iterations seq",
    "benchmark",
    "stress seq",
)


@pytest.mark.parametrize("line", WITH_FRAMES)
def test_a_bare_number_is_refused_with_the_slice_to_try(line, capsys):
    words = line.split()
    with pytest.raises(SystemExit) as exit:
        cli.parsed(words[0], [*words[1:], "--frames", "40"])
    (said,) = capsys.readouterr().err.splitlines()
    assert exit.value.code == 2
    assert "found '40'" in said and said.endswith("; try --frames :40")


@pytest.mark.parametrize("line", WITH_FRAMES)
def test_first_still_means_the_slice_of_the_first_ones(line):
    words = line.split()
    by_slice = cli.parsed(words[0], [*words[1:], "--frames", ":40"])
    by_number = cli.parsed(words[0], [*words[1:], "--first", "40"])
    assert vars(by_slice) == vars(by_number)
    assert getattr(by_slice, "first", 40) == 40


@pytest.mark.parametrize(
    ("text", "start", "first"), [("80:200", 80, 120), ("80:", 80, None), (":7", 0, 7)]
)
def test_a_curve_is_measured_on_a_span(text, start, first):
    args = cli.parsed("bench", ["curve", "rate", "seq", "--frames", text])
    assert (args.start, args.first) == (start, first)


@pytest.mark.parametrize("text", ["9:3", "3:3", "-4:", "::2", "a:b"])
def test_what_is_no_span_is_refused(text, capsys):
    with pytest.raises(SystemExit):
        cli.parsed("bench", ["curve", "rate", "seq", f"--frames={text}"])
    assert text in capsys.readouterr().err


@pytest.mark.parametrize("text", ["3:40", ":40:2", ":0", "::", ":-1"])
def test_what_is_not_the_first_frames_is_refused(text, capsys):
    with pytest.raises(SystemExit):
        cli.parsed("benchmark", [f"--frames={text}"])
    assert "expected :N, the first N frames" in capsys.readouterr().err


def test_a_sequence_is_opened_with_the_frames_of_a_slice(tmp_path):
    for kind, dtype, shape in (("rgb", np.uint8, (8, 8, 3)), ("depth", np.uint16, (8, 8))):
        (tmp_path / kind).mkdir()
        for number in range(6):
            write_png(tmp_path / kind / f"{number}.png", np.full(shape, 9, dtype))
    camera = SequenceCamera(PinholeCamera.parse("8x8"), 1000)
    stored = StoredSequence(tmp_path).with_camera(camera)
    assert names(Sequence(stored, frames="1:6:2")) == ["1", "3", "5"]
    assert names(StagedSequence.of(stored, "-2:")) == ["4", "5"]


def names(sequence):
    return [pair.rgb.stem for pair in sequence.pairs]
