"""Scenes as people keep them, behind the wall of the kernel: each reads all that it names, and shows
what it shows without the wall.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")
sys.path.insert(0, str(Path(__file__).parent))
import own_scene_files as made  # noqa: E402
import simulated_scenes  # noqa: E402
from iclnuim import wall  # noqa: E402

pytestmark = pytest.mark.skipif(not wall.version(), reason="this kernel has no Landlock")

#: Opens a scene, behind its wall or not. Prints what Blender has of it: frame 5 of a simulation,
#: means of pictures, grids of volumes, and what is reported missing. Reads the files of the arguments.
SHOWN = """
import json, os, sys
from pathlib import Path
from iclnuim import scene_wall
from iclnuim.geometry.scene_axes import SceneReading
file, scratch, *named = sys.argv[1:]
os.environ["TMPDIR"] = scratch
if os.environ["WALL"] == "yes":
    assert scene_wall.around(file, SceneReading(), sys.executable, [], [Path(scratch)]).put_up()
assert all(Path(name).read_bytes() for name in named)
import bpy, numpy as np
from iclnuim.blender.open import scene
from iclnuim.blender.surfaces import array_of, rendered_parts
from iclnuim.native_output import native_output_in
with native_output_in(Path(scratch) / "log"):
    notes = scene.open_scene(file)
    bpy.context.scene.frame_set(5)
with rendered_parts() as (parts, _):
    meshes = sorted(
        (p.name, len(p.mesh.polygons), array_of(p.mesh.vertices, "co", 3).sum().item())
        for p in parts
    )
images = [(i.name, list(i.size), float(np.mean(i.pixels[:]))) for i in bpy.data.images if i.size[0]]
grids = [(v.name, v.grids.load(), [g.name for g in v.grids]) for v in bpy.data.volumes]
missing = [note for note in notes if "missing" in note]
print(json.dumps({"meshes": meshes, "images": images, "volumes": grids, "missing": missing}))
sys.stdout.flush()
os._exit(0)
"""


def saved(folder, name="room.blend"):
    """The session, saved with relative paths. Returns the file."""
    file = folder / name
    folder.mkdir(parents=True, exist_ok=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(file))
    bpy.ops.file.make_paths_relative()
    bpy.ops.wm.save_mainfile()
    return file


def room_with(image):
    material = made.material(bpy, "m", image=image)
    for node in material.node_tree.nodes:
        if node.type == "TEX_IMAGE":
            node.image_user.frame_duration = 2
    made.box(bpy, "box", (0, 0, 0), (1, 1, 1), material)


def picture(path):
    """An image that is read from a file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    bpy.data.images.remove(made.picture(bpy, path))
    return bpy.data.images.load(str(path))


def downloads(folder):
    """The folder itself, not one in it."""
    room_with(picture(folder / "textures/wood.PNG"))
    return saved(folder)


def hidden_cache(folder):
    room_with(picture(folder / ".cache/assets/tex/wood.png"))
    return saved(folder / ".cache/assets")


def sequence(folder):
    for number in (0, 1, 2, 10):
        image = picture(folder / f"deep/fire{number}.png")
    image.filepath = str(folder / "deep/fire2.png")
    image.source = "SEQUENCE"
    room_with(image)
    return saved(folder)


def tiles(folder):
    for number in (1002, 1001):
        image = picture(folder / f"tile.{number}.png")
    image.source = "TILED"
    image.filepath = "//tile.<UDIM>.png"
    room_with(image)
    return saved(folder)


def library(folder):
    """It links a file in another folder, with pictures beside that one."""
    lent = sequence(folder / "library")
    made.fresh(bpy)
    with bpy.data.libraries.load(str(lent), link=True, relative=False) as (_, here):
        here.objects = ["box"]
    bpy.context.scene.collection.objects.link(bpy.data.objects["box"])
    return saved(folder)


def volume(folder):
    made.box(bpy, "box", (0, 0, 0), (1, 1, 1))
    smoke = bpy.data.objects.new("smoke", bpy.data.volumes.new("smoke"))
    bpy.context.scene.collection.objects.link(smoke)
    fill = smoke.modifiers.new("fill", "MESH_TO_VOLUME")
    fill.object = bpy.data.objects["box"]
    bpy.ops.wm.usd_export(filepath=str(folder / "made.usda"), export_volumes=True)
    (folder / "made.usda").unlink()
    smoke.modifiers.clear()
    smoke.data.filepath = str(folder / "volumes/smoke.vdb")
    return saved(folder)


def simulation(folder):
    """Cloth whose cache lies beside the file, baked by its author."""
    file = simulated_scenes.write(bpy, "cloth on disk", folder)
    cache = bpy.context.object.modifiers["cloth"].point_cache
    cache.use_disk_cache, cache.frame_start, cache.frame_end = True, 0, 10  # of a saved file
    bpy.ops.ptcache.bake_all(bake=True)
    bpy.ops.wm.save_mainfile()
    return file


def exported(operator, name, **options):
    def make(folder):
        room_with(picture(folder / "tex/wood.png"))
        operator()(filepath=str(folder / name), **options)
        return folder / name

    return make


def usd(folder):
    """A file of references to two others, one of which has a picture."""
    exported(lambda: bpy.ops.wm.usd_export, "parts/box.usdc", export_textures=True)(folder)
    text = "".join(f'def "B{k}" (references = @./parts/{k}.usda@) {{}}\n' for k in (1, 2))
    for k in (1, 2):
        part = 'def Xform "B" (references = @./box.usdc@) {}'
        (folder / f"parts/{k}.usda").write_text(f'#usda 1.0\n(defaultPrim = "B")\n{part}\n')
    (folder / "room.usda").write_text(
        f'#usda 1.0\n(\n    metersPerUnit = 1\n    upAxis = "Z"\n)\n{text}'
    )
    return folder / "room.usda"


#: Name -> the function that makes the scene in a folder, and the ends of the files that it names.
SCENES = {
    "textures beside a scene in Downloads": (downloads, "*.PNG"),
    "a scene in a hidden folder": (hidden_cache, "*.png"),
    "image sequence": (sequence, "*.png"),
    "UDIM": (tiles, "*.png"),
    "library with its textures": (library, "library/**/*[dg]"),
    "volume": (volume, "*.vdb"),
    "simulation": (simulation, "*.bphys"),
    "obj": (exported(lambda: bpy.ops.wm.obj_export, "room.obj", path_mode="RELATIVE"), "*.[mp][tn][lg]"),
    "gltf": (exported(lambda: bpy.ops.export_scene.gltf, "room.gltf", export_format="GLTF_SEPARATE"), "*.bin"),
    "usd with references": (usd, "parts/**/*.*"),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_an_honest_scene_reads_what_it_names(tmp_path, name):
    make, pattern = SCENES[name]
    made.fresh(bpy)
    for folder in ("home", "home/work/parts", "scratch"):
        (tmp_path / folder).mkdir(parents=True)
    file = make(tmp_path / "home/work")
    named = [path for path in (tmp_path / "home/work").rglob(pattern) if path.is_file()]
    assert named, "the scene names files"
    with_wall, without = (shown(tmp_path, file, named, put_up) for put_up in ("yes", "no"))
    assert with_wall == without
    assert with_wall["missing"] == []
    assert with_wall["meshes"]
    if pattern == "*.vdb":
        assert all(loaded and names for _, loaded, names in with_wall["volumes"])
    elif pattern != "*.bphys":
        assert with_wall["images"] and all(mean > 0.4 for _, _, mean in with_wall["images"])


def shown(tmp_path, file, named, put_up):
    command = [sys.executable, "-c", SHOWN, str(file), str(tmp_path / "scratch"), *map(str, named)]
    environment = {**os.environ, "HOME": str(tmp_path / "home"), "WALL": put_up}
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])
