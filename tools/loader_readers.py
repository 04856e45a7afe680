"""What loaders of others read from a sequence, each through its own code, unchanged: one function a
loader, which runs in the folder of its checkout.

    python tools/loader_readers.py NAME SEQUENCE OUT [STAND-IN ...]
"""

import importlib
import importlib.util
import os
import sys
import types
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

#: The axes of the camera in OpenGL, and of the official left-handed poses, in those of OpenCV.
_OPENGL = np.diag([1.0, -1, -1, 1])
_LEFT_HANDED = np.diag([1.0, -1, 1, 1])


@dataclass(frozen=True)
class Read:
    """What a loader has read. images: n paths or names of files, in the order of the loader;
    camera: fx, fy, cx, cy in pixels; T_world_camera: (n, 4, 4) of the OpenCV camera, None if it
    reads none; depth_z_m(k): depth image in metres, None if it reads none.
    """

    images: list[str]
    camera: tuple[float, ...]
    T_world_camera: np.ndarray | None = None
    depth_z_m: Callable[[int], np.ndarray] | None = None


class StandIn(types.ModuleType):
    """A module in which every name is a class without content."""

    __path__: list[str] = []

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return type(name, (), {})


def stand_in(name: str) -> None:
    """Make an empty module of this name, in empty packages where it has none."""
    parts = name.split(".")
    for depth in range(1, len(parts) + 1):
        part = ".".join(parts[:depth])
        here = part in sys.modules or (part != name and importlib.util.find_spec(part))
        if not here:
            sys.modules[part] = StandIn(part)


def _arguments() -> types.SimpleNamespace:
    return types.SimpleNamespace(input_folder=None, output=None)


def _intrinsics(holder: Any) -> tuple[float, ...]:
    return tuple(float(getattr(holder, name)) for name in ("fx", "fy", "cx", "cy"))


def _stacked(poses: Any) -> np.ndarray:
    return np.array([np.asarray(pose, float) for pose in poses])


def _replica_of(file: str, base: str, *scale: float) -> Callable[[Path], Read]:
    """The `Replica` of NICE-SLAM and of what grew from it."""

    def read(sequence: Path) -> Read:
        config = importlib.import_module("src.config").load_config(sequence / file, base)
        datasets = importlib.import_module("src.utils.datasets")
        data = datasets.get_dataset(config, _arguments(), *scale, device="cpu")
        poses = _stacked(data.poses) @ _OPENGL
        return Read(data.color_paths, _intrinsics(data), poses, lambda k: data[k][2].numpy())

    return read


def co_slam(sequence: Path) -> Read:
    config = importlib.import_module("config").load_config(sequence / "co-slam.yaml")
    data = importlib.import_module("datasets.dataset").get_dataset(config)
    poses = _stacked(data.poses) @ _OPENGL
    return Read(data.img_files, _intrinsics(data), poses, lambda k: data[k]["depth"].numpy())


def monogs(sequence: Path) -> Read:
    config = importlib.import_module("utils.config_utils").load_config(sequence / "monogs.yaml")
    data = importlib.import_module("utils.dataset").load_dataset(None, None, config)
    data.device = "cpu"
    poses = np.linalg.inv(_stacked(data.poses))
    return Read(data.color_paths, _intrinsics(data), poses, lambda k: data[k][1])


def splatam(sequence: Path) -> Read:
    return _gradslam_copy(sequence, "ReplicaDataset", _camera_of_splatam(sequence))


def splatam_scannet(sequence: Path) -> Read:
    place = sequence / "frames"
    return _gradslam_copy(place, "ScannetDataset", _camera_of_splatam(sequence))


def splatam_icl(sequence: Path) -> Read:
    """Its camera has the official negative fy, with which the poses are left-handed."""
    camera = _camera_of_splatam(sequence)
    camera["fy"] *= -1
    read = _gradslam_copy(sequence, "ICLDataset", camera)
    assert read.T_world_camera is not None
    poses = _LEFT_HANDED @ read.T_world_camera @ _LEFT_HANDED
    return Read(read.images, read.camera, poses, read.depth_z_m)


def _camera_of_splatam(sequence: Path) -> dict[str, Any]:
    content = yaml.safe_load((sequence / "splatam.yaml").read_text())
    return dict(content["camera_params"])


def _gradslam_copy(folder: Path, kind: str, camera: dict[str, Any]) -> Read:
    datasets = importlib.import_module("datasets.gradslam_datasets")
    config = {"dataset_name": "ours", "camera_params": camera}
    size = {"desired_height": camera["image_height"], "desired_width": camera["image_width"]}
    make = getattr(datasets, kind)
    data = make(config, folder.parent, folder.name, stride=1, device="cpu", **size)
    matrix = data[0][2].numpy()
    k = (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
    poses = _stacked(data.transformed_poses)
    return Read(data.color_paths, k, poses, lambda k: data[k][1].numpy())


def gradslam_icl(sequence: Path) -> Read:
    """All frames as one of its sequences, at 1 / 80 of the size; fy is negative, as above."""
    icl = importlib.import_module("gradslam.datasets.icl")
    count = len((sequence / "associations.txt").read_text().splitlines())
    data = icl.ICL(str(sequence.parent), seqlen=count, height=6, width=8)
    _, depth, intrinsics, poses, _, names = data[0]
    matrix = 80 * intrinsics[0].numpy()
    k = (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
    images = [f"{name}.png" for name in names.split(", ")]
    T = _LEFT_HANDED @ _stacked(poses) @ _LEFT_HANDED
    return Read(images, k, T, lambda k: depth[k].numpy())


def mast3r_slam(sequence: Path) -> Read:
    """What its main.py does with --calib. Modules that are left out import PIL.Image, and have the
    image as (1, 3, h, w), here without its normalization.
    """
    importlib.import_module("PIL.Image")
    norm = {"ImgNorm": lambda image: np.moveaxis(np.asarray(image), 2, 0)}
    vars(sys.modules["dust3r.utils.image"]).update(norm)
    module = importlib.import_module("mast3r_slam.config")
    module.load_config("config/calib.yaml")
    loader = importlib.import_module("mast3r_slam.dataloader")
    data = loader.load_dataset(str(sequence))
    settings = yaml.safe_load((sequence / "mast3r-slam.yaml").read_text())
    given = loader.Intrinsics.from_calib(
        data.img_size, settings["width"], settings["height"], settings["calibration"]
    )
    if np.abs(data.camera_intrinsics.K_orig - given.K_orig).max() > 1e-4:  # single precision
        raise ValueError("calibration.txt and mast3r-slam.yaml differ")
    K = given.K_orig
    return Read([str(file) for file in data.rgb_files], (K[0, 0], K[1, 1], K[0, 2], K[1, 2]))


def droid_slam(sequence: Path) -> Read:
    """Its script has the images resized; the camera is that of the whole image again."""
    from evo.tools import file_interface

    sys.path.insert(0, "evaluation_scripts")
    script = importlib.import_module("test_eth3d")
    if (sequence / "droid-slam.txt").read_text() != (sequence / "calibration.txt").read_text():
        raise ValueError("calibration.txt and droid-slam.txt differ")
    depths = []
    for given in script.image_stream(str(sequence), use_depth=True):
        _, image, depth, intrinsics = given
        depths.append(depth.numpy()[::100, ::100])
        resized = image.shape[2:]
    images = sorted(str(path) for path in (sequence / "rgb").glob("*.png"))
    whole = script.cv2.imread(images[0]).shape
    factors = (whole[1] / resized[1], whole[0] / resized[0])
    camera = tuple(float(v) * factors[n % 2] for n, v in enumerate(intrinsics))
    truth = file_interface.read_tum_trajectory_file(str(sequence / "groundtruth.txt"))
    return Read(images, camera, np.array(truth.poses_se3), lambda k: depths[k])


def nerfstudio(sequence: Path) -> Read:
    """Its parser for each split, with the world as it is; depth is read as its data set does."""
    module = importlib.import_module("nerfstudio.data.dataparsers.nerfstudio_dataparser")
    depth_of = importlib.import_module("nerfstudio.data.utils.data_utils")
    given = {"orientation_method": "none", "center_method": "none", "auto_scale_poses": False}
    config = module.NerfstudioDataParserConfig(data=sequence, **given)
    images: list[str] = []
    depths: list[Path] = []
    poses = []
    for split in ("train", "test"):
        found = config.setup().get_dataparser_outputs(split)
        images += map(str, found.image_filenames)
        depths += found.metadata["depth_filenames"]
        poses.append(found.cameras.camera_to_worlds.numpy())
    train = len(poses[0])
    if images[:train] != sorted(images[:train]) or images[train:] != sorted(images[train:]):
        raise ValueError("a split is out of order")
    order = np.argsort(images)
    T = np.tile(np.eye(4), (len(images), 1, 1))
    T[:, :3] = np.concatenate(poses)[order]
    camera = found.cameras[0]
    k = [float(getattr(camera, name)) for name in ("fx", "fy", "cx", "cy")]
    scale = found.metadata["depth_unit_scale_factor"] * found.dataparser_scale
    read = depth_of.get_depth_image_from_path

    def depth_z_m(at: int) -> np.ndarray:
        return read(depths[order[at]], int(camera.height), int(camera.width), scale).numpy()

    return Read(
        [images[n] for n in order], (*k[:2], k[2] - 0.5, k[3] - 0.5), T @ _OPENGL, depth_z_m
    )


def vslam_lab(sequence: Path) -> Read:
    """Our class in its folder of classes, its selection of frames and its reader of trajectories;
    the lines of rgb.csv and calibration.yaml are for its C++ parts.
    """
    files = Path("Datasets/dataset_files")
    for file in sequence.glob("dataset_iclnuim.*"):
        (files / file.name).write_text(file.read_text())
    benchmark = sequence.parent / "benchmark"
    (benchmark / "ICLNUIM").mkdir(parents=True, exist_ok=True)
    place = benchmark / "ICLNUIM" / sequence.name
    if not place.is_symlink():
        place.symlink_to(sequence)
    ours = importlib.import_module("Datasets.dataset_files.dataset_iclnuim")
    data = ours.ICLNUIM_dataset(benchmark)
    data.download_sequence(sequence.name)
    if data.check_sequence_availability(sequence.name) != "available":
        raise ValueError("the sequence is not available")
    frames = importlib.import_module("Run.downsample_rgb_frames")
    images, stamps_ns, rows = frames.downsample_rgb_frames(place / "rgb.csv", 10_000, data.rgb_hz)
    table = importlib.import_module("utilities").read_trajectory_csv(place / "groundtruth.csv")
    if stamps_ns != table.iloc[:, 0].tolist():
        raise ValueError("rgb.csv and groundtruth.csv have other stamps")
    text = (place / "calibration.yaml").read_text().split("---")[-1]
    camera = yaml.safe_load(text.removeprefix("%YAML:1.0"))["cameras"][0]
    depths = [place / row["path_depth_0"] for row in rows]
    from scipy.spatial.transform import Rotation

    T = np.tile(np.eye(4), (len(images), 1, 1))
    values = table.to_numpy(float)
    T[:, :3, :3] = Rotation.from_quat(values[:, 4:8]).as_matrix()
    T[:, :3, 3] = values[:, 1:4]
    k = (*camera["focal_length"], *camera["principal_point"])
    return Read(images, k, T, lambda k: _png(depths[k]) / camera["depth_factor"])


def _png(path: Path) -> np.ndarray:
    import cv2

    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED).astype(float)


def pycolmap(sequence: Path) -> Read:
    module = importlib.import_module("pycolmap")
    model = module.Reconstruction(sequence / "sparse/0")
    images = [model.images[number] for number in sorted(model.images)]
    T = np.tile(np.eye(4), (len(images), 1, 1))
    for row, image in zip(T, images, strict=True):
        row[:3] = image.cam_from_world().inverse().matrix()
    (camera,) = model.cameras.values()
    fx, fy, cx, cy = camera.params
    return Read([image.name for image in images], (fx, fy, cx - 0.5, cy - 0.5), T)


READERS: dict[str, Callable[[Path], Read]] = {
    "nice-slam": _replica_of("nice-slam.yaml", "configs/nice_slam.yaml", 1.0),
    "point-slam": _replica_of("point-slam.yaml", "configs/point_slam.yaml"),
    "eslam": _replica_of("eslam.yaml", "configs/ESLAM.yaml", 1.0),
    "co-slam": co_slam,
    "monogs": monogs,
    "splatam": splatam,
    "splatam-scannet": splatam_scannet,
    "splatam-icl": splatam_icl,
    "gradslam-icl": gradslam_icl,
    "mast3r-slam": mast3r_slam,
    "droid-slam": droid_slam,
    "nerfstudio": nerfstudio,
    "vslam-lab": vslam_lab,
    "pycolmap": pycolmap,
}


def main(arguments: list[str]) -> None:
    name, sequence, out, *stand_ins = arguments
    sys.path[0] = os.getcwd()
    vars(np).setdefault("unicode_", np.str_)  # the name in NumPy 1
    for module in stand_ins:
        stand_in(module)
    read = READERS[name](Path(sequence))
    arrays: dict[str, Any] = {"images": read.images, "camera": read.camera}
    if read.T_world_camera is not None:
        arrays["T_world_camera"] = read.T_world_camera
    if read.depth_z_m is not None:
        spans = []
        for k in range(len(read.images)):
            depth_z_m = read.depth_z_m(k)
            spans.append((depth_z_m.min(), depth_z_m.max()))
        arrays["depth_spans_m"] = spans
    np.savez(out, **arrays)


if __name__ == "__main__":
    main(sys.argv[1:])
