"""Files that a scene names: what lies outside its folder is not opened, what is missing is said,
and all that is read counts in the hash.
"""

import json
import random
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from patience import patience

bpy = pytest.importorskip("bpy", reason="needs the bpy package")
sys.path.insert(0, str(Path(__file__).parent))
import hostile_scenes as hostile  # noqa: E402
import own_scene_files as made  # noqa: E402
from iclnuim import wall  # noqa: E402
from iclnuim.blender.open import scene  # noqa: E402
from iclnuim.errors import InputError  # noqa: E402
from iclnuim.geometry.scene_axes import SceneReading  # noqa: E402

READER = Path(__file__).with_name("outside_reader.py")
SAMPLE = (
    "gltf_image_backslash",
    "obj_mtllib",
    "usd_sublayer",
    "blend_library",
    "blend_mesh_cache",
    "blend_nodes_obj",
)
#: Refused too, though Blender by itself is not seen to open these: it would in a window, aloud, in
#: another version, or beside a real cache.
NOT_SEEN = {
    "gltf_image_file_url", "obj_map_absolute", "obj_mtllib_absolute", "usd_clip", "usd_dome",
    "blend_tiles", "blend_clip", "blend_sound",
    "blend_nodes_obj_inner", "blend_nodes_bake", "blend_osl", "blend_ocean", "blend_point_cache",
    "blend_fluid",
}  # fmt: skip


def opened(files: dict[str, Path], mode: str, finishes: bool = True) -> tuple[set[str], list[dict]]:
    """The ways whose file outside was opened, by any process and under any name, and the reader's
    rows.
    """
    root = next(iter(files.values())).parents[2]
    (root / mode).mkdir()
    trace = root / f"{mode}.trace"
    rows = root / mode / "rows.jsonl"
    watch = ["strace", "-f", "-y", "-qq", "-e", "trace=open,openat,openat2,creat", "-o", str(trace)]
    command = [*watch, sys.executable, str(READER), str(rows), mode, *map(str, files.values())]
    done = subprocess.run(
        command, cwd=root, capture_output=True, timeout=patience(1800), check=False
    )
    assert done.returncode == 0 or not finishes, done.stderr[-2000:]
    if mode == "walled" and finishes:  # the trace shows that they were tried
        assert re.search(r"/outside/[^\n]*EACCES", trace.read_text(errors="replace"))
    found = re.findall(
        rf"= \d+<{re.escape(str(root))}/outside/([^./>]+)", trace.read_text(errors="replace")
    )
    if not finishes:
        return set(found), []
    return set(found), [json.loads(row) for row in rows.read_text().splitlines()]


@pytest.mark.parametrize(
    "ways", [SAMPLE, pytest.param(tuple(hostile.WAYS), marks=pytest.mark.slow)], ids=["some", "all"]
)
def test_no_way_of_naming_a_file_opens_one_outside(tmp_path, ways):
    if (
        shutil.which("strace") is None
        or subprocess.run(["strace", "true"], capture_output=True).returncode
    ):
        pytest.skip("needs strace, and leave to trace")
    files = {way: hostile.WAYS[way](hostile.Maker(bpy, tmp_path, way)) for way in ways}
    followed = {way: file for way, file in files.items() if way not in NOT_SEEN}
    assert opened(followed, "plain")[0] == set(followed)
    if wall.version():
        assert opened(followed, "walled")[0] == set()
    found, rows = opened(files, "checked")
    assert found == set()
    for row in rows:
        assert re.fullmatch(
            r"[^\n]+/scenes/\w+/[\w.]+: [^:].*own folder, found .+; try .+", row["refused"]
        ), row


@pytest.mark.slow
def test_damaged_scenes_open_nothing_outside_behind_the_wall(tmp_path):
    """Bytes changed anywhere, so that the search for names may not find what Blender finds; each in
    a process of its own, which may crash.
    """
    if shutil.which("strace") is None or not wall.version():
        pytest.skip("needs strace and Landlock")
    rng = random.Random(16)
    for number in range(100):
        way = rng.choice(sorted(set(hostile.WAYS) - NOT_SEEN))
        file = file_of(tmp_path / str(number), way)
        content = bytearray(file.read_bytes())
        for _ in range(rng.randint(1, 8)):
            content[rng.randrange(len(content))] = rng.randrange(256)
        file.write_bytes(content)
        assert opened({way: file}, "walled", finishes=False)[0] == set(), (number, way)


def file_of(tmp_path, way):
    return hostile.WAYS[way](hostile.Maker(bpy, tmp_path, way))


@pytest.mark.parametrize("way", ["gltf_image", "obj_mtllib", "usd_reference", "blend_mesh_cache"])
def test_who_means_it_allows_what_lies_outside_and_it_counts(tmp_path, way):
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
def test_every_layer_counts_in_the_hash(tmp_path, way):
    file = inside(tmp_path, way)
    scene.open_scene(str(file))
    before = scene.scene_sha256(str(file))
    named = next(p for p in file.parent.iterdir() if p.stem == way)
    named.write_bytes(named.read_bytes() + b"\n# more")
    assert scene.scene_sha256(str(file)) != before


@pytest.mark.parametrize(
    ("way", "words"),
    [
        ("obj_mtllib", r"missing \(obj_mtllib.mtl\)"),
        ("usd_reference", r"missing \(usd_reference.usda\)"),
        ("blend_mesh_cache", r"missing \(blend_mesh_cache.pc2\)"),
        ("blend_library", r"missing \(blend_library.blend\)"),
    ],
)
def test_what_is_missing_is_said(tmp_path, way, words):
    file = file_of(tmp_path, way)
    shutil.rmtree(tmp_path / "outside")
    notes = scene.open_scene(str(file))
    assert any(re.search(words, note) for note in notes), notes


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
