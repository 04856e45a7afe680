"""Files that a scene names: the names are found, what lies outside its folder is refused, what is
missing is reported, and all that is read counts in the hash. The kernel's part is in
tests/test_scene_wall.py.
"""

import re
import shutil
import struct
import subprocess
import sys
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")
sys.path.insert(0, str(Path(__file__).parent))
import hostile_scenes as hostile  # noqa: E402
import own_scene_files as made  # noqa: E402
from iclnuim import wall  # noqa: E402
from iclnuim.blender.open import scene, scene_paths  # noqa: E402
from iclnuim.errors import InputError  # noqa: E402
from iclnuim.geometry.scene_axes import SceneReading  # noqa: E402
from iclnuim.scene_files import blend_file, scene_names, search  # noqa: E402

ONE_LINE = r"[^\n]+/scenes/\w+/[\w.]+: [^:].*own folder, found .+; try .+"


def file_of(tmp_path, way):
    return hostile.WAYS[way](hostile.Maker(bpy, tmp_path, way))


@pytest.mark.parametrize("way", hostile.WAYS)
def test_scene_paths_check_refuses_a_file_outside_however_it_is_named(tmp_path, way):
    file = file_of(tmp_path, way)
    with pytest.raises(InputError) as refused:
        scene_paths.check(file, SceneReading())
    assert re.fullmatch(ONE_LINE, str(refused.value))
    scene_paths.check(file, SceneReading(allow_outside=True))


def test_a_name_with_a_nul_has_no_file(tmp_path):
    """A damaged name, as in some .fbx of the web: the scene itself is read."""
    file = tmp_path / "room.obj"
    file.write_bytes(b"mtllib a\0b/c.mtl\nv 0 0 0\n")
    assert search.readable(file, SceneReading()) == [file]


def test_scene_names_finds_the_paths_of_all_datablocks_of_a_blend(tmp_path):
    """Each by the fields that this Blender writes; libraries, tiles and baked nodes are above."""
    made.fresh(bpy)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    box = made.box(bpy, "box", (0, 0, 0), (1, 1, 1), made.material(bpy, "m"))
    adders = {f"{add.__name__}.file": add for add in (hostile.image, hostile.mesh_cache)}
    adders |= {f"{add.__name__}.file": add for add in (hostile.ocean, hostile.ies, hostile.volume)}
    adders["cache.abc"] = hostile.sequence_cache
    for name, add in adders.items():
        add(bpy, box, f"//{name}")
    nodes = [name for name in ("OBJ", "PLY", "STL", "CSV", "Text", "VDB") if has_import(name)]
    for kind in nodes:
        hostile.import_node(bpy, box, f"//nodes.{kind}", kind)
    (tmp_path / "sound.wav").write_bytes(b"RIFF")
    picture = made.picture(bpy, tmp_path / "clip.png")
    bpy.data.sounds.load("//sound.wav")
    bpy.data.movieclips.load(picture.filepath)
    for block in (*bpy.data.sounds, *bpy.data.movieclips):
        block.use_fake_user = True
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    found = {Path(named.name).name for named in scene_names.named_in(tmp_path / "scene.blend")}
    expected = {*adders, *(f"nodes.{kind}" for kind in nodes), "sound.wav", "clip.png"}
    assert expected <= found


def test_a_blend_whose_paths_are_declared_as_numbers_is_refused(tmp_path):
    """Blender would convert them: the type of one field in the file's description is changed."""
    file = file_of(tmp_path, "blend_mesh_cache")
    with blend_file._opened(file) as whole:  # Blender 5.2 compresses
        content = bytearray(whole.read())
    dna = content.rindex(b"SDNANAME")
    types = content.index(b"TYPE", dna)
    names = content[dna + 12 : types].split(b"\0")
    kinds = content[types + 8 : content.index(b"TLEN", types)].split(b"\0")
    base = struct.pack("<HH", kinds.index(b"ModifierData"), names.index(b"modifier"))
    path = struct.pack("<HH", kinds.index(b"char"), names.index(b"filepath[1024]"))
    struct_number = struct.pack("<H", kinds.index(b"MeshCacheModifierData"))
    begin = re.search(re.escape(struct_number) + b".." + re.escape(base), content[dna:], re.DOTALL)
    at = content.index(path, dna + begin.end())
    content[at : at + 2] = struct.pack("<H", kinds.index(b"uchar"))
    file.write_bytes(content)
    with pytest.raises(InputError, match="damaged blocks: MeshCacheModifierData.filepath of uchar"):
        scene_paths.check(file, SceneReading())


def has_import(kind):
    return hasattr(bpy.types, f"GeometryNodeImport{kind}")


#: Opens a scene as Blender does, without a search for names, behind its wall; then the check of what
#: Blender lists and logs.
BEHIND_THE_WALL = """
import os, sys
from pathlib import Path
from iclnuim import scene_wall
from iclnuim.geometry.scene_axes import SceneReading
file, scratch = map(Path, sys.argv[1:])
os.environ["TMPDIR"] = str(scratch)
assert scene_wall.around(str(file), SceneReading(), sys.executable, [], [scratch]).put_up()
from iclnuim.blender.open import scene, scene_paths  # noqa: E402
scene_paths.check = lambda path, reading: []
try:
    scene.open_scene(str(file))
except Exception as error:
    print("refused:", error)
sys.stdout.flush()
os._exit(0)
"""


@pytest.mark.skipif(not wall.version(), reason="this kernel has no Landlock")
@pytest.mark.parametrize("way", ["usd_sublayer", "blend_mesh_cache", "gltf_image"])
def test_check_open_refuses_what_the_wall_hides_from_blender(tmp_path, way):
    file = file_of(tmp_path, way)
    (tmp_path / "scratch").mkdir()
    command = [sys.executable, "-c", BEHIND_THE_WALL, str(file), str(tmp_path / "scratch")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert re.search(rf"refused: .*own folder, found .*outside/{way}", done.stdout), done


@pytest.mark.parametrize("way", ["gltf_image", "obj_mtllib", "usd_reference", "blend_mesh_cache"])
def test_a_file_outside_that_is_allowed_counts_in_the_hash(tmp_path, way):
    file = file_of(tmp_path, way)
    scene.open_scene(str(file), SceneReading(allow_outside=True))
    before = scene.scene_sha256(str(file))
    outside = next((tmp_path / "outside").iterdir())
    outside.write_bytes(outside.read_bytes() + b"\n# more")
    assert scene.scene_sha256(str(file)) != before


def test_a_folder_of_textures_is_allowed_for_all_formats(tmp_path):
    file = file_of(tmp_path, "usd_texture")
    scene.open_scene(str(file), SceneReading(textures=str(tmp_path / "outside")))
    assert any(image.name == "usd_texture.png" for image in bpy.data.images)


def inside(tmp_path, way):
    """The same file with what it names in its own folder."""
    file = file_of(tmp_path, way)
    for one in list((tmp_path / "outside").iterdir()):
        shutil.move(one, file.parent)
    for one in (p for p in file.parent.iterdir() if p.suffix in (".obj", ".mtl", ".gltf", ".usda")):
        one.write_text(one.read_text().replace("../../outside/", ""))
    return file


@pytest.mark.parametrize(
    "way", ["usd_sublayer", "usd_inner", "usd_payload", "usd_texture", "obj_map", "gltf_buffer"]
)
def test_every_file_that_a_scene_names_counts_in_its_hash(tmp_path, way):
    file = inside(tmp_path, way)
    before = scene.scene_sha256(str(file))
    named = next(p for p in file.parent.iterdir() if p.stem == way)
    named.write_bytes(named.read_bytes() + b"\n# more")
    assert scene.scene_sha256(str(file)) != before


@pytest.mark.parametrize(
    "name",
    [
        "obj_mtllib.mtl",
        "usd_reference.usda",
        "blend_mesh_cache.pc2",
        "blend_library.blend",
    ],
)
def test_open_scene_names_missing_files(tmp_path, name):
    file = file_of(tmp_path, Path(name).stem)
    shutil.rmtree(tmp_path / "outside")
    notes = scene.open_scene(str(file))
    assert any(f"missing ({name})" in note for note in notes), notes


def test_what_is_packed_is_not_looked_for(tmp_path):
    made.fresh(bpy)
    (tmp_path / "scene").mkdir()
    made.picture(bpy, tmp_path / "wall.png")
    image = bpy.data.images.load(str(tmp_path / "wall.png"))
    made.box(bpy, "box", (0, 0, 0), (1, 1, 1), made.material(bpy, "m", image=image))
    image.pack()
    file = tmp_path / "scene/packed.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(file), compress=True)
    scene.open_scene(str(file))
    assert bpy.data.images["wall.png"].packed_file is not None


def test_where_an_fbx_came_from_is_not_looked_for(tmp_path):
    made.fresh(bpy)
    made.box(bpy, "box", (0, 0, 0), (1, 1, 1))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "source.blend"))
    (tmp_path / "scene").mkdir()
    bpy.ops.export_scene.fbx(filepath=str(tmp_path / "scene/box.fbx"))
    assert b"source.blend" in (tmp_path / "scene/box.fbx").read_bytes()
    scene.open_scene(str(tmp_path / "scene/box.fbx"))


def test_a_file_of_the_working_folder_is_outside(tmp_path, monkeypatch):
    """Blender's own paths without // start there."""
    file = file_of(tmp_path, "obj_map")
    (file.parent / "own.mtl").write_text("newmtl m\nmap_Kd obj_map.png\n")
    monkeypatch.chdir(tmp_path / "outside")
    with pytest.raises(InputError, match="own.mtl: line 2: .*found obj_map.png"):
        scene.open_scene(str(file))
    shutil.copy(tmp_path / "outside/obj_map.png", file.parent)
    scene.open_scene(str(file))
