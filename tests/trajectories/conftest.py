"""The shipped paths, and a living room that rays can be cast in."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from iclnuim.geometry.camera import PinholeCamera
from iclnuim.trajectory_files.trajectories import read_trajectory


@dataclass(frozen=True)
class RayRoom:
    """A scene's surfaces as one BVH tree; `names[owners[face]]` is the object a face belongs to.

    World metres.
    """

    tree: object
    owners: np.ndarray
    names: list

    def clearance_m(self, positions_m):
        """(n,) distance to the nearest surface, and the name of what it belongs to."""
        found = [self.tree.find_nearest(p) for p in positions_m.tolist()]
        return np.array([f[3] for f in found]), [self.names[self.owners[f[2]]] for f in found]

    def cast(self, T_world_camera, camera: PinholeCamera):
        """Planar depth (n,) (0: nothing hit), normals and points (n, 3) in the world, owner (n,)
        (-1: nothing hit).
        """
        directions = camera.rays().reshape(-1, 3) @ T_world_camera.rotation.T
        origin = T_world_camera.translation.tolist()
        hits = [self.tree.ray_cast(origin, d) for d in directions.tolist()]
        hit = np.array([h[0] is not None for h in hits])
        normals, points, depth_z_m = (
            np.zeros((len(hits), 3)),
            np.zeros((len(hits), 3)),
            np.zeros(len(hits)),
        )
        owner = np.full(len(hits), -1)
        normals[hit] = [h[1] for h in hits if h[0] is not None]
        points[hit] = [h[0] for h in hits if h[0] is not None]
        owner[hit] = self.owners[[h[2] for h in hits if h[0] is not None]]
        depth_z_m[hit] = ((points - T_world_camera.translation) @ T_world_camera.rotation[:, 2])[
            hit
        ]
        return depth_z_m, normals, points, owner


@pytest.fixture(scope="session")
def living_room(repository) -> RayRoom:
    return _ray_room(repository / "blend/living_room.blend")


@pytest.fixture(scope="session")
def office_room(repository) -> RayRoom:
    return _ray_room(repository / "blend/office.blend")


def _ray_room(file: Path) -> RayRoom:
    """All meshes of a scene as Blender evaluates them."""
    bpy = pytest.importorskip("bpy", reason="needs the bpy package")
    from mathutils.bvhtree import BVHTree

    if not file.is_file():
        pytest.skip(f"{file} is not there; make it with: iclnuim scene build {file.stem}")
    bpy.ops.wm.open_mainfile(filepath=str(file))
    vertices, triangles, owners, names = [], [], [], []
    graph, count = bpy.context.evaluated_depsgraph_get(), 0
    for thing in [o for o in bpy.context.scene.objects if o.type == "MESH"]:
        mesh = thing.evaluated_get(graph).to_mesh()
        mesh.calc_loop_triangles()
        vertices += [thing.matrix_world @ v.co for v in mesh.vertices]
        triangles += [[count + i for i in t.vertices] for t in mesh.loop_triangles]
        owners += [len(names)] * len(mesh.loop_triangles)
        names.append(thing.name)
        count += len(mesh.vertices)
    tree = BVHTree.FromPolygons(vertices, triangles, epsilon=0.0)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return RayRoom(tree, np.array(owners), names)


@pytest.fixture(scope="session")
def path_of(repository):
    """`path_of("living_room/kt0")` is the shipped trajectory."""
    return lambda name: read_trajectory(repository / f"trajectories/{name}.txt").trajectory


@pytest.fixture(scope="session")
def recipe_of(repository):
    """`recipe_of("living_room/kt0")` is its recipe as a dictionary of its own."""
    return lambda name: json.loads((repository / f"trajectories/{name}.json").read_text())
