"""The dataset card of shards: README.md with the header that Hugging Face's hub reads, and what a
reader needs to know.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from .camera_files import SequenceCamera

#: Reference for croissant.json and the card.
CITATION = """@inproceedings{handa2014benchmark,
  author = {Handa, Ankur and Whelan, Thomas and McDonald, John and Davison, Andrew J.},
  title = {A Benchmark for {RGB-D} Visual Odometry, {3D} Reconstruction and {SLAM}},
  booktitle = {IEEE International Conference on Robotics and Automation (ICRA)},
  year = {2014}
}"""
#: Licences that the hub knows are written in lower case; any other is `other`.
_HUB_LICENCES = ("cc-by-4.0", "cc-by-sa-4.0", "cc0-1.0", "mit", "apache-2.0")
#: The hub's words for sizes: at most so many frames.
_SIZES = {1_000: "n<1K", 10_000: "1K<n<10K", 100_000: "10K<n<100K", 1_000_000: "100K<n<1M"}

_CARD = """---
{licence}
pretty_name: {name}
task_categories:
- depth-estimation
tags:
- rgb-d
- slam
- visual-odometry
- webdataset
size_categories:
- {category}
configs:
- config_name: default
  data_files: "*.tar"
---

# {name}

An RGB-D sequence of {frames} frames, {width} x {height} pixels, {what} ICL-NUIM rebuilt (iclnuim).

| file | content |
|---|---|
| {shards} | `NUMBER.rgb.png` (8-bit sRGB), `NUMBER.depth.png` (16-bit planar depth, {units:g} units per metre, 0 = missing), `NUMBER.json` (stamp, pose, camera) of each frame |
| `metadata.jsonl` | the JSON of all frames |
| `rgb.txt`, `depth.txt`, `associations.txt`, `groundtruth.txt`, `camera.json` | lists, poses (if any) and camera: unpacked here, the shards are a sequence in the format of TUM |
| `recipe.json` | how the sequence was made: settings, seed, versions |
| `croissant.json`, `SHA256SUMS` | description for loaders; checksums (`sha256sum -c SHA256SUMS`) |

Size: {megabytes:.1f} MB. Camera: fx {fx:g}, fy {fy:g}, cx {cx:g}, cy {cy:g}; pixel centres are whole numbers.
`T_world_camera` is 4 x 4, in metres; the camera looks along z, x is right, y is down.

```python
import datasets                                     # Hugging Face
frames = datasets.load_dataset("webdataset", data_files="{first}", split="train")

import webdataset                                   # or WebDataset
frames = webdataset.WebDataset("{first}").decode("pil")
```

## Licence

{terms}

## Citation

```bibtex
{citation}
```
"""


def dataset_card(
    about: Mapping[str, Any], camera: SequenceCamera, shards: Sequence[str], size: int, terms: str
) -> str:
    """The text of README.md. about: name, licence, frames, exact (whether depth and poses are those
    of a render); size: bytes of the shards; terms: the text of the licence file.
    """
    pinhole = camera.pinhole
    listed = f"`{shards[0]}`" if len(shards) == 1 else f"`{shards[0]}` to `{shards[-1]}`"
    category = next((text for most, text in _SIZES.items() if about["frames"] <= most), "n>1M")
    return _CARD.format(
        licence=_hub_licence(about["licence"]),
        name=about["name"],
        category=category,
        frames=about["frames"],
        width=pinhole.width,
        height=pinhole.height,
        fx=pinhole.fx,
        fy=pinhole.fy,
        cx=pinhole.cx,
        cy=pinhole.cy,
        what="with exact ground truth, made with" if about["exact"] else "written by",
        shards=listed,
        first=shards[0],
        units=camera.depth_units_per_metre,
        megabytes=size / 1e6,
        terms=terms.strip(),
        citation=CITATION,
    )


def _hub_licence(licence: str) -> str:
    if licence.lower() in _HUB_LICENCES:
        return f"license: {licence.lower()}"
    quoted = licence.replace("\\", "\\\\").replace('"', '\\"')
    return f'license: other\nlicense_name: "{quoted}"'
