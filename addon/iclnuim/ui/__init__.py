"""The panel "ICL-NUIM Export": registration of its properties, panels and operators.

Panels only draw; operators only call the library.
"""

import atexit
from types import ModuleType


def register() -> None:
    """Register every class, property and handler; again if they are registered already."""
    import bpy

    from . import properties, state, trajectory_view, work

    unregister()
    bpy.types.WindowManager.iclnuim_state = state.PanelState(
        work.Work(properties.label_of), trajectory_view.refresh
    )
    for module in _modules():
        module.register()
    atexit.register(unregister)


def unregister() -> None:
    """Undo register(). A running worker process is ended; its finished frames stay."""
    from . import state

    if not state.is_registered():
        return
    atexit.unregister(unregister)
    for module in reversed(_modules()):
        module.unregister()
    state.end()


def _modules() -> tuple[ModuleType, ...]:
    from . import (
        image_editor,
        operators,
        panels,
        paths,
        presets,
        properties,
        shown_scene,
        trajectory_view,
    )

    return properties, presets, shown_scene, paths, operators, image_editor, trajectory_view, panels
