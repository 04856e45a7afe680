"""What Hugging Face's datasets, WebDataset and mlcroissant load, run by a Python that has them:

    python loaders_judge.py FOLDER SHARDS CACHE

prints JSON: of every loader the frames' names, stamps, poses and sums of pixels.
"""

import hashlib
import json
import sys
from pathlib import Path

import numpy as np


def pixels(image):
    return hashlib.sha256(np.ascontiguousarray(np.asarray(image)).tobytes()).hexdigest()


def frame(rgb, depth, stamp_s, pose):
    return {"rgb": pixels(rgb), "depth": pixels(depth), "stamp_s": stamp_s, "pose": pose}


def by_datasets(folder, shards, cache):
    import datasets

    where = {"split": "train", "cache_dir": cache}
    found = {}
    rows = datasets.load_dataset("imagefolder", data_dir=folder, **where)
    found["folder"] = [
        frame(row["image"], row["depth"], row["stamp_s"], row["T_world_camera"]) for row in rows
    ]
    rows = datasets.load_dataset(shards, **where)
    found["shards"] = []
    for row in rows:
        about = row["json"]
        images = row["rgb.png"], row["depth.png"]
        found["shards"].append(frame(*images, about["stamp_s"], about["T_world_camera"]))
    return found


def by_webdataset(shards):
    import webdataset

    files = sorted(map(str, Path(shards).glob("*.tar")))
    found = []
    for sample in webdataset.WebDataset(files, shardshuffle=False).decode("pil"):
        about = sample["json"]
        # "pil" decodes to 8-bit colour; the depth is decoded from its bytes
        found.append((sample["__key__"], about["stamp_s"], about["T_world_camera"]))
    raw = webdataset.WebDataset(files, shardshuffle=False)
    bytes_of = [hashlib.sha256(sample["depth.png"]).hexdigest() for sample in raw]
    return {"webdataset": found, "webdataset_depth": bytes_of}


def by_croissant(shards):
    import mlcroissant

    data = mlcroissant.Dataset(jsonld=str(Path(shards) / "croissant.json"))
    images = {}
    for kind in ("rgb", "depth"):
        for record in data.records(f"{kind}_images"):
            name = record[f"{kind}_images/file_name"].decode()
            images[name] = record[f"{kind}_images/image"]
    found = []
    for record in data.records("frames"):
        names = [record[f"frames/{name}"].decode() for name in ("file_name", "depth_file_name")]
        rgb, depth = (images[name] for name in names)
        pose = np.array(record["frames/T_world_camera"]).astype(float).tolist()
        found.append(frame(rgb, depth, record["frames/stamp_s"], pose))
    return {"croissant": found, "errors": list(data.metadata.issues.errors)}


def main(folder, shards, cache):
    found = by_datasets(folder, shards, cache)
    print(json.dumps(found | by_webdataset(shards) | by_croissant(shards)))


if __name__ == "__main__":
    main(*sys.argv[1:])
