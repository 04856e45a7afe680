"""The Blender session, started empty."""

from __future__ import annotations

import bpy

from . import compat


def reset() -> None:
    """An empty session with factory settings, whatever the user's start-up file holds. Scripts in .blend files do not run."""
    compat.require_supported_version()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.preferences.filepaths.use_scripts_auto_execute = False
