"""`iclnuim bench textures`: filtered textures are closer to many rays a pixel, and change less from
frame to frame.
"""

import json

import pytest
from iclnuim.headless.cli import main


@pytest.mark.slow
def test_filtered_textures_are_closer_to_many_rays_a_pixel(tmp_path, capfd):
    pytest.importorskip("bpy", reason="needs the bpy package")
    words = ["bench", "textures", "kt2", "--frames", "320:321", "--camera", "160x120", "--json"]
    assert main([*words, "--plot", str(tmp_path / "textures.png")]) == 0
    plain, filtered, reference = json.loads(capfd.readouterr().out)["rows"]
    assert [r["textures"] for r in (plain, filtered, reference)] == [
        "unfiltered",
        "mipmaps",
        "16 rays a pixel",
    ]
    assert filtered["difference"] < 0.75 * plain["difference"] and reference["difference"] is None
    assert filtered["change_mean"] < 0.75 * plain["change_mean"]
    assert (tmp_path / "textures.png").stat().st_size > 10_000


def test_no_frames_are_refused(capsys):
    pytest.importorskip("bpy", reason="needs the bpy package")
    assert main(["bench", "textures", "kt2", "--frames", "5:5"]) == 2
    assert "expected at least one of the frames 0..880, found 5:5" in capsys.readouterr().err
