"""How a machine's cores are shared among workers."""

from __future__ import annotations

import os

from iclnuim.errors import InputError

#: Threads a worker takes unless --workers says otherwise: `iclnuim bench farm` measures them. One alone would spin.
THREADS = {"baked": 2, "path": 2}


def split(light: str, workers: int | None = None, cores: list[int] | None = None) -> list[list[int]]:
    """The cores of each worker, at least two where there are two. Raises InputError for more workers than that allows."""
    cores = own_cores() if cores is None else cores
    most = max(1, len(cores) // 2)
    if workers is None:
        workers = max(1, min(most, len(cores) // THREADS[light]))
    if not 1 <= workers <= most:
        raise InputError(f"1 to {most} workers on {len(cores)} cores, two for each", found=workers)
    return [cores[len(cores) * k // workers : len(cores) * (k + 1) // workers] for k in range(workers)]


def own_cores() -> list[int]:
    """Those that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))
