"""ICL-NUIM rebuilt: the library `import iclnuim`, and at the same time the Blender extension "ICL-NUIM Export".

Importing it loads none of numpy, SciPy, Matplotlib, numba and Blender: a public name is imported when it is first used. docs/python.md
shows the names at work.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.2.0"

__all__ = [
    "__version__", "IclnuimError", "InputError", "WorkError",
    # poses, cameras, trajectories and their files
    "SE3", "PinholeCamera", "Trajectory", "TrajectoryStatistics", "trajectory_statistics", "resample",
    "LoadedTrajectory", "read_trajectory", "write_trajectory",
    # trajectory error: ATE and RPE
    "absolute_trajectory_error", "relative_pose_error", "absolute_error", "AbsoluteError", "AbsoluteErrorSettings", "relative_error",
    "RelativeError", "RelativeErrorSettings", "AlignmentSettings", "associate", "Association", "AssociationSettings",
    # sensor noise
    "noisy_depth", "noisy_rgb", "linear_from_srgb8", "depth_model", "rgb_model", "DEPTH_MODELS", "RGB_MODELS",
    # RGB-D sequences
    "make_sequence", "write_sequence", "SequenceSettings", "WrittenSequence", "FrameSource", "frames_from", "image_frames", "run_frames",
    "inspect_sequence", "Inspection", "RgbdSequence",
    # rendering
    "SCENES", "RenderJob", "read_recipe", "shipped_job", "render_frames", "render_pose", "RenderedFrame",
    # odometry
    "odometer", "Odometer", "Frame", "OdometryResult", "OdometryStatus", "track", "Tracked", "Tracker", "run_odometers", "OdometryRun", "odometry_table",
    # surfaces
    "fuse_sequence", "FuseSettings", "VolumeSettings", "FusedSurface", "Mesh", "read_mesh", "read_model", "write_ply", "TrueSurface", "SurfaceError",
]  # fmt: skip

#: module -> its public names; `name=other` where the module calls it otherwise. The imports below say the same to type checkers.
_MODULES = {
    "dataset.frames": "FrameSource image_frames run_frames",
    "dataset.inspection": "Inspection inspect_sequence",
    "dataset.sequence": "SequenceSettings WrittenSequence write_sequence",
    "errors": "IclnuimError InputError WorkError",
    "evaluation.absolute_error": "AbsoluteError AbsoluteErrorSettings absolute_error",
    "evaluation.align": "AlignmentSettings",
    "evaluation.associate": "Association AssociationSettings associate",
    "evaluation.relative_error": "RelativeError RelativeErrorSettings relative_error",
    "formats.ply": "write_ply",
    "formats.trajectories": "LoadedTrajectory read_trajectory write_trajectory",
    "fusion.from_sequence": "FusedSurface=Surface fuse_sequence",
    "fusion.mesh": "Mesh",
    "fusion.models": "read_mesh read_model",
    "fusion.settings": "FuseSettings VolumeSettings",
    "fusion.surface_error": "SurfaceError TrueSurface",
    "geometry.camera": "PinholeCamera",
    "geometry.se3": "SE3",
    "geometry.trajectory": "Trajectory TrajectoryStatistics resample trajectory_statistics=statistics",
    "job": "RenderJob read_recipe shipped_job",
    "odometry.protocol": "Frame Odometer OdometryResult=Result OdometryStatus=Status",
    "odometry.registry": "odometer",
    "odometry.run": "OdometryRun=Run RgbdSequence=Sequence run_odometers=run_together odometry_table=table",
    "odometry.track": "Tracked Tracker track",
    "postprocess": "absolute_trajectory_error frames_from make_sequence noisy_depth noisy_rgb relative_pose_error",
    "render": "RenderedFrame render_frames render_pose",
    "scenes": "SCENES",
    "sensor.models": "DEPTH_MODELS RGB_MODELS depth_model rgb_model",
    "sensor.transfer": "linear_from_srgb8=light_from_srgb8",
}
_PLACES = {
    name.partition("=")[0]: (module, name.partition("=")[2] or name)
    for module, names in _MODULES.items()
    for name in names.split()
}

if TYPE_CHECKING:
    from .dataset.frames import FrameSource, image_frames, run_frames
    from .dataset.inspection import Inspection, inspect_sequence
    from .dataset.sequence import SequenceSettings, WrittenSequence, write_sequence
    from .errors import IclnuimError, InputError, WorkError
    from .evaluation.absolute_error import AbsoluteError, AbsoluteErrorSettings, absolute_error
    from .evaluation.align import AlignmentSettings
    from .evaluation.associate import Association, AssociationSettings, associate
    from .evaluation.relative_error import RelativeError, RelativeErrorSettings, relative_error
    from .formats.ply import write_ply
    from .formats.trajectories import LoadedTrajectory, read_trajectory, write_trajectory
    from .fusion.from_sequence import Surface as FusedSurface
    from .fusion.from_sequence import fuse_sequence
    from .fusion.mesh import Mesh
    from .fusion.models import read_mesh, read_model
    from .fusion.settings import FuseSettings, VolumeSettings
    from .fusion.surface_error import SurfaceError, TrueSurface
    from .geometry.camera import PinholeCamera
    from .geometry.se3 import SE3
    from .geometry.trajectory import Trajectory, TrajectoryStatistics, resample
    from .geometry.trajectory import statistics as trajectory_statistics
    from .job import RenderJob, read_recipe, shipped_job
    from .odometry.protocol import Frame, Odometer
    from .odometry.protocol import Result as OdometryResult
    from .odometry.protocol import Status as OdometryStatus
    from .odometry.registry import odometer
    from .odometry.run import Run as OdometryRun
    from .odometry.run import Sequence as RgbdSequence
    from .odometry.run import run_together as run_odometers
    from .odometry.run import table as odometry_table
    from .odometry.track import Tracked, Tracker, track
    from .postprocess import (
        absolute_trajectory_error,
        frames_from,
        make_sequence,
        noisy_depth,
        noisy_rgb,
        relative_pose_error,
    )
    from .render import RenderedFrame, render_frames, render_pose
    from .scenes import SCENES
    from .sensor.models import DEPTH_MODELS, RGB_MODELS, depth_model, rgb_model
    from .sensor.transfer import light_from_srgb8 as linear_from_srgb8
else:

    def __getattr__(name: str) -> Any:
        """A public name, from the module where it lives. Raises ImportError, in one line, where a package that it needs is missing."""
        if name not in _PLACES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        module, attribute = _PLACES[name]
        try:
            value = getattr(import_module(f".{module}", __name__), attribute)
        except ModuleNotFoundError as error:
            raise ImportError(_missing(name, error.name or "")) from None
        globals()[name] = value
        return value

    def __dir__() -> list[str]:
        return sorted({*globals(), *_PLACES})


def _missing(name: str, module: str) -> str:
    if module.startswith(f"{__name__}."):
        return f"iclnuim.{name} is not part of the Blender extension; try: pip install iclnuim, in a Python of its own"
    return f"iclnuim.{name} needs {module}; try: pip install {module}"


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
