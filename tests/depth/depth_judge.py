"""The seven figures of the package depth-estimation, run by a Python that has it and torch:

    python depth_judge.py DEPTH.npz

prints JSON. The file has true and predicted depth (frames, h, w), of which the predicted is
aligned. Its module is loaded alone: the package imports networks.
"""

import importlib.metadata
import importlib.util
import json
import sys

import numpy as np
import torch


def metrics():
    place = importlib.metadata.distribution("depth-estimation").locate_file(
        "depth_estimation/evaluation/metrics.py"
    )
    spec = importlib.util.spec_from_file_location("metrics", place)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.DepthMetrics(eps=0.0)


def main(path):
    given = np.load(path)
    judge = metrics()
    found = []
    for true, predicted in zip(given["true"], given["predicted"], strict=True):
        found.append(judge(torch.from_numpy(predicted), torch.from_numpy(true)))
    print(json.dumps(found))


if __name__ == "__main__":
    main(sys.argv[1])
