"""`python -m iclnuim_bench` is the command `iclnuim`."""

import sys

from .cli import main

sys.exit(main())
