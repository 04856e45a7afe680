"""The largest memory of this process while a cell is measured."""

from pathlib import Path

_RESET = Path("/proc/self/clear_refs")
_STATUS = Path("/proc/self/status")
#: What resets the largest memory so far (proc(5), /proc/PID/clear_refs).
_RESET_PEAK = "5"


def reset_peak() -> None:
    """From now on peak_mb() is of what follows, also in a process that measured other cells."""
    try:
        _RESET.write_text(_RESET_PEAK)
    except OSError:  # no Linux
        return


def peak_mb() -> float | None:
    """The largest resident memory in MB since reset_peak(); None where the system does not say."""
    try:
        lines = _STATUS.read_text().splitlines()
    except OSError:
        return None
    found = [line.split()[1] for line in lines if line.startswith("VmHWM:")]
    return int(found[0]) * 1024 / 1e6 if found else None
