"""Machine code on disk is that of the sources as they are."""

import subprocess
import sys

INNER = "from compiled_here import compiled\n\n\n@compiled()\ndef inner(x):\n    return {} * x\n"
OUTER = "from compiled_here import compiled\nfrom inner import inner\n\n\n@compiled()\ndef outer(x):\n    return inner(x) + 1\n"
HERE = "from pathlib import Path\n\nfrom iclnuim.benchmark.compiled import compiled_in\n\ncompiled = compiled_in(Path(__file__).parent)\n"
RUN = "from outer import outer\nprint(outer(1.0), sum(outer.stats.cache_hits.values()))"


def test_a_change_in_another_file_is_compiled_again(tmp_path):
    (tmp_path / "compiled_here.py").write_text(HERE)
    (tmp_path / "outer.py").write_text(OUTER)

    def run(factor):
        (tmp_path / "inner.py").write_text(INNER.format(factor))
        # -B: bytecode of a file of the same size is not made again within a second
        command = [sys.executable, "-B", "-c", RUN]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
        return done.stdout.split()

    assert run(2) == ["3.0", "0"]
    assert run(2) == ["3.0", "1"]
    assert run(5) == ["6.0", "0"]
