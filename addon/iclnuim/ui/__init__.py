"""The panel "ICL-NUIM Export": properties, panels that only draw, operators that only forward, and their registration."""

from __future__ import annotations

import atexit

_registered = False


def _modules() -> tuple:
    from . import (
        operators_evaluate,
        operators_path,
        operators_render,
        operators_scene,
        panels,
        presets,
        properties,
        viewport,
    )

    operators = operators_scene, operators_path, operators_render, operators_evaluate
    return properties, presets, *operators, viewport, panels


def register() -> None:
    """Every class, property and handler."""
    global _registered
    for module in _modules():
        module.register()
    _registered = True
    atexit.register(unregister)


def unregister() -> None:
    """The reverse; a running child process is ended, its finished frames stay."""
    global _registered
    if not _registered:
        return
    _registered = False
    from . import session

    atexit.unregister(unregister)
    session.end()
    for module in reversed(_modules()):
        module.unregister()
