"""ICL-NUIM rebuilt: the library `import iclnuim`, and at the same time the Blender extension "ICL-NUIM Export".

Importing it loads neither Blender nor SciPy: every heavy import stands inside the function that needs it.
"""

__version__ = "0.1.0"


def register() -> None:
    """Called by Blender when the extension is switched on. Raises InputError below Blender 4.2."""
    from .blender import compat

    compat.require_supported_version()
    from . import ui

    ui.register()


def unregister() -> None:
    """Called by Blender when the extension is switched off: nothing stays behind."""
    from . import ui

    ui.unregister()
