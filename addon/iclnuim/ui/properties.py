"""The settings of the panel, kept in the .blend with its scene, and the job that they describe."""

import bpy
from bpy.props import (
    BoolProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from ..errors import InputError
from ..geometry.camera import PinholeCamera
from ..geometry.scene_axes import MIRRORS, UNITS_M, UP, SceneReading
from ..geometry.trajectory import frame_slice
from ..job import RenderJob

SCENES = (
    ("living_room", "Living room", "The shipped living room, 4.94 x 5.02 x 2.50 m, after the paper's (section III)"),
    ("office", "Office", "The shipped office, 5.0 x 7.4 x 2.40 m, after the paper's (section III)"),
    ("OPEN", "The open file", "The scene in this window; a copy of it is put into the output folder and rendered"),
    ("FILE", "A file", "A .blend, .glb, .gltf, .obj, .ply, .usd or .fbx; turned to z up and metres"),
)
TRAJECTORIES = (
    ("kt0", "kt0", "1510 frames (paper, Table I); passes a bare wall"),
    ("kt1", "kt1", "967 frames (paper, Table I)"),
    ("kt2", "kt2", "882 frames (paper, Table I)"),
    ("kt3", "kt3", "1242 frames (paper, Table I); closes a small loop"),
    ("FILE", "A file", "TUM, *.gt.freiburg, *.gt.sim, KITTI, EuRoC or POV-Ray commands; told by name and content"),
    ("CAMERA", "Active camera", "The animation of the scene's active camera, one pose a frame of the timeline"),
)
DEPTH_NOISE = (
    ("none", "None", "Exact planar depth"),
    ("released", "As released", "The noise found in the released ICL-NUIM frames"),
    ("paper", "Paper", "The paper's model (section IV): lateral shift, disparity noise and quantisation"),
    ("kinect2012", "Kinect 2012", "Axial and lateral noise of a Kinect, Nguyen et al. 2012"),
    ("redwood", "Redwood", "Distortion and quantisation in the manner of the Redwood data, Choi et al. 2015"),
)
RGB_NOISE = (
    ("none", "None", "Scene-linear light to sRGB, nothing else"),
    ("released", "As released", "The noise found in the released ICL-NUIM frames"),
    ("paper", "Paper", "The paper's model (section IV): light-dependent noise through a camera response"),
)
DIALECTS = (
    ("tum", "TUM", "rgb/, depth/, associations.txt, groundtruth.txt; stamps in seconds, depth 5000 per metre"),
    ("icl-nuim", "ICL-NUIM", "As released: integer ids, depth first, left-handed *.gt.freiburg"),
    ("euroc", "EuRoC", "mav0/cam0/data, stamps in nanoseconds"),
    ("nerf", "NeRF", "transforms.json beside the images"),
)
AS_FILE = ("AUTO", "As the file says", "Where its format does not say, a guess from its shape, which is told")
UPS = (AS_FILE, *((axis, axis, f"The file's {axis} axis points up") for axis in UP))
UNITS = (AS_FILE, *((name, name, f"One unit of the file is {metres:g} m") for name, metres in UNITS_M.items()))
MIRRORED = tuple(
    (axis, axis, "Nothing is mirrored" if axis == "none" else f"The {axis} axis is mirrored") for axis in MIRRORS
)
ALIGNMENTS = tuple(
    (name, name, text)
    for name, text in (
        ("se3", "Rotation and translation, least squares (Umeyama 1991); the usual ATE"),
        ("sim3", "Also scale, for a single camera's estimate"),
        ("yaw", "Translation and the turn about z alone"),
        ("origin", "First pose on first pose"),
        ("none", "As it is"),
    )
)


def _path_changed(self, context):
    from . import path

    path.refresh(context)


class ICLNUIM_PG_settings(bpy.types.PropertyGroup):
    """One per scene."""

    scene_source: EnumProperty(name="Scene", items=SCENES, default="living_room", update=_path_changed)
    scene_file: StringProperty(
        name="File",
        subtype="FILE_PATH",
        update=_path_changed,
        description="Scene file: .blend, .glb, .gltf, .obj, .ply, .usd or .fbx",
    )
    scene_up: EnumProperty(
        name="Up", items=UPS, description="Axis that points up in the file; here and in what is rendered, z does"
    )
    scene_unit: EnumProperty(
        name="Unit", items=UNITS, description="What the file's lengths are in; here and in what is rendered, metres"
    )
    scene_mirror: EnumProperty(name="Mirror", items=MIRRORED, description="Axis of the file to mirror before all else")
    scene_textures: StringProperty(
        name="Textures",
        subtype="DIR_PATH",
        description="A further folder that the file's textures may come from; empty: only the file's own",
    )
    trajectory_source: EnumProperty(name="Trajectory", items=TRAJECTORIES, default="kt2", update=_path_changed)
    trajectory_file: StringProperty(
        name="File",
        subtype="FILE_PATH",
        update=_path_changed,
        description="Camera-to-world poses; right-handed unless named *.gt.freiburg or starting as the released ones do",
    )
    scale: FloatProperty(
        name="Scale",
        default=1.0,
        min=1e-3,
        max=1e3,
        update=_path_changed,
        description="Factor on the path's lengths before it is put into the scene, no unit (paper, equation 2)",
    )
    use_start: BoolProperty(
        name="Own start pose",
        update=_path_changed,
        description="Move the path so that its first pose is the one below (paper, equation 2)",
    )
    start_location: FloatVectorProperty(
        name="Start",
        size=3,
        subtype="TRANSLATION",
        default=(0.0, 0.0, 1.5),
        update=_path_changed,
        description="Position of the first pose, metres in Blender's world, z up",
    )
    start_rotation: FloatVectorProperty(
        name="Rotation",
        size=3,
        subtype="EULER",
        default=(1.5707963, 0.0, 0.0),
        update=_path_changed,
        description="Rotation of Blender's camera at the first pose, XYZ Euler; (90, 0, 0) degrees looks along +y",
    )
    show_path: BoolProperty(
        name="Show in the view",
        default=True,
        description="Draw the path as a curve with the cameras' frusta; drawn only, never rendered",
    )
    width: IntProperty(
        name="Width",
        default=640,
        min=8,
        max=8192,
        description="Pixels a row; the benchmark's are 640 (paper, equation 1)",
    )
    height: IntProperty(
        name="Height",
        default=480,
        min=8,
        max=8192,
        description="Rows of pixels; the benchmark's are 480 (paper, equation 1)",
    )
    fx: FloatProperty(
        name="fx",
        default=640 / 1.33,
        min=1.0,
        max=1e5,
        precision=3,
        description="Focal length in pixels along a row; the benchmark's is 640/1.33 = 481.203 (POV-Ray; printed as 481.20)",
    )
    fy: FloatProperty(
        name="fy",
        default=480.0,
        min=1.0,
        max=1e5,
        precision=3,
        description="Focal length in pixels down a column; the paper's -480 only says that its y axis points up",
    )
    cx: FloatProperty(
        name="cx",
        default=319.5,
        min=-1e5,
        max=1e5,
        precision=3,
        description="Principal point in pixels from the centre of the leftmost pixel, which is 0 (paper, equation 1)",
    )
    cy: FloatProperty(
        name="cy",
        default=239.5,
        min=-1e5,
        max=1e5,
        precision=3,
        description="Principal point in pixels from the centre of the topmost pixel, which is 0 (paper, equation 1)",
    )
    light: EnumProperty(
        name="Light",
        default="baked",
        items=(
            (
                "baked",
                "Baked",
                "Diffuse light baked once per scene, as in the paper (section III); minutes once, then fast",
            ),
            ("path", "Path traced", "Every frame traced in full; slow, follows moving things"),
        ),
    )
    samples: IntProperty(
        name="Samples",
        default=0,
        min=0,
        max=65536,
        description="Cycles samples a pixel; 0 takes the light's default: 1 baked, 64 path traced",
    )
    denoise: EnumProperty(
        name="Denoise",
        default="AUTO",
        items=(
            ("AUTO", "Auto", "On for path tracing where this Blender carries OpenImageDenoise"),
            ("ON", "On", "OpenImageDenoise"),
            ("OFF", "Off", "None"),
        ),
    )
    antialias: BoolProperty(
        name="Antialias",
        description="Spread the rays of the colour image over 1.5 pixels; depth stays at the pixel's centre. Off as in the paper (section II)",
    )
    map_size: IntProperty(
        name="Map size", default=2048, min=16, max=16384, description="Side of the light map in texels"
    )
    map_samples: IntProperty(
        name="Map samples", default=32, min=2, max=65536, description="Samples a texel of the light map"
    )
    seed: IntProperty(
        name="Seed",
        default=0,
        min=0,
        max=2**31 - 1,
        description="Seed of Cycles and of the noise, no unit; equal seeds give equal pixels",
    )
    depth_noise: EnumProperty(name="Depth noise", items=DEPTH_NOISE, default="released")
    rgb_noise: EnumProperty(name="RGB noise", items=RGB_NOISE, default="released")
    exposure_ms: FloatProperty(
        name="Exposure",
        default=0.0,
        min=0.0,
        max=33.0,
        description="Milliseconds the shutter is open: motion blur of the colour image; 0 is none, as in the paper. Depth stays sharp",
    )
    readout_ms: FloatProperty(
        name="Readout",
        default=0.0,
        min=0.0,
        max=33.0,
        description="Milliseconds from the first row's exposure to the last's: rolling shutter; 0 is a global shutter, as in the paper",
    )
    out: StringProperty(
        name="Folder",
        subtype="DIR_PATH",
        default="",
        description="Output folder; raw/, clean/ and noisy/ are made in it. Empty: iclnuim beside the saved .blend, or in the extension's own folder while it is not saved",
    )
    dialects: EnumProperty(name="Dialects", items=DIALECTS, options={"ENUM_FLAG"}, default={"tum"})
    write_clean: BoolProperty(
        name="Clean", default=True, description="Also a sequence without noise (PNG, 16-bit depth, 5000 per metre)"
    )
    write_noisy: BoolProperty(name="Noisy", default=True, description="Also a sequence with the sensor's noise")
    frames: StringProperty(
        name="Frames",
        default="::30",
        description="Poses to render as A:B:S, a Python slice: from A, before B, every S-th; :: is all (30 a second). A number is one",
    )
    estimate: StringProperty(
        name="Estimate",
        subtype="FILE_PATH",
        description="Estimated trajectory, camera to world, stamps in seconds (TUM and others)",
    )
    truth: StringProperty(
        name="Ground truth",
        subtype="FILE_PATH",
        description="Ground-truth trajectory; empty takes the path chosen above",
    )
    alignment: EnumProperty(name="Align", items=ALIGNMENTS, default="se3")
    delta: StringProperty(
        name="RPE over",
        default="1s",
        description="Stretch of the relative error: 30 (frames), 1s (seconds) or 0.5m (metres)",
    )

    def camera(self) -> PinholeCamera:
        """K and size, without the rounding of Blender's single floats: six digits are what a person typed."""
        fx = 640 / 1.33 if abs(self.fx - 640 / 1.33) < 5e-4 else round(self.fx, 4)
        if abs(self.fx - self.width / 1.33) < 5e-4:
            fx = self.width / 1.33
        return PinholeCamera(self.width, self.height, fx, round(self.fy, 4), round(self.cx, 4), round(self.cy, 4))

    def reading(self) -> SceneReading:
        """How a scene file is to be read."""
        if self.scene_source != "FILE":
            return SceneReading()
        return SceneReading(
            up=None if self.scene_up == "AUTO" else self.scene_up,
            unit_m=UNITS_M.get(self.scene_unit),
            mirror=self.scene_mirror,
            textures=bpy.path.abspath(self.scene_textures) or None,
        )

    def to_job(self, scene: str, trajectory: str) -> RenderJob:
        """The job, given a shipped name or a file for scene and trajectory (inputs.py). Raises InputError."""
        return RenderJob(
            sequence=trajectory if "/" in trajectory and "." not in trajectory else "own",
            scene=scene,
            trajectory=trajectory,
            camera=self.camera(),
            light=self.light,
            samples=self.samples or None,
            denoise={"AUTO": None, "ON": True, "OFF": False}[self.denoise],
            antialias=self.antialias,
            map_size=self.map_size,
            map_samples=self.map_samples,
            seed=self.seed,
            exposure_s=round(self.exposure_ms, 4) / 1000,
            readout_s=round(self.readout_ms, 4) / 1000,
            reading=self.reading(),
        )

    def frame_numbers(self, count: int) -> list[int]:
        """Poses asked for of `count`. Raises InputError."""
        return list(frame_slice(self.frames, count))

    def sequences(self, out) -> dict | None:
        """What the worker shall make of the frames (dataset/variants.py); None where nothing is asked for. Raises InputError."""
        if not (self.write_clean or self.write_noisy):
            return None
        if not self.dialects:
            raise InputError("a dialect for the sequences", hint="TUM, or switching Clean and Noisy off")
        none, noisy = (
            {"depth": d, "rgb": r, "seed": self.seed} for d, r in (("none", "none"), (self.depth_noise, self.rgb_noise))
        )
        variants = {str(out / "clean"): none} if self.write_clean else {}
        if self.write_noisy:
            variants[str(out / "noisy")] = noisy
        return {"dialects": [name for name, _, _ in DIALECTS if name in self.dialects], "variants": variants}


def register() -> None:
    bpy.utils.register_class(ICLNUIM_PG_settings)
    bpy.types.Scene.iclnuim = PointerProperty(type=ICLNUIM_PG_settings)


def unregister() -> None:
    del bpy.types.Scene.iclnuim
    bpy.utils.unregister_class(ICLNUIM_PG_settings)
