"""The image libraries that may be installed: OpenEXR and OpenCV with pip, OpenImageIO inside
Blender.
"""

import contextlib
import functools
import glob
import importlib
import os
import sys
from types import ModuleType

from ..errors import WorkError


def first_library(what: str, *packages: str) -> tuple[str, ModuleType]:
    """Name and module of the first of `packages` (module names) that can be imported.

    Raises WorkError if there is none.
    """
    for package in packages:
        module = _module(package)
        if module is not None:
            return package, module
    raise WorkError(
        f"{what} needs {' or '.join(packages)}, which this Python ({sys.executable}) does not "
        "have; try installing one; "
        "for the Blender of a Linux distribution, its package python3-openimageio"
    )


@functools.cache
def _module(package: str) -> ModuleType | None:
    """Import from sys.path, or from the bpy wheel, which contains OpenImageIO in
    bpy/X.Y/python/lib/python3.XX/site-packages.
    """
    with contextlib.suppress(ImportError):
        return importlib.import_module(package)
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    bundled = f"bpy/*/python/lib/{version}/site-packages"
    folders: list[str] = []
    for entry in sys.path:
        folders += sorted(glob.glob(os.path.join(entry, bundled)))
    for folder in folders:
        if not glob.glob(os.path.join(folder, f"{package}*")):
            continue
        sys.path.append(folder)
        try:
            return importlib.import_module(package)
        except ImportError:
            pass
        finally:
            sys.path.remove(folder)
    return None
