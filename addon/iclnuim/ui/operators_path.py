"""Operator that keeps the path chosen in the panel as a file: a shipped one, another file's, or the active camera's animation."""

from pathlib import Path

import bpy

from ..errors import InputError
from ..formats.trajectories import write_trajectory
from . import inputs, session
from .messages import in_words


class ICLNUIM_OT_save_path(bpy.types.Operator):
    """Save the path chosen above as a TUM file: seconds, metres, camera to world, x right, y down, z forward"""

    bl_idname, bl_label = "iclnuim.save_path", "Save as TUM"

    filepath: bpy.props.StringProperty(subtype="FILE_PATH", description="File to write, ending in .txt")
    check_existing: bpy.props.BoolProperty(default=True, options={"HIDDEN"})
    filter_glob: bpy.props.StringProperty(default="*.txt", options={"HIDDEN"})

    def invoke(self, context, event):
        source = context.scene.iclnuim.trajectory_source
        name = "camera" if source == "CAMERA" else "path" if source == "FILE" else source
        self.filepath = str(Path(bpy.data.filepath).parent / f"{name}.txt") if bpy.data.filepath else f"{name}.txt"
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    @in_words
    def execute(self, context):
        if not self.filepath:
            raise InputError("a file to write", found="none")
        file = Path(bpy.path.abspath(self.filepath)).expanduser().resolve()
        poses, sentence = inputs.trajectory(context)
        write_trajectory(file.with_suffix(file.suffix or ".txt"), poses, "tum")
        session.current.work.message = f"{len(poses)} poses of {sentence} are in {file.name}"


register, unregister = bpy.utils.register_classes_factory((ICLNUIM_OT_save_path,))
