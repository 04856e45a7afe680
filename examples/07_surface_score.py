"""Fuse the depth images of a sequence, and score the surface against the true model.

python examples/07_surface_score.py out/living_room/kt2/clean living_room surface.png
"""

import sys

import iclnuim
import matplotlib

matplotlib.use("Agg")  # a file and no window

folder, model, picture = sys.argv[1:]  # the model is a room's name or a mesh
sequence = iclnuim.open_sequence(folder)
poses = sequence.truth  # or any estimate, in the world of the model
fused = iclnuim.fuse_sequence(
    sequence, poses, iclnuim.FuseSettings(iclnuim.VolumeSettings(voxel_m=0.02))
)
print(fused)
mesh = fused.mesh
iclnuim.write_ply("surface.ply", mesh.points, mesh.triangles, colours=mesh.colours)

truth = iclnuim.TrueSurface(*iclnuim.read_model(model))
seen_by = iclnuim.SeenBy(sequence.camera, poses.T_world_camera)  # completion is of what these saw
settings = iclnuim.QualitySettings(samples=50_000)
quality = iclnuim.surface_quality(
    truth, mesh.points, mesh.triangles, seen_by=seen_by, settings=settings
)
print(quality)
print(f"F at 1 cm {quality.f_score(0.01):.1%}, at 5 cm {quality.f_score(0.05):.1%}")
quality.plot().figure.savefig(picture)
