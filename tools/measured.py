"""The command of measured_pages.py, which is in the package `iclnuim.tools` of a checkout."""

import sys

from iclnuim import checkout

checkout.load("iclnuim.tools", "measuring pages")
from iclnuim.tools.measured_pages import main  # noqa: E402

if __name__ == "__main__":
    sys.exit(main())
