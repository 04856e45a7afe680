"""The light that the open scene allows: a light map, or path tracing if it cannot have one."""

from dataclasses import replace

import bpy
from bpy.types import DepsgraphObjectInstance, Material, Node, Object, Scene

from ...job import RenderJob
from .. import compat, materials, surfaces
from ..notes import names_of
from .motion import moving_names

#: Maximum number of triangles for baked light. A light map has about as many texels, and a layout
#: of more triangles takes minutes.
MAX_BAKED = 2_000_000
#: Diffuse shaders that baked light cannot replace.
_NO_LIGHT_MAP = {"BSDF_TOON", "BSDF_SHEEN"}
#: A mesh can have eight UV maps, and the light map needs two.
_MAX_UV_MAPS = 6


def with_possible_light(job: RenderJob) -> tuple[RenderJob, list[str]]:
    """The job with the light that the open scene allows, and a note if that is not the requested
    light.
    """
    if job.light == "path" or (obstacle := reason_against_baking(bpy.context.scene)) is None:
        return job, []
    return with_light(job, "path"), [f"{obstacle}: path traced instead of baked light"]


def with_light(job: RenderJob, light: str) -> RenderJob:
    """The job with this light.

    Samples that were set with light "auto" are kept. Denoising is disabled if this Blender has no
    denoiser.
    """
    job = replace(job, light=light) if job.light == "auto" else job.changed(light=light)
    return job if compat.has_denoiser() else job.changed(denoise=False)


def reason_against_baking(scene: Scene) -> str | None:
    """The reason why the scene cannot have a light map, or None."""
    if moving := moving_names(scene):
        return f"objects or lights that move ({names_of(moving)})"
    if strands := strand_names(scene):
        return f"hair, curves or points ({names_of(strands)})"
    if volumes := volume_names(scene) or _made_volume_names(scene):
        return f"volumes ({names_of(volumes)})"
    if linked := _light_linking_names(scene):
        return f"light linking ({names_of(linked)})"
    if unmappable := _unmappable_names(scene):
        what = f"toon, sheen or rough diffuse shaders, over {_MAX_UV_MAPS} UV maps"
        return f"{what}, or materials that differ by instance ({names_of(unmappable)})"
    kinds = map(materials.kind, _shown_materials(scene))
    if not any(diffuse or translucent for diffuse, translucent, _ in kinds):
        return "no diffuse surface"
    count = surfaces.triangle_count()
    if count > MAX_BAKED:
        return f"{count} triangles, more than the texels of a light map"
    return None


def _all_objects(scene: Scene) -> set[Object]:
    """The objects of the scene and of all collections, which may be instanced."""
    return set(scene.objects).union(*(c.all_objects for c in bpy.data.collections))


def _shown_materials(scene: Scene) -> set[Material | None]:
    """The materials of all surfaces, including instanced collections; None for a surface without a
    material.
    """
    shown: set[Material | None] = set()
    for thing in _all_objects(scene):
        if thing.type in surfaces.SURFACE_TYPES:
            shown.update([slot.material for slot in thing.material_slots] or [None])
    return shown


def strand_names(scene: Scene) -> list[str]:
    """Objects that render as hair, curves or points, which have no faces for a light map, including
    instances and results of Geometry Nodes.
    """
    with surfaces.as_rendered(scene) as depsgraph:
        return sorted({i.object.name for i in depsgraph.object_instances if _shows_strands(i)})


def _shows_strands(instance: DepsgraphObjectInstance) -> bool:
    thing = instance.object
    if thing.original.hide_render and not instance.is_instance:
        return False
    if instance.show_particles and _has_particles(thing):
        return True
    if not instance.show_self or thing.type not in ("CURVES", "POINTCLOUD"):
        return False
    return instance.is_instance or not _is_instances(thing)


def _made_volume_names(scene: Scene) -> list[str]:
    """Objects whose Geometry Nodes make a volume."""
    with surfaces.as_rendered(scene) as depsgraph:
        made = (i.object for i in depsgraph.object_instances if i.is_instance and i.show_self)
        return sorted({thing.name for thing in made if thing.type == "VOLUME"})


def _has_particles(thing: Object) -> bool:
    return any(m.type == "PARTICLE_SYSTEM" and m.show_render for m in thing.modifiers)


def _is_instances(evaluated: Object) -> bool:
    """Whether an evaluated object consists only of instances, as far as known: from 4.5 on."""
    if not hasattr(evaluated, "evaluated_geometry"):
        return False
    geometry = evaluated.evaluated_geometry()
    return not any((geometry.mesh, geometry.curves, geometry.pointcloud, geometry.volume))


def volume_names(scene: Scene) -> list[str]:
    """Objects with a volume, or with a material or world that has one."""
    trees = {output.id_data for output in compat.volume_outputs()}
    names = []
    for thing in _all_objects(scene):
        shown = [slot.material for slot in thing.material_slots if slot.material]
        if thing.type == "VOLUME" or any(material.node_tree in trees for material in shown):
            names.append(thing.name)
    if scene.world and scene.world.node_tree in trees:
        return [*sorted(names), "the sky"]
    return sorted(names)


def _light_linking_names(scene: Scene) -> list[str]:
    """Lamps and emitting objects that light, or are shadowed by, only some objects."""
    names = []
    for thing in _all_objects(scene):
        link = getattr(thing, "light_linking", None)
        if link and (link.receiver_collection or link.blocker_collection):
            names.append(thing.name)
    return names


def _unmappable_names(scene: Scene) -> set[str]:
    """Objects that cannot have a light map: because of unsupported shaders, too many UV maps, or
    materials that differ between instances.
    """
    found: set[str] = set()
    checked: set[tuple[str, str, bool]] = set()
    with surfaces.as_rendered(scene) as depsgraph:
        for instance in depsgraph.object_instances:
            thing = instance.object
            if instance.show_self and thing.type in surfaces.SURFACE_TYPES:
                key = (thing.name, thing.data.name, instance.is_instance)
                if key not in checked and _is_unmappable(thing, instance.is_instance):
                    found.add(thing.name)
                checked.add(key)
    return found


def _is_unmappable(evaluated: Object, is_instance: bool) -> bool:
    if len(getattr(evaluated.data, "uv_layers", ())) > _MAX_UV_MAPS:
        return True
    slots = [slot.material for slot in evaluated.material_slots]
    for material in {*slots, *getattr(evaluated.data, "materials", ())}:
        tree = materials.tree_of(material)
        for node in compat.nodes_of(tree) if tree else ():
            if node.type in _NO_LIGHT_MAP or materials.is_rough(node):
                return True
            if is_instance and _tells_instances(node):
                return True
    return False


def _tells_instances(node: Node) -> bool:
    """Whether a node has different values for instances of one object."""
    if node.type == "OBJECT_INFO":
        return bool(node.outputs["Random"].is_linked)
    by_attribute = getattr(node, "attribute_type", "") == "INSTANCER"
    return getattr(node, "from_instancer", False) or by_attribute
