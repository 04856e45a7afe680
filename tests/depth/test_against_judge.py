"""Figures of predicted depth equal those of the package depth-estimation, on 200 frames."""

import json
from pathlib import Path

import numpy as np
import pytest
from iclnuim import depth_error
from judges import OF_DATA, judged_by

NAMES = {
    "abs_rel": "abs_rel",
    "sq_rel": "sq_rel_m",
    "rmse": "rmse_m",
    "rmse_log": "rmse_log",
    "delta1": "delta1",
    "delta2": "delta2",
    "delta3": "delta3",
}


@pytest.mark.slow
def test_figures_are_those_of_depth_estimation(tmp_path):
    rng = np.random.default_rng(5)
    v, u = np.mgrid[0:120, 0:160]
    depths = [2 + v / (40 + k) + np.sin(u / (5 + k / 20)) + k / 100 for k in range(200)]
    true = np.stack(depths).astype(np.float32)
    predicted = (true * np.exp(rng.normal(0, 0.15, true.shape))).astype(np.float32)
    ratio = np.maximum(predicted / true, true / predicted)
    for limit in (1.25, 1.25**2, 1.25**3):  # the judge computes in single precision
        predicted[np.abs(ratio - limit) < 1e-5] *= 1.001
    np.savez(tmp_path / "depth.npz", true=true, predicted=predicted)
    script = Path(__file__).with_name("depth_judge.py")
    said = judged_by("depth-estimation", "torch", script, tmp_path / "depth.npz", python=OF_DATA)
    found = depth_error(true, predicted, boundary=False)
    for frame, judged in zip(found.frames, json.loads(said), strict=True):
        figures = frame.figures.to_dict()
        for theirs, ours in NAMES.items():
            assert figures[ours] == pytest.approx(judged[theirs], rel=1e-6, abs=1e-6), ours
