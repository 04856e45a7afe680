"""The page of `iclnuim view`: what is packed can be unpacked, what is left out is said, and a browser shows it."""

import base64
import hashlib
import json
import re
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from browser import Browser, program
from iclnuim.evaluation.absolute_error import AbsoluteErrorSettings, absolute_error
from iclnuim.formats.png import read_depth16
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3
from iclnuim.geometry.trajectory import Trajectory
from iclnuim.report.view import gather, page
from iclnuim.report.view.contents import ViewContents, ViewedFrame, ViewedSequence, ViewedSurface
from iclnuim.report.view.packing import packed_whole
from iclnuim.trajectory_files.trajectories import read_trajectory, write_trajectory

#: regl 2.1.1, dist/regl.min.js of its package
REGL_SHA256 = "6d14aa47e560de0d0f0d37ec7b4868274245125a6de4022010e9c0fdcc5a4b62"


@pytest.fixture(scope="module")
def kt2(repository):
    return read_trajectory(repository / "trajectories/living_room/kt2.txt")


def unpacked_bytes(text):
    return zlib.decompress(base64.b64decode(text))


def unpacked_whole(text, kind):
    planes = np.frombuffer(unpacked_bytes(text), np.uint8)
    size = np.dtype(kind).itemsize
    codes = np.ascontiguousarray(planes.reshape(size, -1).T).view(f"<u{size}").ravel()
    steps = np.where(codes & 1, ~(codes >> 1), codes >> 1).astype(kind)
    return np.cumsum(steps, dtype=kind)


def parts_of(file):
    """The data of a page, and its texts by name."""
    html = file.read_text()
    data = json.loads(re.search(r'id="data">(.*?)</script>', html, re.S)[1])
    texts = dict(re.findall(r'<script type="text/plain" id="(\w+)">(.*?)</script>', html, re.S))
    return data, texts


def frames_of(images, camera, poses=None):
    frames = []
    for number, (rgb, depth_z_m) in enumerate(images):
        pose = poses[number] if poses is not None else None
        frames.append(ViewedFrame(number, number / 30, pose, lambda r=rgb, d=depth_z_m: (r, d)))
    return ViewedSequence("own", camera, 5000.0, frames)


def random_images(count, width, height, seed):
    rng = np.random.default_rng(seed)
    rgb = np.zeros((height, width, 3), np.uint8)
    return [(rgb, rng.uniform(0, 13, (height, width)).astype(np.float32)) for _ in range(count)]


@pytest.mark.parametrize("kind", ["<u2", "<u4"])
def test_packed_whole_numbers_unpack_to_the_same(kind):
    rng = np.random.default_rng(3)
    top = np.iinfo(kind).max
    values = rng.integers(0, top, 5000, kind, endpoint=True)
    values[:6] = (0, top, 0, top, top, 0)
    assert np.array_equal(unpacked_whole(packed_whole(values), kind), values)


def test_depth_of_a_small_page_is_that_of_the_files(tmp_path):
    camera = PinholeCamera(64, 48, 50, 50, 31.5, 23.5)
    images = random_images(3, 64, 48, 1)
    assert (
        page.write_page(tmp_path / "v.html", ViewContents("t", [frames_of(images, camera)])) == []
    )
    data, texts = parts_of(tmp_path / "v.html")
    for frame, (_, depth_z_m) in zip(data["sequences"][0]["frames"], images, strict=True):
        units = unpacked_whole(texts[frame["depth"]], "<u2").reshape(48, 64)
        assert np.array_equal(units, np.rint(5000 * depth_z_m))


def test_depth_that_does_not_fit_is_shown_in_every_second_row_and_column_unless_asked(tmp_path):
    camera = PinholeCamera(640, 480, 500, 500, 319.5, 239.5)
    view = ViewContents("t", [frames_of(random_images(20, 640, 480, 2), camera)])
    (note,) = page.write_page(tmp_path / "v.html", view)
    assert "every second row and column" in note
    assert (tmp_path / "v.html").stat().st_size < 15e6
    data, texts = parts_of(tmp_path / "v.html")
    assert data["sequences"][0]["depth_width"] == 320 and data["sequences"][0]["depth_step"] == 2
    assert note in (tmp_path / "v.html").read_text()
    assert page.write_page(tmp_path / "v.html", view, exact=True) == []


def test_errors_are_those_of_the_ate(kt2):
    truth = kt2
    moved = SE3.exp(np.array([1, 2, 3, 0.1, 0.2, 0.3])) @ truth.trajectory.T_world_camera
    noise = np.random.default_rng(1).normal(0, 0.01, (len(moved), 6))
    estimate = Trajectory(truth.trajectory.stamps_s, moved @ SE3.exp(noise))
    settings = AbsoluteErrorSettings()
    expected = absolute_error(truth.trajectory, estimate, settings)
    named = [("e", replace(truth, trajectory=estimate))]
    true, found = gather.trajectories(named, truth.trajectory, settings)
    assert true.is_truth and not found.is_truth
    assert np.array_equal(found.errors_m, expected.translation_error_m)
    assert f"{1e3 * expected.translation_m.rmse:.3g} mm" in found.label


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", (1, -1))
def test_the_world_is_turned_so_that_cameras_stand_upright(kt2, axis, sign):
    up = np.zeros(3)
    up[axis] = sign
    forward = np.roll(up, 1)
    rotation = np.stack([np.cross(-up, forward), -up, forward], axis=1)
    poses = SE3(np.tile(rotation, (5, 1, 1)), np.random.default_rng(0).normal(size=(5, 3)))
    one = gather.trajectories(
        [("t", replace(kt2, trajectory=Trajectory(np.arange(5.0), poses)))],
        None,
        AbsoluteErrorSettings(),
    )
    points = np.random.default_rng(1).normal(size=(9, 3))
    surface = ViewedSurface("s", points, np.zeros((0, 3), int))
    view = gather.upright(ViewContents("t", [], one, [surface]))
    turned = view.trajectories[0].trajectory.T_world_camera
    assert np.allclose(-turned.rotation[:, :, 1], [0, 0, 1])
    offsets = view.surfaces[0].points[:, None] - turned.translation
    assert np.allclose(
        np.linalg.norm(offsets, axis=2),
        np.linalg.norm(points[:, None] - poses.translation, axis=2),
    )


def test_the_library_is_the_published_file_with_its_licence():
    folder = Path(page.__file__).parent
    assert hashlib.sha256((folder / "regl.min.js").read_bytes()).hexdigest() == REGL_SHA256
    assert "MIT License" in (folder / "regl.LICENSE").read_text()


@pytest.fixture
def sequence(tmp_path, kt2):
    """80 frames of a slope, written as a sequence, and an estimate of its trajectory."""
    import iclnuim

    camera = PinholeCamera(64, 48, 50, 50, 31.5, 23.5)
    whole = kt2.trajectory[:80]
    rgb = np.full((48, 64, 3), 0.5)
    depth_z_m = np.fromfunction(lambda v, u: 1 + 0.01 * u, (48, 64))
    frames = iclnuim.frames_from(camera, whole, lambda number: (rgb, depth_z_m))
    iclnuim.make_sequence(frames, tmp_path / "s")
    estimate = Trajectory(whole.stamps_s, SE3.exp(np.full(6, 0.3)) @ whole.T_world_camera)
    write_trajectory(tmp_path / "estimate.txt", estimate, "tum")
    return tmp_path / "s"


def test_the_command_shows_sixty_frames_and_says_so(sequence, tmp_path, command_here):
    out = tmp_path / "v.html"
    estimate = tmp_path / "estimate.txt"
    code, printed, noted = command_here("view", sequence, estimate, "-o", out, "--no-open")
    assert code == 0 and "60 of 80 frames" in noted
    data, _ = parts_of(out)
    frames = data["sequences"][0]["frames"]
    assert len(frames) == 60 and frames[0]["number"] == 0 and frames[-1]["number"] == 79
    assert [one["is_truth"] for one in data["trajectories"]] == [True, False]
    code, _, noted = command_here(
        "view", sequence, "-o", out, "--frames", "2:9:3", "--no-open", "--json"
    )
    data, _ = parts_of(out)
    assert [one["number"] for one in data["sequences"][0]["frames"]] == [2, 5, 8]


def test_what_is_not_there_is_refused_in_one_line(tmp_path, command_here):
    code, _, noted = command_here("view", tmp_path / "none", "--no-open")
    assert code == 2 and noted.count("\n") == 1 and "found nothing" in noted


#: Of a box in a page: its corner and its size.
SIDES = (("x", "width"), ("y", "height"))


@pytest.mark.skipif(program() is None, reason="no Chromium")
@pytest.mark.parametrize(("width", "height"), [(1400, 900), (390, 800)])
def test_a_browser_shows_frames_depth_and_keys(sequence, tmp_path, command_here, width, height):
    out = tmp_path / "v.html"
    assert not command_here("view", sequence, tmp_path / "estimate.txt", "-o", out, "--no-open")[0]
    with Browser(tmp_path / "profile", width, height, webgl=True) as browser:
        browser.open(out)
        browser.until("document.body.dataset.ready === 'true'")
        assert browser.value("state.frame") == 0
        browser.press("ArrowRight")
        browser.until("state.frame === 1")
        browser.until("images.metres !== null")
        depth = browser.value("images.metres[10 * 64 + 20]")
        stored = read_depth16(sequence / "depth/000001.png")[10, 20] / 5000
        assert depth == pytest.approx(stored, abs=1e-6)
        assert browser.value("document.documentElement.scrollWidth") <= width
        resources = browser.value("performance.getEntriesByType('resource').length")
        assert resources == 0 or browser.value(
            "performance.getEntriesByType('resource').every(r => r.name.startsWith('data:'))"
        )
        assert float(browser.value("document.body.dataset.first")) > 0


@pytest.mark.skipif(program() is None, reason="no Chromium")
def test_two_fingers_zoom_by_the_ratio_of_their_distances(sequence, tmp_path, command_here):
    out = tmp_path / "v.html"
    assert not command_here("view", sequence, "-o", out, "--no-open")[0]
    with Browser(tmp_path / "profile", 390, 800, webgl=True) as browser:
        browser.open(out)
        browser.until("document.body.dataset.ready === 'true'")
        box = "document.getElementById('world').getBoundingClientRect()"
        x, y = (browser.value(f"{box}.{side} + {box}.{size} / 2") for side, size in SIDES)
        before = browser.value("eye.distance")
        for kind, gaps in (("touchStart", [40]), ("touchMove", [50, 60, 80]), ("touchEnd", [])):
            for gap in gaps or [None]:
                ends = [] if gap is None else [x - gap / 2, x + gap / 2]
                points = [{"x": end, "y": y, "id": k} for k, end in enumerate(ends)]
                browser.call("Input.dispatchTouchEvent", type=kind, touchPoints=points)
        assert browser.value("eye.distance") == pytest.approx(before / 2, rel=0.02)
        assert browser.value("fingers.size") == 0


def test_a_surface_with_opacity_is_packed_in_the_colours_of_one_without(tmp_path):
    rng = np.random.default_rng(3)
    points, colours = rng.normal(size=(20, 3)), rng.integers(0, 256, (20, 4)).astype(np.uint8)
    packed = []
    for channels in (3, 4):
        one = ViewedSurface("a", points, np.zeros((0, 3), int), colours[:, :channels])
        page.write_page(tmp_path / "page.html", ViewContents("t", surfaces=[one]))
        data, texts = parts_of(tmp_path / "page.html")
        packed.append(unpacked_bytes(texts[data["surfaces"][0]["colours"]]))
    assert packed[0] == packed[1] == colours[:, :3].tobytes()
