"""What Blender and its libraries print stays in the log; what Python prints does not."""

import subprocess
import sys

PROGRAM = """
import os, sys
from pathlib import Path
from iclnuim.native_output import native_output_in
with native_output_in(Path(sys.argv[1])):
    os.write(1, b"Fra:1 Mem:8M\\n")
    os.write(2, b"Warning: in _ReportErrors at line 3258 of stage.cpp\\n")
    print("a result")
    print("note: ours", file=sys.stderr)
os.write(2, b"after\\n")
"""


def test_lines_of_blender_and_usd_go_to_the_log_and_ours_to_the_terminal(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, tmp_path / "log"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert (done.stdout, done.stderr) == ("a result\n", "note: ours\nafter\n")
    assert (tmp_path / "log").read_text().splitlines() == [
        "Fra:1 Mem:8M",
        "Warning: in _ReportErrors at line 3258 of stage.cpp",
    ]
    assert (tmp_path / "log").stat().st_mode & 0o111 == 0  # text, and no program
