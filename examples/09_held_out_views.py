"""Choose novel views of a scene for view synthesis: new poses of what a sequence saw.

python examples/09_held_out_views.py out/living_room/kt2/clean living_room views.png
"""

import sys

import iclnuim
import matplotlib

matplotlib.use("Agg")  # a file and no window

folder, model, picture = sys.argv[1:]  # the model is a room's name or a mesh
sequence = iclnuim.open_sequence(folder)
training = sequence.truth.T_world_camera[::10]
caster = iclnuim.RayCaster(*iclnuim.read_model(model))
views = iclnuim.choose_held_out(caster, sequence.camera, training, 3, seed=1)
for view in iclnuim.check_held_out(caster, sequence.camera, views, training):
    print(view)
iclnuim.write_trajectory("views.txt", iclnuim.Trajectory.at_rate(views), "tum")

axes = sequence.truth.plot(label="sequence")
axes.plot(*views.translation[:, :2].T, "o", label="held out")
axes.legend()
axes.figure.savefig(picture)
