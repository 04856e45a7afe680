"""Frames of simulated scenes are those of a simulation from its start, whichever are rendered."""

import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")
sys.path.insert(0, str(Path(__file__).parent))
import own_scene_files as made  # noqa: E402
import simulated_scenes  # noqa: E402
from iclnuim.blender.open import motion, scene, simulations  # noqa: E402
from iclnuim.blender.open.run_frames import RunFrames  # noqa: E402
from iclnuim.blender.render import run_recipe, worker  # noqa: E402
from iclnuim.console import Console  # noqa: E402
from iclnuim.errors import InputError, WorkError  # noqa: E402
from iclnuim.geometry.camera import PinholeCamera  # noqa: E402
from iclnuim.geometry.se3 import SE3  # noqa: E402
from iclnuim.geometry.trajectory import Trajectory  # noqa: E402
from iclnuim.headless.farm import tasks  # noqa: E402
from iclnuim.headless.farm.run_plan import RunPlan  # noqa: E402
from iclnuim.job import RenderJob  # noqa: E402
from iclnuim.scene_files.blend_file import may_simulate  # noqa: E402
from iclnuim.trajectory_files.trajectories import write_trajectory  # noqa: E402

FRAMES = 11
#: Those of each run that a test of all classes renders.
SPLITS = ([10], [5, 0], [3, 10])
DEFAULT = ("rigid", "zone")
LOOKS_DOWN = np.array([[1, 0, 0, 0], [0, -1, 0, -1.0], [0, 0, -1, 4.0], [0, 0, 0, 1]])


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("ICLNUIM_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache/simulations"


def kinds():
    for kind in simulated_scenes.KINDS:
        marks = () if kind in DEFAULT else pytest.mark.slow
        yield pytest.param(kind, marks=marks)


def job_of(file, poses=2 * FRAMES):
    turned = LOOKS_DOWN @ np.array(
        [[1, 0, 0, 0], [0, 0.8, -0.6, 0], [0, 0.6, 0.8, 0], [0, 0, 0, 1]]
    )
    whole = Trajectory.at_rate(SE3.from_matrix(np.repeat(turned[None], poses, 0)))
    trajectory = file.with_name(f"poses{poses}.txt")
    write_trajectory(trajectory, whole, "tum")
    camera = PinholeCamera(48, 36, 36, 36, 23.5, 17.5)
    names = {"sequence": "own", "scene": str(file), "trajectory": str(trajectory)}
    return RenderJob(**names, camera=camera, light="path", samples=1)


def render(job, numbers, out):
    """Z of the frames, each run in an own folder, and the notes."""
    notes = []
    with worker.Session(job, out, notes.append, threads=1, last=max(numbers)) as session:
        session.render(numbers, lambda: False)
    found = {}
    for number in numbers:
        found[number] = (out / f"exr/{number:06}.exr").read_bytes()
    return found, [note.text for note in notes if hasattr(note, "text")]


@pytest.mark.parametrize("kind", list(kinds()))
def test_a_frame_is_the_same_whichever_others_are_rendered(kind, tmp_path, cache):
    file = simulated_scenes.write(bpy, kind, tmp_path)
    job = job_of(file)
    whole, notes = render(job, range(FRAMES), tmp_path / "whole")
    assert any("simulations (" in note and "baked up to frame 10" in note for note in notes)
    assert whole[2] != whole[10]
    for k, numbers in enumerate(SPLITS):
        if k == 1:
            next(cache.glob("*/*.blend")).unlink()
        part, _ = render(job, numbers, tmp_path / f"part{k}")
        assert all(part[n] == whole[n] for n in numbers)
    assert not list(tmp_path.glob("blendcache*"))


@pytest.mark.parametrize("kind", list(kinds()))
def test_the_frames_are_those_of_blender_played_from_its_start(kind, tmp_path):
    file = simulated_scenes.write(bpy, kind, tmp_path)
    with_bake = states(file, FRAMES)
    longer = states(file, 30)
    bpy.ops.wm.open_mainfile(filepath=str(file))
    played = [state(frame) for frame in range(FRAMES)]
    for frame in range(2, FRAMES):  # a particle of frame 1 is baked where it is emitted
        assert with_bake[frame] == pytest.approx(played[frame], abs=1e-5)
        assert np.array_equal(with_bake[frame], longer[frame])


def states(file, frames):
    scene.open_scene(str(file), None, RunFrames(frames, frames - 1))
    return [state(frame) for frame in [10, *range(FRAMES)]][1:]


def state(frame):
    """All vertices of meshes in the world, and ends of hair."""
    bpy.context.scene.frame_set(frame)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    points = []
    for instance in depsgraph.object_instances:
        if instance.object.type == "MESH":
            places = [instance.matrix_world @ v.co for v in instance.object.data.vertices]
            points += sorted(tuple(place) for place in places)
    for system in bpy.data.objects["crate"].evaluated_get(depsgraph).particle_systems:
        if system.settings.type == "HAIR":
            thing = bpy.data.objects["crate"].evaluated_get(depsgraph)
            points += [tuple(system.co_hair(thing, particle_no=k, step=4)) for k in range(30)]
    return np.array(sorted(points))


def test_a_file_that_may_have_simulations_is_known_without_opening_it(tmp_path):
    simulated = simulated_scenes.write(bpy, "rigid", tmp_path)
    assert may_simulate(simulated)
    linking = tmp_path / "linking.blend"
    made.fresh(bpy)
    with bpy.data.libraries.load(str(simulated), link=True) as (_, linked):
        linked.objects = ["floor"]
    bpy.context.scene.collection.objects.link(linked.objects[0])
    bpy.ops.wm.save_as_mainfile(filepath=str(linking))
    assert may_simulate(linking)
    made.fresh(bpy)
    made.box(bpy, "box", (0, 0, 0), (1, 1, 1))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "still.blend"), compress=True)
    assert not may_simulate(tmp_path / "still.blend")
    assert not may_simulate(tmp_path / "room.glb")
    (tmp_path / "bad.blend").write_bytes(b"BLENDER")
    assert may_simulate(tmp_path / "bad.blend")


@pytest.mark.slow
def test_a_task_of_its_own_bakes_what_the_tasks_of_frames_show(tmp_path, cache):
    job = job_of(simulated_scenes.write(bpy, "rigid", tmp_path))
    whole, _ = render(job, range(FRAMES), tmp_path / "whole")
    next(cache.glob("*/*.blend")).unlink()
    plan = RunPlan(job, tmp_path / "raw", tuple(range(FRAMES)))
    given = (Console(quiet=True), lambda number: None)
    tasks.run("simulations", plan, *given)
    assert [copy.stem for copy in cache.glob("*/*.blend")] == ["10"]
    for numbers in ((0, 1), (9, 10)):
        assert tasks.run("frames", replace(plan, numbers=numbers), *given) == 0
    assert [copy.stem for copy in cache.glob("*/*.blend")] == ["10"]
    for number in (0, 1, 9, 10):
        assert (plan.raw / f"exr/{number:06}.exr").read_bytes() == whole[number]


def test_the_file_stays_and_its_textures_are_found_from_the_copy(tmp_path, cache):
    file = simulated_scenes.write(bpy, "rigid", tmp_path)
    before = file.read_bytes()
    plain = run_recipe.recipe(job_of(file))["scene_sha256"]
    scene.open_scene(str(file), None, RunFrames(FRAMES, 10))
    assert bpy.data.filepath == str(next(cache.glob("*/*.blend")))
    assert Path(bpy.data.images["floor"].filepath) == tmp_path / "floor.png"
    assert file.read_bytes() == before
    assert scene.scene_sha256(str(file)) == plain
    assert motion.moving_names(bpy.context.scene) == ["crate"]


def test_what_is_baked_in_the_file_is_not_baked_again(tmp_path, cache):
    file = simulated_scenes.write(bpy, "rigid", tmp_path)
    bpy.context.scene.rigidbody_world.point_cache.frame_end = 5
    bpy.ops.ptcache.bake_all(bake=True)
    bpy.ops.wm.save_mainfile()
    scene.open_scene(str(file), None, RunFrames(FRAMES, 10))
    assert not list(cache.glob("*/*.blend"))


def test_a_cache_that_cannot_be_written_and_a_full_disk(tmp_path, cache, monkeypatch):
    file = simulated_scenes.write(bpy, "rigid", tmp_path)
    cache.parent.mkdir()
    cache.write_text("not a folder")
    assert any(
        "baked up to frame" in note
        for note in scene.open_scene(str(file), None, RunFrames(FRAMES, 10))
    )
    assert bpy.data.filepath == str(file)
    cache.unlink()
    monkeypatch.setattr(simulations.shutil, "disk_usage", lambda path: NoSpace)
    with pytest.raises(WorkError, match="simulations need up to"):
        scene.open_scene(str(file), None, RunFrames(FRAMES, 10))


class NoSpace:
    free = 1000


def test_a_bake_ends_at_the_last_frame_and_serves_shorter_runs(tmp_path, cache):
    file = simulated_scenes.write(bpy, "rigid", tmp_path)
    for last, kept in ((5, ["5"]), (3, ["5"]), (8, ["5", "8"]), (6, ["5", "8"])):
        scene.open_scene(str(file), None, RunFrames(61, last))
        assert sorted(copy.stem for copy in cache.glob("*/*.blend")) == kept
        assert bpy.context.scene.rigidbody_world.point_cache.frame_end == 6 + 3 * (last > 5)
    assert bpy.context.scene.frame_end == 60


def test_what_a_killed_process_has_left_is_removed(tmp_path, cache):
    file = simulated_scenes.write(bpy, "rigid", tmp_path)
    scene.open_scene(str(file), None, RunFrames(FRAMES, 3))
    folder = next(cache.glob("*"))
    (folder / "9-123.tmp.blend").write_bytes(b"half")
    scene.open_scene(str(file), None, RunFrames(FRAMES, 9))
    assert sorted(copy.name for copy in folder.iterdir()) == ["3.blend", "9.blend"]


@pytest.mark.parametrize("kind", ["rigid", "zone", "hair"])
def test_a_bake_says_what_it_takes_and_what_is_left(kind, tmp_path, monkeypatch):
    file = simulated_scenes.write(bpy, kind, tmp_path)
    monkeypatch.setattr(simulations, "_REPORT_S", 0.0)
    told = []
    scene.open_scene(str(file), None, RunFrames(61, 30, told.append))
    assert re.fullmatch(
        r"simulations \(crate\): a bake up to frame 30 takes about \d+ s and up to 0.\d MB", told[0]
    )
    counts = [
        int(re.match(r"simulations: (\d+)/31 frames, \d+ s left", text)[1]) for text in told[1:]
    ]
    assert counts[-1] >= 30


def test_a_session_goes_on_beyond_the_last_frame_that_it_was_opened_for(tmp_path):
    job = job_of(simulated_scenes.write(bpy, "rigid", tmp_path))
    whole, _ = render(job, range(FRAMES), tmp_path / "whole")
    with worker.Session(job, tmp_path / "run", lambda event: None, 1, (), 3) as session:
        session.render([3], lambda: False)
        session.render([10], lambda: False)
    for number in (3, 10):
        assert (tmp_path / f"run/exr/{number:06}.exr").read_bytes() == whole[number]


FLUIDS = """
import os, sys, bpy
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
for name, kind in (("flow", "FLOW"), ("domain", "DOMAIN")):
    fluid = bpy.data.objects["crate"].modifiers.new("fluid", "FLUID")
    fluid.fluid_type = kind
    if kind == "DOMAIN":
        fluid.domain_settings.cache_directory = "//fluid"
    bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1].replace("scene", name))
    bpy.data.objects["crate"].modifiers.remove(fluid)
os._exit(0)
"""


@pytest.fixture
def fluids(tmp_path):
    """Files made by another process, which a domain would end: flow.blend and domain.blend."""
    file = simulated_scenes.write(bpy, "rigid", tmp_path)
    subprocess.run([sys.executable, "-c", FLUIDS, str(file)], check=False, capture_output=True)
    shutil.rmtree(tmp_path / "fluid", ignore_errors=True)
    return tmp_path


def test_a_fluid_that_is_not_baked_is_refused_before_it_is_opened(fluids):
    scene.open_scene(str(fluids / "flow.blend"))
    with pytest.raises(InputError, match="expected (no|baked) fluids"):
        scene.open_scene(str(fluids / "domain.blend"))
    assert not (fluids / "fluid").exists()


def test_a_fluid_in_a_library_is_refused_before_it_is_opened(fluids):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(fluids / "flow.blend"), link=True) as (_, linked):
        linked.objects = ["crate"]
    bpy.context.scene.collection.objects.link(linked.objects[0])
    bpy.ops.wm.save_as_mainfile(filepath=str(fluids / "main.blend"))
    (fluids / "domain.blend").replace(fluids / "flow.blend")
    with pytest.raises(InputError, match="flow.blend: expected (no|baked) fluids"):
        scene.open_scene(str(fluids / "main.blend"))
    assert not (fluids / "fluid").exists()
