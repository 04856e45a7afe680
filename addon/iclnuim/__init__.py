"""ICL-NUIM rebuilt: the library `import iclnuim`, and at the same time the Blender extension
"ICL-NUIM Export".

Importing it does not load numpy, SciPy, Matplotlib, numba or Blender: a public name is imported at
its first use. docs/guide/python.md shows examples.
"""

import ast
import warnings
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .errors import package_missing
from .version import __version__

__all__ = [
    "__version__", "IclnuimError", "InputError", "WorkError",
    # poses, cameras, trajectories and their files
    "SE3", "PinholeCamera", "Trajectory", "StampedPose", "TrajectoryStatistics",
    "trajectory_statistics", "resample", "LoadedTrajectory", "read_trajectory",
    "write_trajectory", "pose_from_pov",
    # trajectory error: ATE and RPE
    "absolute_trajectory_error", "relative_pose_error", "AbsoluteError",
    "AbsoluteErrorSettings", "RelativeError", "RelativeErrorSettings",
    "AlignmentSettings", "associate", "Association", "AssociationSettings",
    # recordings for the viewer Rerun
    "record_sequence", "record_runs", "record_surface",
    # rendered views
    "view_errors", "ViewErrors", "ViewError", "ViewSettings", "psnr_db", "ssim", "RayCaster",
    "HeldOutView", "check_held_out", "choose_held_out",
    # predicted depth
    "depth_error", "depth_errors", "DepthErrors", "DepthError", "DepthErrorSettings", "DepthFigures",
    "MethodDepthErrors", "point_error", "point_errors", "PointErrors", "PointError", "PointFigures",
    "MethodPointErrors",
    # labels
    "label_errors", "LabelErrors", "label_confusion", "label_figures", "LabelFigures",
    "panoptic_quality", "PanopticQuality", "Segmentation", "read_class_map", "ClassMap",
    "write_coco",
    # sensor noise
    "noisy_depth", "phone_depth", "noisy_rgb", "linear_from_srgb8", "depth_model", "rgb_model",
    "DEPTH_MODELS", "RGB_MODELS",
    # an IMU on the camera
    "imu_of", "ImuStream", "ImuNoise", "IMU_MODELS",
    # RGB-D sequences
    "make_sequence", "convert_sequence", "WrittenSequence", "FrameSource",
    "frames_from", "inspect_sequence", "Inspection", "compare_sequences", "SequenceComparison",
    "open_sequence",
    "RgbdSequence", "PosedFrame",
    # rendering
    "SCENES", "sequence_names", "RenderJob", "read_recipe", "shipped_job", "render_frames", "render_pose",
    "RenderedFrame",
    # odometry
    "odometer", "Odometer", "Frame", "OdometryResult", "OdometryStatus", "track", "Tracked",
    "Tracker", "run_odometers", "OdometryRun", "odometry_table",
    # surfaces
    "fuse_sequence", "FuseSettings", "VolumeSettings", "FusedSurface", "Mesh", "read_mesh",
    "read_model", "write_ply", "TrueSurface", "SurfaceError", "surface_quality", "SurfaceQuality",
    "QualitySettings", "SeenBy",
]  # fmt: skip

if TYPE_CHECKING:
    from .benchmark.fusion.mesh import Mesh
    from .benchmark.fusion.quality import SeenBy, SurfaceQuality, surface_quality
    from .benchmark.fusion.recording import record_surface
    from .benchmark.fusion.sequence import FusedSurface, fuse_sequence
    from .benchmark.fusion.settings import FuseSettings, QualitySettings, VolumeSettings
    from .benchmark.fusion.surface_error import SurfaceError, TrueSurface
    from .benchmark.odometry.protocol import Frame, Odometer, OdometryResult, OdometryStatus
    from .benchmark.odometry.recording import record_runs
    from .benchmark.odometry.registry import odometer
    from .benchmark.odometry.run import OdometryRun, odometry_table, run_odometers
    from .benchmark.odometry.track import Tracked, Tracker, track
    from .blender.open.model_file import read_model
    from .depth.errors import MethodDepthErrors, depth_errors
    from .depth.points import MethodPointErrors, point_errors
    from .errors import IclnuimError, InputError, WorkError
    from .evaluation.absolute_error import AbsoluteError, AbsoluteErrorSettings
    from .evaluation.align import AlignmentSettings
    from .evaluation.associate import Association, AssociationSettings, associate
    from .evaluation.depth_error import DepthError, DepthErrors, DepthErrorSettings, depth_error
    from .evaluation.depth_figures import DepthFigures
    from .evaluation.image_error import ViewSettings, psnr_db, ssim
    from .evaluation.point_error import PointError, PointErrors, PointFigures, point_error
    from .evaluation.relative_error import RelativeError, RelativeErrorSettings
    from .formats.meshes import read_mesh
    from .formats.ply import write_ply
    from .geometry.camera import PinholeCamera
    from .geometry.se3 import SE3
    from .geometry.trajectory import (
        StampedPose,
        Trajectory,
        TrajectoryStatistics,
        resample,
        trajectory_statistics,
    )
    from .job import RenderJob, read_recipe, shipped_job
    from .labels.classes import ClassMap, read_class_map
    from .labels.coco import write_coco
    from .labels.errors import LabelErrors, label_errors
    from .labels.panoptic import PanopticQuality, Segmentation, panoptic_quality
    from .labels.scores import LabelFigures, label_confusion, label_figures
    from .postprocess import (
        absolute_trajectory_error,
        convert_sequence,
        frames_from,
        make_sequence,
        noisy_depth,
        noisy_rgb,
        phone_depth,
        relative_pose_error,
    )
    from .raycast.caster import RayCaster
    from .raycast.held_out import HeldOutView, check_held_out, choose_held_out
    from .render import RenderedFrame, render_frames, render_pose
    from .report.recording import record_sequence
    from .sensor.imu import ImuStream
    from .sensor.imu_noise import IMU_MODELS, ImuNoise
    from .sensor.models import DEPTH_MODELS, RGB_MODELS, depth_model, rgb_model
    from .sensor.transfer import linear_from_srgb8
    from .sequences.compare import SequenceComparison, compare_sequences
    from .sequences.frame_source import FrameSource
    from .sequences.imu import imu_of
    from .sequences.inspection import Inspection, inspect_sequence
    from .sequences.rendered_views import ViewError, ViewErrors, view_errors
    from .sequences.rgbd_sequence import PosedFrame, RgbdSequence, open_sequence
    from .sequences.writer import WrittenSequence
    from .shipped import SCENES, sequence_names
    from .trajectory_files.trajectories import (
        LoadedTrajectory,
        pose_from_pov,
        read_trajectory,
        write_trajectory,
    )
else:

    def __getattr__(name: str) -> Any:
        """Import a public name from its module.

        Raises ImportError, in one line, if a required package is missing.
        """
        if name in _OLD:
            module, instead = _OLD[name]
            text = f"iclnuim.{name} is an old name; try iclnuim.{instead}"
            warnings.warn(text, DeprecationWarning, stacklevel=2)
            globals()[name] = getattr(import_module(f".{module}", __name__), name)
            return globals()[name]
        if name not in _PLACES:
            near = [one for one in __all__ if len(name) > 3 and name.lower() in one.lower()]
            near += [_WORDS[name]] if name in _WORDS else []
            hint = f"; try {', '.join(near)}" if near else ""
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}{hint}")
        module, attribute = _PLACES[name]
        try:
            value = getattr(import_module(f".{module}", __name__), attribute)
        except ModuleNotFoundError as error:
            raise ImportError(package_missing(f"iclnuim.{name}", error).worded()) from None
        globals()[name] = value
        return value

    def __dir__() -> list[str]:
        return sorted(__all__)


#: old public name -> (its module, what to use instead)
_OLD = {
    "absolute_error": ("evaluation.absolute_error", "absolute_trajectory_error"),
    "relative_error": ("evaluation.relative_error", "relative_pose_error"),
    "image_frames": ("sequences.frame_source", "make_sequence with the folder, or open_sequence"),
    "run_frames": ("sequences.frame_source", "make_sequence with the folder"),
    "write_sequence": ("sequences.writer", "make_sequence"),
    "SequenceSettings": (
        "sequences.sequence_options",
        "make_sequence, which takes them as arguments",
    ),
}
#: word that one may look for -> public name
_WORDS = {
    "ate": "absolute_trajectory_error",
    "rpe": "relative_pose_error",
    "export": "convert_sequence",
}
#: public name -> (module, its name there), read from the imports above
_PLACES: dict[str, tuple[str, str]] = {}
for _node in ast.walk(ast.parse(Path(__file__).read_text("utf-8"))):
    if isinstance(_node, ast.ImportFrom) and _node.level and _node.module not in (None, "version"):
        for _alias in _node.names:
            _name = _alias.asname or _alias.name
            if _name in __all__:
                _PLACES[_name] = (_node.module, _alias.name)


def register() -> None:
    """Called by Blender when the extension is enabled.

    Raises InputError for a Blender older than 4.2.
    """
    from .blender import compat

    compat.require_supported_version()
    from . import ui

    ui.register()


def unregister() -> None:
    """Called by Blender when the extension is disabled.

    Removes everything that register() added.
    """
    from . import ui

    ui.unregister()
