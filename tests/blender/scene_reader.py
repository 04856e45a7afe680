"""A process that opens scene files one after another and says in JSON what became of each: for
tests that may crash Blender.
"""

import json
import sys
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "addon"))
    from iclnuim.errors import InputError

    answers = open(sys.argv[1], "a", encoding="utf-8")  # noqa: SIM115
    import bpy
    from iclnuim.blender import surfaces
    from iclnuim.blender.open import light_choice, motion, scene

    for file in sys.argv[2:]:
        answers.write(json.dumps({"file": file, "begun": True}) + "\n")
        answers.flush()
        try:
            scene.open_scene(file)
            scene.scene_sha256(file)
            light_choice.reason_against_baking(bpy.context.scene)
            motion.moving_names(bpy.context.scene)
            outcome = {"triangles": len(surfaces.triangles().triangles)}
        except InputError as error:
            outcome = {"refused": str(error)}
        except BaseException as error:
            import traceback

            outcome = {
                "wrong": f"{type(error).__name__}: {error}",
                "where": traceback.format_exc()[-600:],
            }
        answers.write(json.dumps({"file": file, **outcome}) + "\n")
        answers.flush()
    answers.close()
    import os

    os._exit(0)
