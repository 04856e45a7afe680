"""The living room built once by its command and once opened from its file, as plain arrays."""

import contextlib
import io
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from judges import judge_module


@dataclass(frozen=True)
class Room:
    """Objects by name -> (id, class), surface (vertices, triangles, owners, names), geometry hash,
    triangles.
    """

    objects: dict
    surface: object
    sha256: str
    triangles: int


def captured() -> Room:
    import bpy
    from iclnuim.blend.builder import stage
    from iclnuim.blender import surfaces

    meshes = [o for o in bpy.context.scene.objects if o.type == "MESH"]
    objects = {o.name: (o["instance_id"], o["class_name"]) for o in meshes}
    return Room(objects, surfaces.triangles(), stage.geometry_hash(), stage.triangle_count())


@pytest.fixture(scope="session")
def blender():
    return pytest.importorskip("bpy", reason="needs the bpy package")


@pytest.fixture(scope="module")
def small_textures():
    """Textures of 64 pixels for as long as the module's tests run: what is built is judged by its
    surfaces.
    """
    from iclnuim.blend.builder import living_room_palette, office_palette

    full = living_room_palette._sizes(1.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(living_room_palette, "_sizes", lambda detail: dict.fromkeys(full, 64))
        patch.setattr(office_palette._Painter, "size", lambda self, full: 64)
        yield


@pytest.fixture(scope="session")
def build(blender):
    """`build(seed, detail)` empties the session and builds the living room into it."""
    from iclnuim.blend.builder import build_scene

    def run(seed: int = 0, detail: float = 1.0) -> Room:
        blender.ops.wm.read_factory_settings(use_empty=True)
        build_scene("living_room", seed=seed, detail=detail)
        return captured()

    return run


@pytest.fixture(scope="session")
def commanded(blender, tmp_path_factory) -> tuple[Room, dict, Path]:
    """What `iclnuim scene build living_room` leaves in the session, the figures that it prints, and
    its file.
    """
    from iclnuim.headless import cli

    file = tmp_path_factory.mktemp("commanded") / "room.blend"
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        assert (
            cli.main(["scene", "build", "living_room", "--out", str(file), "--json", "--quiet"])
            == 0
        )
    return captured(), json.loads(printed.getvalue()), file


@pytest.fixture(scope="session")
def built(commanded) -> Room:
    return commanded[0]


@pytest.fixture
def opened(blender, repository) -> Room:
    """The shipped file, open in this session."""
    blender.ops.wm.open_mainfile(
        filepath=str(repository / "blend/living_room.blend"), use_scripts=False
    )
    return captured()


@pytest.fixture(scope="session")
def rays(built):
    """`rays(origins, directions)` -> (distance, owner name index or -1, cosine between ray and face
    normal) by Embree.
    """
    o3d = judge_module("open3d", "open3d-cpu")
    caster = o3d.t.geometry.RaycastingScene()
    caster.add_triangles(
        built.surface.vertices.astype(np.float32), built.surface.triangles.astype(np.uint32)
    )

    def cast(origins, directions):
        lines = np.concatenate(np.broadcast_arrays(origins, directions), -1).astype(np.float32)
        hit = caster.cast_rays(o3d.core.Tensor(lines))
        triangle = hit["primitive_ids"].numpy().astype(np.int64)
        seen = triangle < len(built.surface.triangles)
        owner = np.where(seen, built.surface.owners[np.where(seen, triangle, 0)], -1)
        facing = (hit["primitive_normals"].numpy() * directions).sum(-1)
        return hit["t_hit"].numpy(), owner, facing

    cast.caster = caster
    return cast
