"""setup.sh chooses a Python that has Blender's package, and says what to do before it installs
anything where there is none.
"""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

TOOLS = ("sh", "dirname", "sed", "mktemp", "rm", "mkdir", "cp", "tr", "cat", "id")
#: A Python of some version: it answers setup.sh's question, makes "environments", and notes what it
#: is told to do.
PYTHON = """#!/bin/sh
case "$*" in
  *version_info*) echo {version} ;;
  "-m venv"*) echo "$0 $*" >>{log}; [ {version} != 3.10 ] || exit 1; mkdir -p "$3/bin"; cp "$0" "$3/bin/python" ;;
  *) echo "{version} $*" >>{log} ;;
esac
"""


class Machine:
    """A PATH of stubs and an empty home; `setup(*extras, **environment)` runs setup.sh there."""

    def __init__(self, folder: Path, repository: Path) -> None:
        self.log, self.home, self.bin = folder / "log", folder / "home", folder / "bin"
        self.checkout = folder / "checkout"
        for path in (self.home, self.bin, self.checkout):
            path.mkdir()
        shutil.copy(repository / "setup.sh", self.checkout)
        for tool in TOOLS:
            (self.bin / tool).symlink_to(shutil.which(tool))

    def has(self, name: str, text: str) -> Path:
        path = self.bin / name if "/" not in name else self.home / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.unlink(missing_ok=True)  # it may be a link to the machine's own tool
        path.write_text(text)
        path.chmod(0o755)
        return path

    def has_python(self, name: str, version: str) -> Path:
        return self.has(name, PYTHON.format(version=version, log=self.log))

    def setup(self, *extras: str, **environment: str) -> subprocess.CompletedProcess:
        environment = {"PATH": str(self.bin), "HOME": str(self.home), **environment}
        return subprocess.run(
            ["./setup.sh", *extras],
            cwd=self.checkout,
            env=environment,
            capture_output=True,
            text=True,
        )

    @property
    def done(self) -> str:
        return self.log.read_text() if self.log.exists() else ""


@pytest.fixture
def machine(tmp_path, repository):
    return Machine(tmp_path, repository)


@pytest.mark.parametrize(
    "name", ["python3", "python3.11", "python3.13", ".pyenv/versions/3.11.7/bin/python"]
)
def test_an_installed_python_is_found(machine, name):
    if name != "python3":
        machine.has_python("python3", "3.10")
    version = "3.13" if name.endswith("13") else "3.11"
    path = machine.has_python(name, version)
    done = machine.setup("test", "dev")
    assert done.returncode == 0, done.stderr
    assert f"{path} -m venv .venv" in machine.done
    assert f"{version} -m pip install -q --no-compile --editable .[test,dev]" in machine.done


def test_otherwise_uv_fetches_one(machine):
    machine.has_python("python3", "3.12")
    fetched = machine.has_python("fetched/python", "3.11")
    machine.has("uv", f'#!/bin/sh\n[ $1 != pip ] || exit 1\n[ "$2" = install ] || echo {fetched}\n')
    done = machine.setup()
    assert done.returncode == 0, done.stderr
    assert "3.11 -m pip install -q --no-compile --editable .\n" in machine.done


def test_otherwise_the_python_of_an_installed_blender_serves(machine):
    inside = machine.has_python("blender/python", "3.11")
    machine.has_python("python3", "3.10")
    machine.has("uv", "#!/bin/sh\nexit 1\n")
    machine.has("blender", f"#!/bin/sh\necho Blender 4.5\necho python:{inside}\n")
    assert machine.setup().returncode == 0
    assert f"{inside} -m venv .venv" in machine.done


@pytest.mark.parametrize("version", ["3.10", "3.12", "3.14", None])
def test_otherwise_a_line_says_what_to_do_and_nothing_is_installed(machine, version):
    if version:
        machine.has_python("python3", version)
    machine.has("uv", "#!/bin/sh\nexit 1\n")
    done = machine.setup()
    line = done.stderr.splitlines()[-1]
    assert done.returncode == 1 and machine.done == ""
    assert (
        f"expected Python 3.11 or 3.13, found {version or 'none'}" in line
        and "install Python 3.11" in line
    )
    assert ("without Blender: PYTHON=python3 ./setup.sh" in line) == (version == "3.12")


def test_python_3_12_is_taken_when_it_is_asked_for_and_told_what_will_not_work(machine):
    machine.has_python("python3", "3.12")
    done = machine.setup(PYTHON="python3")
    assert done.returncode == 0 and "3.12 -m pip install" in machine.done
    assert done.stderr.count("rendering needs Python 3.11 or 3.13") == 1
    assert "iclnuim make" not in done.stdout


def test_a_python_that_cannot_serve_is_refused_by_name(machine):
    machine.has_python("python3", "3.10")
    done = machine.setup(PYTHON="python3")
    assert done.returncode == 1 and machine.done == ""
    assert done.stderr.startswith(
        "setup.sh: python3: expected Python 3.11 or 3.13 (3.12 works without Blender), found 3.10"
    )


def test_system_packages_are_named_where_they_cannot_be_installed(machine):
    if os.getuid() == 0:
        machine.has("id", "#!/bin/sh\necho 1000\n")
    machine.has_python("python3", "3.11")
    machine.has("dpkg", "#!/bin/sh\n[ $2 != libgl1 ]\n")
    done = machine.setup()
    assert done.returncode == 1 and "run as root: apt-get install libgl1\n" in done.stderr
    assert "venv" not in machine.done


UV = """#!/bin/sh
echo "uv $*" >>{log}
exit {code}
"""


def test_each_step_is_told_and_the_end_says_what_to_do_next(machine):
    path = machine.has_python("python3", "3.11")
    done = machine.setup()
    steps = done.stderr.splitlines()
    assert steps[0] == f"setup.sh: Python 3.11: {path}"
    assert "1.5 GB" in steps[1] and steps[-1] == "setup.sh: done. Next:"
    first, make, all_commands = done.stdout.splitlines()
    assert first == "  . .venv/bin/activate"
    assert make.startswith("  iclnuim make kt2 --quick ")
    assert all_commands.startswith("  iclnuim --help ")
    assert "python -m pytest" in machine.setup("test").stdout


def test_uv_installs_where_it_is_there_and_pip_is_not_asked(machine):
    machine.has_python("python3", "3.11")
    machine.has("uv", UV.format(log=machine.log, code=0))
    assert machine.setup("test").returncode == 0
    assert "uv pip install -q --python .venv/bin/python --editable .[test]\n" in machine.done
    assert "-m pip" not in machine.done


def test_pip_installs_where_uv_cannot(machine):
    machine.has_python("python3", "3.11")
    machine.has("uv", UV.format(log=machine.log, code=2))
    done = machine.setup("test")
    assert done.returncode == 0 and "by pip, as uv could not" in done.stderr
    assert "3.11 -m pip install -q --no-compile --editable .[test]" in machine.done


def test_uv_is_had_from_the_package_index_where_it_is_not_there(machine):
    machine.has_python("python3", "3.11")
    uv = machine.has("other/uv", UV.format(log=machine.log, code=0))
    had = PYTHON.replace(
        "  *) echo", f'  *"install -q uv") cp {uv} "${{{{0%/*}}}}/uv" ;;\n  *) echo'
    )
    machine.has("python3", had.format(version="3.11", log=machine.log))
    assert machine.setup().returncode == 0
    assert "uv pip install" in machine.done and "--no-compile" not in machine.done
