"""`iclnuim bench detail-odometry`: its figures, and the command from end to end at its smallest."""

import json

import pytest

pytest.importorskip("bpy", reason="needs the bpy package")
pytest.importorskip("embreex")


def builds(errors_m, seeds_m=(0.001,), kind="clean"):
    """Rooms at the levels 0.5, 0.7, 1, 1.4 with these errors of one method, and at level 1 with
    other seeds.
    """
    from iclnuim.tools.detail_odometry import Build

    def build(detail, seed, ate_m):
        return Build(
            "living_room/kt2",
            detail,
            seed,
            {k: {"icp": ate_m} for k in ("clean", "noisy")},
        )

    found = [build(d, 0, e) for d, e in zip((0.5, 0.7, 1.0, 1.4), errors_m, strict=True)]
    return found + [build(1.0, k + 1, e) for k, e in enumerate(seeds_m)]


def test_the_spread_is_relative_to_the_median_of_seeds():
    from iclnuim.tools.detail_odometry import changes

    clean, noisy = changes(builds((0.002, 0.001, 0.004, 0.004), (0.002, 0.003)))
    assert (clean["kind"], noisy["kind"]) == ("clean", "noisy") and clean["levels"] == [
        0.5,
        0.7,
        1.0,
        1.4,
    ]
    assert clean["spread"] == pytest.approx(2 / 3)
    assert clean["seeds_m"] == [0.004, 0.002, 0.003]


def test_what_cannot_be_is_said_in_one_line(command_here):
    for words, message in (
        (("kt9",), "expected a sequence"),
        (("kt2", "--levels", "0.01,1"), "levels within 0.15..3"),
    ):
        code, _, err = command_here("bench", "detail-odometry", *words)
        assert code == 2 and message in err.splitlines()[-1]


@pytest.mark.slow
def test_rooms_are_built_lit_tracked_and_fused_and_done_ones_are_kept(command_here, tmp_path):
    small = (
        "--first",
        "6",
        "--camera",
        "160x120",
        "--map-size",
        "512",
        "--map-samples",
        "2",
        "--method",
        "icp",
    )
    words = (
        "bench",
        "detail-odometry",
        "kt2",
        "--levels",
        "0.35,0.5,1",
        "--seeds",
        "0",
        *small,
        "-o",
        tmp_path / "out",
    )
    code, out, err = command_here(*words, "--json", "--plot", tmp_path / "detail.png")
    assert code == 0, err
    found = json.loads(out)
    assert [b["detail"] for b in found["builds"]] == [0.35, 0.5, 1.0]
    assert all(0 < b["ate_m"]["clean"]["icp"] < 0.01 for b in found["builds"])
    assert (tmp_path / "detail.png").stat().st_size > 10_000
    stamps = {path: path.stat().st_mtime_ns for path in (tmp_path / "out").rglob("*.png")}
    code, again, _ = command_here(*words, "--json")
    assert code == 0 and json.loads(again) == found
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "out").rglob("*.png")} == stamps
