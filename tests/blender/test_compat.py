"""Features that an older Blender lacks."""

from types import SimpleNamespace

import pytest

bpy = pytest.importorskip("bpy", reason="needs the bpy package")

from iclnuim.blender import compat  # noqa: E402


@pytest.mark.parametrize(
    ("app", "is_package"),
    [
        ({"module": True, "binary_path": "/usr/bin/blender"}, True),
        ({"module": False, "binary_path": "/usr/bin/blender"}, False),
        ({"binary_path": "/usr/bin/blender"}, False),
        ({"binary_path": ""}, True),
    ],
)
def test_the_package_is_told_from_a_blender_of_every_version(monkeypatch, app, is_package):
    monkeypatch.setattr(compat, "bpy", SimpleNamespace(app=SimpleNamespace(**app)))
    assert compat.is_package() == is_package
