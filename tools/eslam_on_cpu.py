"""ESLAM on the CPU: the settings of `iclnuim settings eslam`, with fewer iterations and pixels.

    iclnuim convert out/living_room/kt2/clean kt2 --frames :20 --format replica
    iclnuim settings eslam kt2
    python tools/eslam_on_cpu.py out/loaders/code/ESLAM kt2 estimate.txt
    iclnuim evaluate ate kt2/traj.txt estimate.txt

Its code is unchanged (tools/loaders.py fetches it). Stand-ins: the two functions of PyTorch3D that
it calls, and the mesh, which is not made.
"""

import os
import sys
import types
from pathlib import Path
from typing import Any

import numpy as np
import torch
import yaml
from scipy.spatial.transform import Rotation

#: What differs from its own settings for Replica.
_CHANGED = {
    "device": "cpu",
    "keyframe_device": "cpu",
    "tracking": {"pixels": 1000},
    "mapping": {"pixels": 1000, "iters_first": 100},
}
_OPENGL = np.diag([1.0, -1, -1, 1])


def quaternion_to_matrix(wxyz: torch.Tensor) -> torch.Tensor:
    """(n, 4) of any length -> (n, 3, 3)."""
    w, x, y, z = torch.unbind(wxyz, -1)
    rows = (
        *(w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)),
        *(2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)),
        *(2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z),
    )
    squared = (wxyz * wxyz).sum(-1)
    return (torch.stack(rows, -1) / squared[:, None]).reshape(-1, 3, 3)


def matrix_to_quaternion(matrices: torch.Tensor) -> torch.Tensor:
    """(n, 3, 3) -> (n, 4) w, x, y, z, of which the largest is positive."""
    xyzw = Rotation.from_matrix(matrices.detach().numpy()).as_quat()
    return torch.tensor(np.roll(xyzw, 1, -1), dtype=matrices.dtype)


class NoMesh:
    """In place of its Mesher."""

    def __init__(self, *given: Any) -> None:
        pass

    def get_mesh(self, *given: Any) -> None:
        pass


def _stand_in(name: str, **content: Any) -> None:
    module = types.ModuleType(name)
    vars(module).update(content)
    sys.modules[name] = module


_stand_in("pytorch3d")
_stand_in(
    "pytorch3d.transforms",
    matrix_to_quaternion=matrix_to_quaternion,
    quaternion_to_matrix=quaternion_to_matrix,
)
_stand_in("src.utils.Mesher", Mesher=NoMesh)
_stand_in("src.tools.cull_mesh", cull_mesh=lambda *given, **named: None)
torch.set_num_threads(1)
torch.manual_seed(0)


def main(code: Path, sequence: Path, estimate: Path) -> None:
    """Run it, and write its trajectory: one 4 x 4 matrix a frame."""
    from iclnuim.geometry.se3 import SE3
    from iclnuim.geometry.trajectory import Trajectory, stamps_of_frames
    from iclnuim.trajectory_files.trajectories import write_trajectory

    out = estimate.resolve().with_suffix("")
    estimate = estimate.resolve()
    settings = out.with_suffix(".yaml")
    named = {"inherit_from": str(sequence.resolve() / "eslam.yaml"), "data": {"output": str(out)}}
    settings.write_text(yaml.safe_dump({**named, **_CHANGED}))
    os.chdir(code)
    sys.path.insert(0, str(code.resolve()))
    from src import config
    from src.ESLAM import ESLAM

    given = types.SimpleNamespace(input_folder=None, output=None)
    ESLAM(config.load_config(settings, "configs/ESLAM.yaml"), given).run()
    last = max((out / "ckpts").glob("*.tar"))
    poses = torch.load(last, map_location="cpu", weights_only=False)["estimate_c2w_list"]
    T = SE3.from_matrix(poses.numpy().astype(float) @ _OPENGL)
    write_trajectory(estimate, Trajectory(stamps_of_frames(np.arange(len(T))), T), "replica")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
