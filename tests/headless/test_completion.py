"""A shell completes commands, options and the names of what is built in."""

import os
import subprocess
import sys

import pytest
from patience import patience

pytest.importorskip("argcomplete")


def completed(line, folder):
    """The words that argcomplete's function in a shell would be told."""
    command = [sys.executable, "-m", "iclnuim"]
    environment = {
        **os.environ,
        "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_STDOUT_FILENAME": str(folder / "words"),
        "_ARGCOMPLETE_COMP_WORDBREAKS": " ",
        "_ARGCOMPLETE_IFS": "\n",
        "COMP_LINE": line,
        "COMP_POINT": str(len(line)),
    }
    subprocess.run(command, cwd=folder, env=environment, check=True, timeout=patience(120))
    return [word.strip() for word in (folder / "words").read_text().splitlines()]


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("iclnuim ma", ["make"]),
        ("iclnuim make k", ["kt0", "kt1", "kt2", "kt3"]),
        ("iclnuim make office/kt1 --qui", ["--quick", "--quiet"]),
        ("iclnuim trajectory info office/kt3", ["office/kt3"]),
        ("iclnuim odometry icp_", ["icp_rgbd"]),
        ("iclnuim odometry icp 'my fo", ["my folder/"]),
    ],
)
def test_commands_options_names_and_files_are_completed(line, words, tmp_path):
    (tmp_path / "my folder").mkdir()
    assert completed(line, tmp_path) == words
