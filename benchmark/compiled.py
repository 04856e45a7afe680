"""Compiled functions whose machine code is kept on disk until any source of the benchmark changes.

numba keeps it until the file of the function changes. But the code of functions in other files is
built into it, so a change of theirs alone, by an update or by hand, would go on giving the old
figures without a word.
"""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

Compile = Callable[..., Callable[[Callable], Any]]


def compiled_in(folder: Path) -> Compile:
    """numba.njit with a cache that is valid for the sources below the folder as they are now."""
    digest = hashlib.sha256()
    for file in sorted(folder.rglob("*.py")):
        digest.update(file.read_bytes())
    version = f"{numba.__version__} {digest.hexdigest()}"

    def compiled(**options: Any) -> Callable[[Callable], Any]:
        def decorated(function: Callable) -> Any:
            found = numba.njit(cache=True, **options)(function)
            found._cache._cache_file._version = version  # what an index on disk must begin with
            return found

        return decorated

    return compiled


compiled = compiled_in(Path(__file__).parent)
