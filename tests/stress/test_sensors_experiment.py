"""The experiment `sensors`: its frames are those that `iclnuim noise` writes, and its tables, chart
and page are there.
"""

import json

import numpy as np
from iclnuim.benchmark.experiments.recipes.sensors import SeenBySensor
from iclnuim.benchmark.odometry.run import Sequence
from iclnuim.sensor.models import DEPTH_MODELS
from iclnuim.sequences.stored_sequence import StoredSequence


def test_odometers_see_what_the_command_noise_writes(command_here, folder, tmp_path):
    words = ("--depth-noise", "d435", "--rgb-noise", "released", "--seed", "3")
    code, _, err = command_here("noise", folder, tmp_path / "noisy", *words, "--frames", ":2")
    assert code == 0, err
    written = StoredSequence(tmp_path / "noisy")
    seen = SeenBySensor(Sequence(folder, frames=":2"), "d435", "released", 3)
    assert len(written.pairs) == len(seen.pairs) == 2
    for ours, theirs in zip(seen.pairs, written.pairs, strict=True):
        for image, stored in zip(seen.images(ours), written.images(theirs), strict=True):
            assert np.array_equal(image, stored)


def test_each_sensor_has_a_row_and_each_method_a_column(
    command_here, folder, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    words = ("experiment", "sensors", folder, "--frames", ":3", "--set", "methods=icp,rgbd")
    code, text, err = command_here(*words, "--workers", "1", "--json")
    assert code == 0, err
    cells = {one["variant"]: one for one in json.loads(text)["cells"]}
    assert list(cells) == list(DEPTH_MODELS)
    assert cells["none"]["missing_share"] == 0 < cells["d435"]["missing_share"]
    assert all(one["coverage"] == {"icp": 1, "rgbd": 1} for one in cells.values())
    (table,) = (tmp_path / "out/sensors/tables").glob("*.csv")
    header = table.read_text().splitlines()[0]
    assert header.endswith("icp,rgbd")
    assert (tmp_path / "out/sensors/sensors.png").stat().st_size > 1000
    assert "data:image/png" in (tmp_path / "out/sensors/sensors.html").read_text()
