"""Fixtures that all rooms' tests share."""

import contextlib
import os
import resource
import signal
import sys
from pathlib import Path

import judges
import pytest
from iclnuim import checkout

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command does, for the test processes
# tests start hundreds of processes: our modules are compiled once, even on a machine that keeps no
# bytecode
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
for package in ("iclnuim.tools", "iclnuim.blend.builder"):  # what only a checkout has
    checkout.load(package, "testing")

REPOSITORY = Path(__file__).resolve().parents[1]


EXIT_STATUS = pytest.StashKey[int]()


def pytest_xdist_auto_num_workers(config) -> int:
    """Processes of `-n auto`: one more than cores (some tests wait for processes of their own), at
    most four; none for a part of the suite.
    """
    whole = config.args == config.getini("testpaths") and not config.option.keyword
    return min(4, len(os.sched_getaffinity(0)) + 1) if whole and not config.option.usepdb else 0


#: Files in one process: what they compile with numba is compiled once.
TOGETHER = ("tests/fusion/", "tests/odometry/", "tests/test_python_page.py")
#: Begun first, in this order: a long file begun last would leave the other processes with nothing
#: to do.
FIRST = (
    "tests/ui/", "tests/farm/test_chaos.py", *TOGETHER, "tests/blender/", "tests/scenes/", "tests/lightmap/", "tests/raycast/",
    "tests/packaging/", "tests/farm/", "tests/headless/test_exit_codes.py",
    "tests/formats/test_fuzzed_files.py",
)  # fmt: skip


def pytest_xdist_make_scheduler(config, log):
    """`--dist loadfile` with files that stand together, in the order of collection."""
    if config.getvalue("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling

    class LongestFirst(LoadFileScheduling):
        def _split_scope(self, nodeid):
            file = super()._split_scope(nodeid)
            return "together" if file.startswith(TOGETHER) else file

    config.option.loadscopereorder = False
    return LongestFirst(config, log)


def pytest_collection_modifyitems(items):
    if "PYTEST_XDIST_WORKER" in os.environ:
        items.sort(key=lambda item: [not item.nodeid.startswith(place) for place in FIRST])


def pytest_terminal_summary(terminalreporter):
    if missing := judges.absent(terminalreporter.stats.get("skipped", [])):
        hint = "try: ./setup.sh test, .ci/judges"
        terminalreporter.line(f"judges absent, their tests skipped: {', '.join(missing)} ({hint})")


def pytest_sessionfinish(session, exitstatus):
    session.config.stash[EXIT_STATUS] = int(exitstatus)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config):
    """Blender as a module may wait at the end for threads of its own that are gone by then: all is
    said, so end here.
    """
    if "bpy" in sys.modules and EXIT_STATUS in config.stash:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(config.stash[EXIT_STATUS])


@pytest.fixture(scope="session")
def samples() -> Path:
    """The official samples: the folder named by ICLNUIM_SAMPLES, by default beside the checkout."""
    folder = Path(os.environ.get("ICLNUIM_SAMPLES", REPOSITORY.parent / "shared/data/iclnuim"))
    if not (folder / "trajectories").is_dir():
        pytest.skip(f"the official ICL-NUIM samples are not at {folder}; set ICLNUIM_SAMPLES")
    return folder


@pytest.fixture(scope="session")
def repository() -> Path:
    return REPOSITORY


@pytest.fixture
def command_here(capfd):
    """`command_here(*arguments)`: the command `iclnuim` in this process, where heavy packages are
    loaded already.

    Exit code, standard output, standard error; a test of the process itself starts one.
    """
    from iclnuim.headless import cli

    def run(*arguments) -> tuple[int, str, str]:
        capfd.readouterr()
        code = cli.main([str(argument) for argument in arguments])
        return (code, *capfd.readouterr())

    return run


@pytest.fixture
def file_size_limit():
    """`with file_size_limit(n):` lets no file of this process grow beyond n bytes: a full disk."""

    @contextlib.contextmanager
    def limited(size):
        old = resource.getrlimit(resource.RLIMIT_FSIZE)
        compiles, sys.dont_write_bytecode = (
            sys.dont_write_bytecode,
            True,
        )  # compiled modules would be cut off, and stay
        handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, old[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, old)
            signal.signal(signal.SIGXFSZ, handler)
            sys.dont_write_bytecode = compiles

    return limited
