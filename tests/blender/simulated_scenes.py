"""Small scenes with one simulation each, of frames 0 to 10, for the tests of simulations."""

from pathlib import Path

import own_scene_files as made


def rigid(bpy, crate, floor):
    bpy.ops.rigidbody.world_add()
    for thing, kind in ((crate, "ACTIVE"), (floor, "PASSIVE")):
        bpy.context.view_layer.objects.active = thing
        bpy.ops.rigidbody.object_add(type=kind)


def cloth(bpy, crate, floor):
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=6, y_subdivisions=6, location=(0, 0, 1.4))
    bpy.context.object.modifiers.new("cloth", "CLOTH")


def cloth_on_disk(bpy, crate, floor):
    cloth(bpy, crate, floor)
    bpy.context.object.modifiers["cloth"].point_cache.use_disk_cache = True


def soft(bpy, crate, floor):
    crate.modifiers.new("soft", "SOFT_BODY").settings.use_goal = False


def particles(bpy, crate, floor):
    bit = made.box(bpy, "bit", (-0.1, -0.1, -5), (0.1, 0.1, -4.8))
    crate.modifiers.new("particles", "PARTICLE_SYSTEM")
    settings = crate.particle_systems[0].settings
    settings.count = 40
    settings.frame_start = 1
    settings.frame_end = 8
    settings.render_type = "OBJECT"
    settings.instance_object = bit


def hair(bpy, crate, floor):
    crate.modifiers.new("hair", "PARTICLE_SYSTEM")
    system = crate.particle_systems[0]
    system.settings.type = "HAIR"
    system.settings.count = 30
    system.settings.hair_length = 0.5
    system.use_hair_dynamics = True


def zone(bpy, crate, floor):
    tree = bpy.data.node_groups.new("steps", "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    kinds = ("NodeGroupInput", "GeometryNodeSimulationInput", "GeometryNodeSetPosition",
             "GeometryNodeSimulationOutput", "NodeGroupOutput")  # fmt: skip
    given, first, moved, last, result = map(tree.nodes.new, kinds)
    first.pair_with_output(last)
    moved.inputs["Offset"].default_value = (0, -0.08, 0)
    tree.links.new(given.outputs[0], first.inputs["Geometry"])
    tree.links.new(first.outputs["Geometry"], moved.inputs["Geometry"])
    tree.links.new(moved.outputs[0], last.inputs["Geometry"])
    tree.links.new(last.outputs["Geometry"], result.inputs[0])
    crate.modifiers.new("nodes", "NODES").node_group = tree


KINDS = {
    "rigid": rigid, "cloth": cloth, "cloth on disk": cloth_on_disk, "soft": soft,
    "particles": particles, "hair": hair, "zone": zone,
}  # fmt: skip


def write(bpy, kind: str, folder: Path) -> Path:
    """A crate over a floor with a texture beside the file, and the simulation."""
    scene = made.fresh(bpy)
    scene.frame_start = 0
    scene.frame_end = 10
    image = made.picture(bpy, folder / "floor.png")
    corners = [(-3, -3, 0), (3, -3, 0), (3, 3, 0), (-3, 3, 0)]
    floor = made.add(
        bpy, "floor", corners, [(0, 1, 2, 3)], made.material(bpy, "floor", image=image)
    )
    crate = made.box(bpy, "crate", (-0.4, -0.4, 1), (0.4, 0.4, 1.8), made.material(bpy, "red"))
    made.lamp(bpy, location=(0, 0, 4))
    KINDS[kind](bpy, crate, floor)
    scene.frame_set(0)
    file = folder / "scene.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(file))
    image.filepath = "//floor.png"
    bpy.ops.wm.save_mainfile()
    return file
