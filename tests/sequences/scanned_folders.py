"""Folders as scanners and phones write them, of a camera moved by hand in a room, by numpy, json and
OpenCV alone. Each writer returns the camera of depth that the folder means.
"""

import json
from pathlib import Path

import cv2
import numpy as np
from iclnuim.formats.exr import write_exr
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.geometry.se3 import SE3

from ..moving_box import CAMERA, depth_z_m, hand_held

FRAMES = 8
POSES = hand_held(5 * FRAMES, 3)[::5]
#: The camera of colour of phones: the same view with four times the pixels.
WIDE = CAMERA.resized(2 * CAMERA.width, 2 * CAMERA.height)
OPENGL = POSES.matrix @ np.diag([1.0, -1.0, -1.0, 1.0])
DEPTH_M = [depth_z_m(POSES[number]).astype(np.float32) for number in range(FRAMES)]


def colour(path: Path, number: int, camera: PinholeCamera = CAMERA) -> None:
    image = np.full((camera.height, camera.width, 3), 10 + 20 * number, np.uint8)
    image[: camera.height // 2, :, 1] += 5
    written(path, image)


def depth_mm(path: Path, number: int) -> None:
    written(path, np.rint(1000 * DEPTH_M[number]).astype(np.uint16))


def written(path: Path, image: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)


def text(path: Path, content: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(content if isinstance(content, str) else json.dumps(content))


def rows(matrix: np.ndarray) -> str:
    return "".join(" ".join(f"{value:.9f}" for value in row) + "\n" for row in matrix)


def square(camera: PinholeCamera) -> str:
    """Sixteen numbers of a camera matrix in a line."""
    K = np.eye(4)
    K[:3, :3] = camera.K
    return " ".join(f"{value:g}" for value in K.ravel())


def seven_scenes(folder: Path) -> PinholeCamera:
    """Without a camera; missing depth is 65535."""
    camera = PinholeCamera(640, 480, 585.0, 585.0, 320.0, 240.0)
    for number in range(FRAMES):
        stem = f"frame-{number:06}"
        colour(folder / f"{stem}.color.png", number, camera)
        units = np.rint(1000 * depth_z_m(POSES[number], camera)).astype(np.uint16)
        units[:5] = 65535
        written(folder / f"{stem}.depth.png", units)
        text(folder / f"{stem}.pose.txt", rows(POSES[number].matrix))
    return camera


def bundle_fusion(folder: Path) -> PinholeCamera:
    for number in range(FRAMES):
        stem = f"frame-{number:06}"
        colour(folder / f"{stem}.color.jpg", number, WIDE)
        depth_mm(folder / f"{stem}.depth.png", number)
        text(folder / f"{stem}.pose.txt", rows(POSES[number].matrix))
    same = " ".join(f"{value:g}" for value in np.eye(4).ravel())
    said = {
        "m_versionNumber": 4,
        "m_sensorName": "StructureSensor",
        "m_colorWidth": WIDE.width,
        "m_colorHeight": WIDE.height,
        "m_depthWidth": CAMERA.width,
        "m_depthHeight": CAMERA.height,
        "m_depthShift": 1000,
        "m_calibrationColorIntrinsic": square(WIDE),
        "m_calibrationColorExtrinsic": same,
        "m_calibrationDepthIntrinsic": square(CAMERA),
        "m_calibrationDepthExtrinsic": same,
        "m_frames.size": FRAMES,
    }
    text(folder / "info.txt", "".join(f"{key} = {value}\n" for key, value in said.items()))
    return CAMERA


def log(path: Path) -> None:
    blocks = [f"{n} {n} {n + 1}\n{rows(POSES[n].matrix)}" for n in range(FRAMES)]
    text(path, "".join(blocks))


def open3d_recorder(folder: Path) -> PinholeCamera:
    for number in range(FRAMES):
        colour(folder / f"color/{number:06}.jpg", number)
        depth_mm(folder / f"depth/{number:06}.png", number)
    K = CAMERA.K.T.ravel().tolist()
    size = {"width": CAMERA.width, "height": CAMERA.height}
    text(folder / "camera_intrinsic.json", {**size, "intrinsic_matrix": K})
    log(folder / "scene/trajectory.log")
    return CAMERA


def redwood(folder: Path) -> PinholeCamera:
    """The augmented ICL-NUIM, without a camera."""
    camera = PinholeCamera(640, 480, 525.0, 525.0, 319.5, 239.5)
    for number in range(FRAMES):
        colour(folder / f"colors/{number:05}.jpg", number, camera)
        units = np.rint(1000 * depth_z_m(POSES[number], camera)).astype(np.uint16)
        written(folder / f"depth/{number:05}.png", units)
    log(folder / "office1-traj.txt")
    return camera


def stray_scanner(folder: Path) -> PinholeCamera:
    lines = ["timestamp, frame, x, y, z, qx, qy, qz, qw"]
    for number in range(FRAMES):
        colour(folder / f"rgb/{number:06}.jpg", number, WIDE)
        depth_mm(folder / f"depth/{number:06}.png", number)
        written(folder / f"confidence/{number:06}.png", np.full((120, 160), 2, np.uint8))
        pose = [*POSES[number].translation, *POSES[number].quat_xyzw]
        values = ", ".join(f"{value:.9f}" for value in pose)
        lines.append(f"{7000 + number / 60:.6f}, {number:06}, {values}")
    text(folder / "odometry.csv", "\n".join(lines) + "\n")
    K = "\n".join(", ".join(f"{value:.4f}" for value in row) for row in WIDE.K)
    text(folder / "camera_matrix.csv", K + "\n")
    return CAMERA


def record3d(folder: Path) -> PinholeCamera:
    poses = []
    for number in range(FRAMES):
        colour(folder / f"rgb/{number}.jpg", number, WIDE)
        (folder / "depth").mkdir(exist_ok=True)
        write_exr(folder / f"depth/{number}.exr", {"R": DEPTH_M[number]})
        pose = SE3.from_matrix(OPENGL[number])
        poses.append([*pose.quat_xyzw.tolist(), *pose.translation.tolist()])
    content = {"w": WIDE.width, "h": WIDE.height, "K": WIDE.K.T.ravel().tolist(), "fps": 60}
    content |= {"poses": poses, "dw": CAMERA.width, "dh": CAMERA.height}
    text(folder / "metadata.json", content)
    return CAMERA


def polycam(folder: Path) -> PinholeCamera:
    for number in range(FRAMES):
        name = str(52_000_000_000 + 66_000 * number)
        colour(folder / f"keyframes/corrected_images/{name}.jpg", number, WIDE)
        colour(folder / f"keyframes/images/{name}.jpg", 0, WIDE)
        depth_mm(folder / f"keyframes/depth/{name}.png", number)
        said: dict[str, float] = {"width": WIDE.width, "height": WIDE.height, "blur_score": 9.0}
        said |= {"fx": WIDE.fx, "fy": WIDE.fy, "cx": WIDE.cx, "cy": WIDE.cy}
        for row in range(3):
            for column in range(4):
                said[f"t_{row}{column}"] = float(OPENGL[number][row, column])
        text(folder / f"keyframes/corrected_cameras/{name}.json", said)
        text(folder / f"keyframes/cameras/{name}.json", said)
    return CAMERA


def tum_with_exr(folder: Path) -> PinholeCamera:
    """Blender's depth by hand beside colour, and our camera.json."""
    lines = []
    for number in range(FRAMES):
        colour(folder / f"rgb/{number:04}.png", number)
        depth = DEPTH_M[number].copy()
        depth[:5] = 1e10
        (folder / "depth").mkdir(exist_ok=True)
        write_exr(folder / f"depth/{number:04}.exr", {"ViewLayer.Depth.V": depth})
        pose = [*POSES[number].translation, *POSES[number].quat_xyzw]
        stamp_s = 1 + number / 30
        lines.append(f"{stamp_s:.6f} " + " ".join(f"{value:.9f}" for value in pose))
    text(folder / "groundtruth.txt", "\n".join(lines) + "\n")
    text(folder / "camera.json", CAMERA.to_dict())
    return CAMERA


WRITERS = {
    "7-scenes": seven_scenes,
    "bundle-fusion": bundle_fusion,
    "open3d": open3d_recorder,
    "redwood": redwood,
    "stray-scanner": stray_scanner,
    "record3d": record3d,
    "polycam": polycam,
    "tum with exr": tum_with_exr,
}
#: Format by which a folder is read, where it is not the writer's name.
READ_AS = {"bundle-fusion": "7-scenes", "redwood": "open3d", "tum with exr": "tum"}
