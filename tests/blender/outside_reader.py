"""A process that opens scene files one after another and evaluates and renders each, to be watched:
OPENED.jsonl `plain`, `checked` or `walled`, files.

plain: by Blender alone, as if all were allowed. checked: as every command opens them. walled: by
Blender alone behind the wall of a process that may read the folder of the first file's folder.
"""

import json
import os
import sys
import tempfile
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "addon"))
    scenes = list(map(Path, sys.argv[3:]))
    if sys.argv[2] == "walled":
        from iclnuim import scene_wall
        from iclnuim.geometry.scene_axes import SceneReading

        os.environ["TMPDIR"] = scratch = tempfile.mkdtemp()
        within = str(scenes[0].parent)
        if not scene_wall.around(
            within, SceneReading(), sys.executable, [], [Path(scratch), Path(sys.argv[1]).parent]
        ).put_up():
            sys.exit("no Landlock")
    import bpy
    from iclnuim.blender.open import importers, scene
    from iclnuim.errors import InputError

    rows = []
    for file in scenes:
        row = {"way": file.parent.name}
        try:
            if sys.argv[2] == "checked":
                scene.open_scene(str(file))
            else:
                scene.open_empty()
                importers.load(file)
            opened = bpy.context.scene
            opened.render.engine = "CYCLES"
            opened.cycles.samples = 1
            opened.render.resolution_x = opened.render.resolution_y = 8
            opened.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
            opened.camera.location = (0.3, 0.3, 5)
            opened.collection.objects.link(opened.camera)
            opened.frame_set(2)
            bpy.ops.render.render()
        except InputError as error:
            row["refused"] = str(error)
        rows.append(json.dumps(row))
    Path(sys.argv[1]).write_text("\n".join(rows))
    os._exit(0)
