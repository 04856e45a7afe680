"""`iclnuim doctor` and the errors of commands without Blender: what is missing, what works without
it, and what installs it.
"""

import json
import sys

import pytest
from iclnuim import errors
from iclnuim.headless import cli
from iclnuim.headless.commands import doctor


def test_what_is_found_is_listed_with_its_version(capsys):
    code = cli.main(["doctor", "--json"])
    told = json.loads(capsys.readouterr().out)
    found = {f["name"]: f for f in told["checks"]}
    assert {
        "Python",
        "bpy",
        "numpy",
        "numba",
        "open3d-cpu",
        "submitit",
        "rosbags",
        "OpenCV's odometers",
    } <= set(found)
    assert found["numpy"]["ok"] and found["numpy"]["found"].startswith(("1.", "2."))
    assert (code == 0) == told["ok"]


def test_without_blender_it_says_what_works_and_ends_with_3(capsys, monkeypatch):
    monkeypatch.setattr(doctor.importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr(doctor.shutil, "which", lambda name: None)
    assert cli.main(["doctor"]) == 3
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if line.startswith("MISSING   bpy")]
    assert [
        line
        for line in lines
        if "not installed; for Slurm" in line and "pip install 'submitit'" in line
    ]
    assert lines[-1].startswith("Without Blender: evaluation, noise, odometry and fusion work")


@pytest.mark.parametrize(
    ("version", "advice"),
    [((3, 11), "bpy==4.5.*"), ((3, 13), "bpy==5.2.*"), ((3, 12), "no bpy for Python 3.12")],
)
def test_what_needs_blender_names_what_this_python_can_install(monkeypatch, version, advice):
    monkeypatch.setattr(sys, "version_info", version)
    error = errors.blender_missing("bake", ModuleNotFoundError("No module named 'bpy'", name="bpy"))
    assert str(error).startswith("bake needs Blender's Python package bpy; try ") and advice in str(
        error
    )


def test_a_bpy_that_cannot_start_is_not_called_missing():
    error = errors.blender_missing(
        "bake", ImportError("libGL.so.1: cannot open shared object file")
    )
    assert "cannot be imported: libGL.so.1" in str(error) and "iclnuim doctor" in str(error)
