"""Judges: programs of others that measure the same as we do. A test that needs one is skipped where
it is absent, and the last lines of a run name it (conftest.py).
"""

import functools
import os
import subprocess
from pathlib import Path

import pytest

ABSENT = "judge absent: "
#: A Python with the judges of labels and of IMUs, which need another numpy than Blender: `.ci/judges` makes it.
OF_LABELS = os.environ.get(
    "ICLNUIM_LABEL_JUDGE", str(Path(__file__).parents[1] / ".venv-judges/bin/python")
)
#: A Python with loaders of data sets, torch and the figures of depth: `.ci/judges data` makes it.
OF_DATA = os.environ.get(
    "ICLNUIM_DATA_JUDGE", str(Path(__file__).parents[1] / ".venv-judges-data/bin/python")
)


def judge_module(module: str, package: str):
    """The module of a package that pip installs."""
    return pytest.importorskip(module, reason=f"{ABSENT}{package}")


def judged_by(package: str, module: str, *arguments, python: str = OF_LABELS) -> str:
    """What `python ARGUMENTS` prints, by the Python that has the package."""
    if not has(python, module):
        pytest.skip(f"{ABSENT}{package}")
    command = [python, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def absent(reports) -> list[str]:
    """The packages for want of which these reports of tests are skipped."""
    reasons = [report.longrepr[-1] for report in reports if isinstance(report.longrepr, tuple)]
    return sorted({reason.partition(ABSENT)[2] for reason in reasons if ABSENT in reason})


@functools.cache
def has(python: str, module: str) -> bool:
    """Whether this Python exists and has the modules."""
    if not Path(python).exists():
        return False
    return not subprocess.run([python, "-c", f"import {module}"], capture_output=True).returncode
