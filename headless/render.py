"""The script behind `blender -b -P headless/render.py -- kt2` and `python headless/render.py kt2`.

It runs the command `iclnuim render` from this checkout and ends the process with the exit code of
that command. Blender itself would always end with 0.
"""

import os
import sys
import traceback
from pathlib import Path

HEADLESS = Path(__file__).resolve().parent


def main() -> int:
    arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    if sys.path and Path(sys.path[0] or ".").resolve() == HEADLESS:
        # the modules next to this script belong to a package and are not top-level modules
        del sys.path[0]
    sys.path.insert(0, str(HEADLESS.parent / "addon"))
    from iclnuim import __main__ as entry

    return entry.load_command_line().main(["render", *arguments])


if __name__ == "__main__":
    try:
        code = main()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 2
    except BaseException:
        traceback.print_exc()
        code = 3
    sys.stderr.flush()
    os._exit(code)
