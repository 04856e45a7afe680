"""The light that travels with the built-in rooms: it fits them, is small, and is left aside where
anything else is asked for.
"""

import shutil

import pytest
from iclnuim import shipped
from iclnuim.formats.exr import read_exr
from iclnuim.formats.files import read_json, write_json
from iclnuim.job import shipped_job, shipped_light

pytest.importorskip("bpy", reason="needs the bpy package")

from iclnuim.blender import surfaces  # noqa: E402
from iclnuim.blender.light import light_files  # noqa: E402
from iclnuim.blender.open import scene  # noqa: E402
from iclnuim.blender.render.job_scene import JobScene  # noqa: E402

ROOMS = shipped.SCENE_NAMES


@pytest.mark.parametrize("room", ROOMS)
def test_it_fits_the_room_as_it_is(room):
    """Where this fails, the room was built anew: `python tools/ship_light.py ROOM` bakes its light
    again.
    """
    folder = shipped_light(shipped_job(f"{room}/kt0"))
    assert folder == shipped.folder("blend") / "light" / room
    recipe = light_files.read_recipe(folder)
    layout = light_files.load_layout(folder)
    assert recipe["psnr_db"] >= 55
    channels = read_exr(folder / light_files.MAP)
    assert {c.shape for c in channels.values()} == {(2048, 2048)} and channels.keys() == set("RGB")
    scene.open_scene(room)
    with surfaces.rendered_parts() as (found, _):
        assert layout.part_corners == tuple(len(part.mesh.loops) for part in found)


def test_both_together_are_small():
    files = [path for path in (shipped.folder("blend") / "light").rglob("*") if path.is_file()]
    assert 0 < sum(path.stat().st_size for path in files) <= 12e6


def test_nothing_is_baked_where_it_serves(monkeypatch, tmp_path):
    monkeypatch.setenv("ICLNUIM_CACHE", str(tmp_path / "cache"))
    job = shipped_job("living_room/kt2")
    for seed in (0, 5):
        folder, made = JobScene(job.changed(seed=seed), lambda event: None).bake()
        assert not made and folder == shipped_light(job)
    assert not (tmp_path / "cache").exists()


def test_it_is_left_aside_for_other_maps_rooms_and_scenes(monkeypatch, tmp_path, repository):
    job = shipped_job(f"{ROOMS[0]}/kt1")
    room = ROOMS[0]
    others = (
        {"map_size": 512},
        {"map_samples": 64},
        {"lambertian": True},
        {"scene": str(repository / "tests/room.obj")},
    )
    assert [shipped_light(job.changed(**other)) for other in others] == [None] * 4
    blend = shutil.copytree(
        shipped.folder("blend"), tmp_path / "blend", ignore=shutil.ignore_patterns("builder")
    )
    monkeypatch.setattr(shipped, "folder", lambda name: blend)
    assert shipped_light(job) == blend / "light" / room
    light = blend / "light" / room / light_files.MAP
    light.rename(light.with_name("away"))
    assert shipped_light(job) is None
    light.with_name("away").rename(light)
    recipe = blend / "light" / room / light_files.RECIPE
    changed = read_json(recipe)
    changed["fits"]["scene_sha256"] = "0" * 64
    write_json(recipe, changed)
    assert shipped_light(job) is None
    (blend / "light" / room / light_files.MAP).unlink()
    assert shipped_light(job) is None
