"""The site is built without a complaint, and has every public name (mkdocs.yml)."""

import subprocess
import sys

import iclnuim
import pytest


@pytest.mark.slow
def test_the_site_is_built_strictly_and_has_every_public_name(repository, tmp_path):
    pytest.importorskip("mkdocs", reason="needs ./setup.sh docs")
    program = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path)]
    done = subprocess.run(program, cwd=repository, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    pages = "".join(path.read_text() for path in (tmp_path / "reference/python").glob("*.html"))
    for name in set(iclnuim.__all__) - {"__version__"}:
        assert f'id="iclnuim.{name}"' in pages
    for example in (repository / "examples").glob("[0-9]*"):
        assert f'href="{example.name}.html"' in (tmp_path / "examples/index.html").read_text()
    assert 'href="../addon/index.html#light-baked"' in (tmp_path / "guide/light.html").read_text()
