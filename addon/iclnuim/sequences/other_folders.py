"""Folders of other programs that are no sequence as they are: by what lies in them, what to do."""

from pathlib import Path

#: Of what such a folder has: what it is, and what works.
_KNOWN = {
    "exr/*.exr": ("the EXR frames of a run", "`iclnuim dataset`, which makes a sequence of them"),
    "transforms_*.json": (
        "NeRF's data without depth",
        "`iclnuim trajectory` with one of its transforms_*.json, for the poses",
    ),
    "rgbd/*.depth": (
        "Record3D's .r3d, whose depth is compressed by LZFSE",
        "the app's export as EXR and JPG",
    ),
    "depth_*.tiff": (
        "Kubric's TIFF, whose depth is along the ray",
        "planar depth in metres as depth/NAME.exr or .npy, colour in rgb/, and a camera.json",
    ),
    "keyframes/*": ("Polycam's data without cameras or images", "its export of raw data"),
    "rgb.mp4": ("a video", "its frames as images: ffmpeg -i rgb.mp4 rgb/%06d.jpg"),
    "seq-*/frame-*.depth.png": ("the sequences of a scene of 7-Scenes", "one of them, as seq-01"),
}


def known_folder(folder: Path) -> tuple[str, str] | None:
    """What a folder is, and what works instead; None if it is not known."""
    for pattern, words in _KNOWN.items():
        if next(folder.glob(pattern), None) is not None:
            return words
    return None
