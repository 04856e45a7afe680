"""tools/loaders.py: a loader that reads something else is noticed; loaders of PyPI that are installed
read all 882 frames.
"""

import importlib.util
from dataclasses import replace

import numpy as np
import pytest
from iclnuim.checkout import load
from iclnuim.errors import InputError
from iclnuim.headless.loader_settings import system_files

load("iclnuim.tools", "the table of loaders")
from iclnuim.tools import loaders  # noqa: E402
from iclnuim.tools.loader_readers import READERS  # noqa: E402

TABLE = loaders.loaders()


def test_every_loader_has_its_function_its_code_and_its_settings():
    assert list(TABLE) == list(READERS)
    for loader in TABLE.values():
        assert bool(loader.git) == bool(loader.commit) and (loader.git or loader.package)
        if loader.settings:
            assert system_files(loader.settings).files
    with pytest.raises(InputError, match="a system"):
        system_files("none")


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    out = tmp_path_factory.mktemp("loaders") / "out"
    loaders.write(out, ("replica",), 5)
    return out / "replica"


def read(count=5):
    """What a loader without errors gives."""
    depths_m = [loaders.made_up_depth_m(n) for n in range(count)]
    return {
        "images": [f"results/frame{n:06}.jpg" for n in range(count)],
        "camera": np.array([640 / 1.33, 480.0, 319.5, 239.5]),
        "T_world_camera": loaders.truth(0, count),
        "depth_spans_m": np.stack([depths_m, depths_m], 1),
    }


def shifted(T):
    moved = T.copy()
    moved[2, 0, 3] += 2e-6
    return moved


@pytest.mark.parametrize(
    ("what", "change"),
    [
        ("images", lambda names: names[1:] + names[:1]),
        ("images", lambda names: names[:-1]),
        ("camera", lambda k: k + 0.01),
        ("T_world_camera", shifted),
        ("depth_spans_m", lambda depth: depth + 0.6 / 6553.5),
    ],
)
def test_what_differs_is_noticed(sequence, what, change):
    loader = replace(TABLE["nice-slam"], settings="")
    assert loaders.judged(loader, sequence, read()).holds(loader)
    wrong = read()
    wrong[what] = change(wrong[what])
    assert not loaders.judged(loader, sequence, wrong).holds(loader)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["pycolmap", "nerfstudio", "gradslam-icl"])
def test_loaders_of_pypi_read_all_frames(name, tmp_path):
    package = READERS[name].__name__.partition("_")[0]
    if importlib.util.find_spec(package) is None:
        pytest.skip(f"judge absent: {package}")
    loader = TABLE[name]
    loaders.write(tmp_path / "out", (loader.format,))
    (tmp_path / "empty").mkdir()
    where = loaders.place(tmp_path / "out", loader)
    row = loaders.tried(name, loader, where, tmp_path / "empty")
    assert row.holds(loader) and row.frames == (881 if name == "gradslam-icl" else 882)
