"""Imports packages from other folders of a checkout: headless/ and benchmark/ if they are not
installed, tools/ and blend/builder/ always.
"""

import importlib
import importlib.util
import sys
from pathlib import Path
from types import ModuleType

from .errors import WorkError

ROOT = Path(__file__).resolve().parents[2]
#: package name -> its folder below ROOT
_FOLDERS = {
    "iclnuim.headless": "headless",
    "iclnuim.benchmark": "benchmark",
    "iclnuim.tools": "tools",
    "iclnuim.blend.builder": "blend/builder",
}


def load(name: str, what: str) -> ModuleType:
    """Import the package `name` from an installation or from the checkout.

    If it is in neither, raises WorkError that `what` needs a checkout.
    """
    with_parent = name.rpartition(".")[0]
    try:
        if with_parent != "iclnuim":
            importlib.import_module(with_parent)
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name not in (name, with_parent):
            raise
    folder = ROOT / _FOLDERS[name]
    if not (folder / "__init__.py").is_file():
        raise WorkError(
            f"{what} needs a checkout of the repository; try: git clone, then ./setup.sh"
        )
    if with_parent != "iclnuim" and with_parent not in sys.modules:
        sys.modules[with_parent] = ModuleType(with_parent)
        sys.modules[with_parent].__path__ = [str(folder.parent)]
    spec = importlib.util.spec_from_file_location(
        name, folder / "__init__.py", submodule_search_locations=[str(folder)]
    )
    assert spec is not None and spec.loader is not None
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
