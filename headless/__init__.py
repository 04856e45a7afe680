"""Everything that runs without a window: the command `iclnuim`, the render farm, the benchmark,
tables and charts.
"""

import os

# Before numpy is loaded: our matrices are small, and on busy cores the threads of OpenBLAS wait for
# each other longer than they compute.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
