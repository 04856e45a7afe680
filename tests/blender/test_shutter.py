"""Motion blur and rolling shutter of rendered frames against the pinhole formula: a bright edge
that the camera passes.
"""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")

DISTANCE_M = 3.0
STEP_M = 0.19
EDGE_M = 0.313
WIDTH = 160
HEIGHT = 120
F = 120.0
MOTION_PX = F * STEP_M / DISTANCE_M


@pytest.fixture(scope="module")
def edge(tmp_path_factory):
    """A sheet that glows evenly, from x = -9 to EDGE_M, before black; and a path that steps STEP_M
    to the right each frame.
    """
    folder = tmp_path_factory.mktemp("edge")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    mesh = bpy.data.meshes.new("sheet")
    mesh.from_pydata(
        [
            (-9, DISTANCE_M, -9),
            (EDGE_M, DISTANCE_M, -9),
            (EDGE_M, DISTANCE_M, 9),
            (-9, DISTANCE_M, 9),
        ],
        [],
        [(0, 1, 2, 3)],
    )
    material = bpy.data.materials.new("glow")
    material.use_nodes = True
    material.node_tree.nodes.clear()
    glow = material.node_tree.nodes.new("ShaderNodeEmission")
    out = material.node_tree.nodes.new("ShaderNodeOutputMaterial")
    material.node_tree.links.new(glow.outputs[0], out.inputs[0])
    mesh.materials.append(material)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("sheet", mesh))
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "edge.blend"))
    half = np.sqrt(0.5)
    rows = [(k / 30, STEP_M * (k - 2), 0, 0, -half, 0, 0, half) for k in range(5)]
    np.savetxt(folder / "path.txt", rows, fmt="%.9f")
    return folder


def shot(render_here, edge, out, **shutter):
    """Light (h, w) of frame 2, in which the camera stands at x = 0, and depth."""
    from iclnuim.formats.exr import read_exr

    camera = f"{WIDTH}x{HEIGHT},{F},{F},{WIDTH / 2 - 0.5},{HEIGHT / 2 - 0.5}"
    place = {"scene": edge / "edge.blend", "trajectory": edge / "path.txt", "camera": camera}
    render_here(out, "2", **place, samples=1, **shutter)
    channels = read_exr(out / "exr/000002.exr")
    return channels["G"].astype(float), channels["Z"]


@pytest.fixture(scope="module")
def sharp(render_here, edge, tmp_path_factory):
    return shot(render_here, edge, tmp_path_factory.mktemp("sharp") / "run")


def edge_px():
    """Where the edge stands in frame 2, in pixels from the left border of the image."""
    return WIDTH / 2 + F * EDGE_M / DISTANCE_M


def test_a_sharp_frame_has_the_edge_where_the_formula_puts_it(sharp):
    assert np.abs(sharp[0].sum(1) - edge_px()).max() <= 0.5


def test_an_exposure_of_a_frame_blurs_the_edge_over_the_motion_of_a_frame(
    render_here, edge, sharp, tmp_path
):
    light, depth = shot(render_here, edge, tmp_path / "run", exposure_s=1 / 30)
    row = light[HEIGHT // 2]
    x = np.arange(WIDTH) + 0.5
    expected = np.clip((edge_px() + MOTION_PX / 2 - x) / MOTION_PX, 0, 1)
    assert np.abs(row - expected).max() <= 0.5 / 8 + 0.07  # eight instants: steps of an eighth
    assert np.abs(light.sum(1) - edge_px()).max() < 0.2
    assert ((row > 0.01) & (row < 0.99)).sum() == pytest.approx(MOTION_PX, abs=1)
    assert np.array_equal(depth, sharp[1])


def test_a_rolling_shutter_slants_the_edge_by_the_motion_during_readout(
    render_here, edge, sharp, tmp_path
):
    light, depth = shot(render_here, edge, tmp_path / "run", readout_s=1 / 30)
    rows = (np.arange(HEIGHT) + 0.5) / HEIGHT - 0.5
    expected = edge_px() - rows * MOTION_PX
    assert np.abs(light.sum(1) - expected).max() <= 0.5 + 0.1
    slope = np.polyfit(rows, light.sum(1), 1)[0]
    assert slope == pytest.approx(-MOTION_PX, abs=0.15)
    assert np.array_equal(depth, sharp[1])


def test_a_blurred_frame_is_the_same_bytes_whenever_it_is_rendered(render_here, edge, tmp_path):
    a = shot(render_here, edge, tmp_path / "a", exposure_s=0.02, readout_s=0.02)
    b = shot(render_here, edge, tmp_path / "b", exposure_s=0.02, readout_s=0.02)
    assert np.array_equal(a[0], b[0]) and np.array_equal(a[1], b[1])
    assert (tmp_path / "a/exr/000002.exr").read_bytes() == (
        tmp_path / "b/exr/000002.exr"
    ).read_bytes()
