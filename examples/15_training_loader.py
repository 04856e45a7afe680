"""A data set for PyTorch in ten lines, and a small network that it trains. Needs the package torch.

python examples/15_training_loader.py out/living_room/kt2/clean loss.png
"""

import sys

import iclnuim
import matplotlib
import torch

matplotlib.use("Agg")  # a file and no window
from matplotlib import pyplot  # noqa: E402


class Frames(torch.utils.data.Dataset):
    """Colour (3, h, w) of 0..1, depth (1, h, w) in metres, and the camera's pose of each frame."""

    def __init__(self, folder):
        self.sequence = iclnuim.open_sequence(folder)

    def __len__(self):
        return len(self.sequence)

    def __getitem__(self, index):
        frame = self.sequence[index]
        rgb = torch.from_numpy(frame.rgb).permute(2, 0, 1) / 255
        pose = torch.tensor(frame.T_world_camera.matrix, dtype=torch.float32)
        return rgb, torch.from_numpy(frame.depth_z_m)[None], pose


folder, picture = sys.argv[1:]
torch.manual_seed(0)
loader = torch.utils.data.DataLoader(Frames(folder), batch_size=2, shuffle=True)
network = torch.nn.Sequential(
    torch.nn.Conv2d(3, 8, 5, padding=2), torch.nn.ReLU(), torch.nn.Conv2d(8, 1, 5, padding=2)
)
optimizer = torch.optim.Adam(network.parameters(), lr=1e-2)
losses = []
for _ in range(4):
    for rgb, depth_m, _ in loader:
        loss = (network(rgb) - depth_m)[depth_m > 0].abs().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(float(loss.detach()))
print(f"{len(loader.dataset)} frames, loss {losses[0]:.2f} m to {losses[-1]:.2f} m")

pyplot.figure(figsize=(6, 3), layout="constrained")
pyplot.plot(losses)
pyplot.xlabel("step")
pyplot.ylabel("mean error (m)")
pyplot.savefig(picture)
