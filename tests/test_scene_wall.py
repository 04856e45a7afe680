"""The wall around a process that opens a scene: what it reads and writes, and who opens its gate."""

import ctypes
import json
import os
import socket
import struct
import subprocess
import sys
from pathlib import Path

import pytest
from iclnuim import scene_wall, wall
from iclnuim.errors import InputError
from iclnuim.geometry.scene_axes import SceneReading
from iclnuim.scene_files import search

WALL = Path(wall.__file__)
#: Opens the files of its arguments, to read or (`+`) to write, and prints which it could open.
TRIES = """
import json, sys
opened = {}
for name in sys.argv[1:]:
    try:
        open(name.lstrip("+"), "ab" if name.startswith("+") else "rb").close()
        opened[name] = True
    except PermissionError:
        opened[name] = False
print(json.dumps(opened))
"""
PYTHON = [sys.executable, "-I", "-c"]
needs_landlock = pytest.mark.skipif(not wall.version(), reason="this kernel has no Landlock")


def launcher(folder, paths):
    """The command in front of another one, which puts up the wall."""
    options = folder / "options.json"
    options.write_text(json.dumps({"wall": paths.to_dict()}))
    return [sys.executable, "-I", "-S", str(WALL), str(options)]


def tried(command, names, **how):
    done = subprocess.run(
        [*command, *PYTHON, TRIES, *names], capture_output=True, check=True, **how
    )
    return json.loads(done.stdout)


@pytest.fixture
def folder(tmp_path):
    contents = {
        "scene/room.obj": "mtllib sub/room.mtl\n",
        "scene/sub/room.mtl": "map_Kd wall.png\nmap_Ks shiny/Gloss.PNG\n",
        "scene/.config/key": "key",
    }
    names = ("scene/sub/wall.png", "scene/sub/shiny/gloss.png", "scene/diary.txt")
    contents |= dict.fromkeys((*names, "textures/wood.png", "secret/key"), "x")
    for name, content in contents.items():
        (tmp_path / name).parent.mkdir(exist_ok=True, parents=True)
        (tmp_path / name).write_text(content)
    (tmp_path / "out").mkdir()
    (tmp_path / "scene/link.png").symlink_to(tmp_path / "secret/key")
    return tmp_path


def around(folder, **reading):
    scene = str(folder / "scene/room.obj")
    settings = SceneReading(**reading)
    return scene_wall.around(scene, settings, sys.executable, [], [folder / "out"])


@needs_landlock
def test_the_scene_and_what_it_names_are_read_the_runs_is_written_and_nothing_else(folder):
    may = {
        "scene/room.obj": True,
        "scene/sub/room.mtl": True,
        "scene/sub/wall.png": True,
        "scene/sub/shiny/gloss.png": True,
        "scene/diary.txt": False,
        "scene/.config/key": False,
        "scene/link.png": False,
        "scene/../secret/key": False,
        "textures/wood.png": False,
    }
    expected = {f"{folder}/{name}": answer for name, answer in may.items()}
    expected |= {f"+{folder}/{name}": False for name in ("scene/room.obj", "scene/new", "new")}
    expected |= {f"+{folder}/out/frame": True, "/etc/hostname": False, "/etc/passwd": True}
    assert tried(launcher(folder, around(folder)), expected) == expected


def readable(folder, name, content=None, **reading):
    """Names below the folder that a process may read which opens the scene `name`."""
    if content is not None:
        (folder / name).write_text(content)
    found = search.readable(folder / name, SceneReading(**reading))
    return sorted(str(path.relative_to(folder)) for path in found)


def test_frames_of_a_sequence_are_read_of_which_the_scene_names_one(folder):
    for number in (7, 8, 12):
        (folder / f"scene/fire{number}.png").write_text("x")
    (folder / "scene/room.mtl").write_text("map_Kd fire7.png\n")
    found = readable(folder, "scene/room.obj", "mtllib room.mtl\n")
    assert found == [
        f"scene/{n}" for n in ("fire12.png", "fire7.png", "fire8.png", "room.mtl", "room.obj")
    ]


@pytest.mark.parametrize("name", [".config/key", "link.png", "../secret/key"])
def test_a_name_through_a_hidden_folder_counts_as_one_outside(folder, name):
    scene = folder / "scene/room.obj"
    assert not search.allowed(scene, scene.parent / name, SceneReading())
    assert readable(folder, "scene/room.obj", f"mtllib {name}\n") == ["scene/room.obj"]


def test_a_folder_that_the_scene_may_not_read_is_not_listed(folder, monkeypatch):
    listed = []
    for name in ("listdir", "scandir"):
        real = getattr(os, name)
        monkeypatch.setattr(
            os, name, lambda place, real=real: (listed.append(Path(place).name), real(place))[1]
        )
    names = ("sub/none.mtl", ".config/key", ".config/none.mtl", "../secret/none.mtl")
    for name in (*names, "../secret/none.<UDIM>.mtl", "../secret/none.##.mtl", "sub/a.<UDIM>.mtl"):
        readable(folder, "scene/room.obj", f"mtllib {name}\n")
    assert set(listed) <= {"scene", "sub"}


@pytest.mark.parametrize(
    ("pattern", "name"),
    [("a.<UDIM>.png", "a.1012.png"), ("<UVTILE>.png", "u2_v2.png"), ("a.###.png", "a.012.png")],
)
def test_tiles_and_frames_outside_are_found_by_their_numbers(folder, pattern, name):
    """So that they are refused, and read where they are allowed."""
    (folder / "scene/sub/room.mtl").write_text(f"map_Kd ../../secret/{pattern}\n")
    scene = folder / "scene/room.obj"
    (folder / "secret" / name).write_text("x")
    (folder / "secret" / name.replace("2", "x")).write_text("x")
    there = {one.name for _, _, found in search.walk(scene) for one in found}
    assert there == {"room.mtl", name}


def test_a_scene_in_a_hidden_folder_reads_what_lies_beside_it(folder):
    (folder / "scene/.config/own.mtl").write_text("map_Kd key\n")
    found = readable(folder, "scene/.config/room.obj", "mtllib own.mtl\n")
    assert found == [f"scene/.config/{name}" for name in ("key", "own.mtl", "room.obj")]


def test_layers_that_cannot_be_listed_keep_the_folder_but_not_what_is_hidden(folder, monkeypatch):
    monkeypatch.delitem(sys.modules, "bpy", raising=False)  # which lists them
    layer = "#usda 1.0\n"
    assert readable(folder, "scene/sub/room.usda", layer) == ["scene/sub", "scene/sub/room.usda"]
    names = ("diary.txt", "room.obj", "room.usda", "sub")
    assert readable(folder, "scene/room.usda", layer) == [f"scene/{name}" for name in names]
    monkeypatch.setenv("HOME", str(folder / "scene"))
    assert readable(folder, "scene/room.usda") == ["scene/room.usda"]


@needs_landlock
def test_the_user_allows_a_folder_or_all(folder):
    names = [str(folder / name) for name in ("textures/wood.png", "secret/key")]
    one = around(folder, textures=str(folder / "textures"))
    assert list(tried(launcher(folder, one), names).values()) == [True, False]
    names.append(f"+{folder}/secret/new")
    every = around(folder, allow_outside=True)
    assert list(tried(launcher(folder, every), names).values()) == [True, True, False]


@needs_landlock
def test_what_the_wall_surrounds_cannot_take_it_down(folder):
    inner = launcher(folder / "out", scene_wall.SceneWall(("/",), ("/",)))
    secret = str(folder / "secret/key")
    assert tried([*launcher(folder, around(folder)), *inner], [secret]) == {secret: False}
    assert tried(inner, [secret]) == {secret: True}


#: Connects to a TCP and a UDP port, to an abstract socket, and signals a process; prints what it may.
REACHES = """
import os, socket, sys
def tcp():
    socket.create_connection(("127.0.0.1", int(sys.argv[1])))
def bind():
    socket.create_server(("127.0.0.1", 0))
def udp():
    socket.socket(socket.AF_INET, socket.SOCK_DGRAM).sendto(b"x", ("127.0.0.1", int(sys.argv[1])))
def abstract():
    socket.socket(socket.AF_UNIX).connect("\\0" + sys.argv[2])
def signal():
    os.kill(int(sys.argv[3]), 0)
for one in (tcp, bind, udp, abstract, signal):
    try:
        one()
        print(one.__name__)
    except PermissionError:
        pass
"""


@needs_landlock
def test_nothing_outside_is_connected_to_or_signalled_where_the_kernel_can_refuse_it(folder):
    name = f"iclnuim-test-{os.getpid()}"
    with socket.create_server(("127.0.0.1", 0)) as server, socket.socket(socket.AF_UNIX) as unix:
        unix.bind("\0" + name)
        unix.listen()
        words = [str(server.getsockname()[1]), name, str(os.getpid())]
        command = [*PYTHON, REACHES, *words]
        free = subprocess.run(command, capture_output=True, check=True, text=True)
        assert free.stdout.split() == ["tcp", "bind", "udp", "abstract", "signal"]
        walled = [*launcher(folder, around(folder)), *command]
        done = subprocess.run(walled, capture_output=True, check=True, text=True)
    refused = wall.refused(wall.version())
    may = [] if "TCP" in refused else ["tcp", "bind"]
    may += [] if "UDP" in refused else ["udp"]
    may += [] if "abstract sockets, signals" in refused else ["abstract", "signal"]
    assert done.stdout.split() == may


def test_a_kernel_is_asked_for_no_right_that_it_does_not_know():
    """Bits of include/uapi/linux/landlock.h: 0 and 1 TCP, 2 and 3 UDP."""
    assert [wall.handled(known)[1] for known in (3, 4, 9, 10, 99)] == [
        0,
        0b11,
        0b11,
        0b1111,
        0b1111,
    ]
    assert [wall.handled(known)[2] for known in (5, 6)] == [0, 0b11]
    assert wall.refused(10) == ["files", "TCP", "UDP", "abstract sockets, signals"]


def without_landlock():
    """Let landlock_create_ruleset answer ENOSYS in this process and its children, by seccomp."""
    load, equal, answer = 0x20, 0x15, 0x06
    program = [
        (load, 0, 0, 0),  # the number of the system call
        (equal, 0, 1, 444),
        (answer, 0, 0, 0x00050000 | 38),  # SECCOMP_RET_ERRNO, ENOSYS
        (answer, 0, 0, 0x7FFF0000),  # SECCOMP_RET_ALLOW
    ]
    code = ctypes.create_string_buffer(b"".join(struct.pack("HBBI", *line) for line in program))
    filters = struct.pack("HP", len(program), ctypes.addressof(code))
    libc = ctypes.CDLL(None, use_errno=True)
    assert libc.prctl(38, 1, 0, 0, 0) == 0
    assert libc.prctl(22, 2, filters, 0, 0) == 0


@pytest.mark.skipif(sys.platform != "linux", reason="seccomp is of Linux")
def test_without_landlock_work_goes_on_and_doctor_says_so(folder):
    secret = str(folder / "secret/key")
    command = launcher(folder, around(folder))
    assert tried(command, [secret], preexec_fn=without_landlock) == {secret: True}
    program = "from iclnuim.headless.commands import doctor; print(doctor._wall())"
    done = subprocess.run([*PYTHON, program], capture_output=True, preexec_fn=without_landlock)
    assert b"without a wall of the kernel" in done.stdout, done.stderr


def test_a_script_that_starts_blender_leads_to_its_folder(tmp_path):
    script = tmp_path / "blender"
    script.write_text('#!/bin/sh\nexec /opt/blender-4.5/blender "$@"\n')
    allowed = scene_wall.around("office", SceneReading(), str(script)).readable
    assert "/opt/blender-4.5" in allowed


def test_only_the_users_own_act_opens_the_gate():
    asked = SceneReading(allow_outside=True)
    asked.check_asked(True, "recipe.json")
    SceneReading().check_asked(False, "recipe.json")
    with pytest.raises(InputError, match="recipe.json: expected .*allow"):
        asked.check_asked(False, "recipe.json")
