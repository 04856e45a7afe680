"""Time limits of tests that wait for other processes."""

import os


def patience(seconds: float) -> float:
    """The limit in seconds of what is allowed `seconds` on a machine with nothing else to do: as
    many times longer as processes wait for each core.
    """
    return seconds * max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))
