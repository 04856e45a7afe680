"""Every command that opens a scene in its own process loads Blender behind the kernel's wall."""

import subprocess
import sys
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")
sys.path.insert(0, str(Path(__file__).parent))
import own_scene_files as made  # noqa: E402
from iclnuim import wall  # noqa: E402

#: Runs a command; when it loads Blender, in whichever process, tries to open a file outside.
WATCHED = """
import os, sys
secret, *words = sys.argv[1:]
said = os.dup(2)
def watch(event, arguments):
    if event == "import" and arguments[0] == "bpy":
        try:
            os.close(os.open(secret, os.O_RDONLY))
            os.write(said, b"<open>")
        except PermissionError:
            os.write(said, b"<refused>")
sys.addaudithook(watch)
from iclnuim.headless import cli
sys.exit(cli.main(words))
"""
QUAD = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 2
property list uchar int vertex_indices
end_header
-1 -1 0
1 -1 0
1 1 0
-1 1 0
3 0 1 2
3 0 2 3
"""
COMMANDS = {
    "bake": ["bake", "{scene}", "--map-size", "16", "--map-samples", "2"],
    "surface": ["surface", "{scene}", "-o", "{out}/surface.ply"],
    "evaluate surface": ["evaluate", "surface", "{mesh}", "--model", "{scene}"],
    "view": ["view", "{scene}", "--no-open", "-o", "{out}/view.html"],
}


@pytest.mark.skipif(not wall.version(), reason="this kernel has no Landlock")
@pytest.mark.parametrize("name", COMMANDS)
def test_blender_is_loaded_behind_the_wall_of_the_scene(tmp_path, monkeypatch, name):
    for folder in ("scene", "out", "secret"):
        (tmp_path / folder).mkdir()
    made.fresh(bpy)
    made.box(bpy, "box", (0, 0, 0), (2, 2, 2), made.material(bpy, "m"))
    scene = tmp_path / "scene/room.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(scene))
    secret = tmp_path / "secret/key"
    secret.write_text("secret")
    mesh = tmp_path / "out/mesh.ply"
    mesh.write_text(QUAD)
    monkeypatch.setenv("ICLNUIM_CACHE", str(tmp_path / "cache"))
    words = [word.format(scene=scene, out=tmp_path / "out", mesh=mesh) for word in COMMANDS[name]]
    command = [sys.executable, "-c", WATCHED, str(secret), *words]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert "<refused>" in done.stderr
    assert "<open>" not in done.stderr
