# SPDX-License-Identifier: GPL-3.0-or-later
"""What a render needs of a depsgraph, as plain arrays, and the core scene made of it."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field

import bpy
import numpy as np

from .. import compat, core
from .caches import check_modifiers
from .lights import Light, export_light
from .linking import Linker
from .meshes import Mesh, MeshReader
from .particles import Particles, export_system, smoke_systems
from .points import export_points
from .world import World, export_world


@dataclass
class Scene:
    """Everything that is lit and drawn, independent of the depsgraph it came from."""

    particles: list[Particles] = field(default_factory=list)
    meshes: list[Mesh] = field(default_factory=list)
    lights: list[Light | World] = field(default_factory=list)
    solids_are_shaded: bool = False
    world: World | None = None  # that is seen behind the smoke; None: black
    warnings: list[str] = field(default_factory=list)

    @property
    def has_holdouts(self) -> bool:
        """Whether the camera may see a solid that is transparent."""
        return any(item.visible_to_camera and (item.is_holdout or not self.solids_are_shaded) for item in self.meshes)

    def warn(self, text: str) -> None:
        """Notes a warning, once."""
        if text not in self.warnings:
            self.warnings.append(text)


def export_scene(depsgraph: bpy.types.Depsgraph) -> Scene:
    """All smoke, solids and lights of an evaluated depsgraph's view layer."""
    scene = Scene()
    scene.solids_are_shaded = depsgraph.scene.fumarole.solids == "SHADED"
    reader, linker = MeshReader(scene.warn, scene.solids_are_shaded), Linker()
    for instance in depsgraph.object_instances:
        _export_instance(instance, depsgraph, scene, reader, linker)
    if depsgraph.view_layer_eval.use_sky:
        scene.world = export_world(depsgraph.scene.world, scene.warn)
    if scene.world is not None and (scene.world.on_smoke or scene.world.on_solids):
        scene.lights.append(scene.world)
        linker.add_world(scene.world)
    linker.finish()
    for override in ("material_override", "world_override"):
        if getattr(depsgraph.view_layer_eval, override, None) is not None:
            scene.warn(f"View layer '{depsgraph.view_layer_eval.name}': its {override} isn't supported yet")
    if not scene.particles:
        scene.warn("There is no smoke in this view layer: no living Halo particles and no point clouds")
    elif not _is_lit(scene) and not any(np.any(item.volume.emission > 0) for item in scene.particles):
        scene.warn("There are no lights, so the smoke is black")
    return scene


def _is_lit(scene: Scene) -> bool:
    """Whether a light shines on any of the smoke."""
    sets = {item.light_set for item in scene.particles}
    return any(light.light_sets is None or not sets.isdisjoint(light.light_sets) for light in scene.lights)


def build(scene: Scene, context: core.Context) -> core.Scene:
    """The core scene. Raises core.FumaroleError."""
    result = build_matter(scene, context)
    add_lights(result, scene)
    return result


def build_matter(scene: Scene, context: core.Context) -> core.Scene:
    """The core scene without lights: what octrees and hierarchies are made of. Raises core.FumaroleError."""
    result = core.Scene(context)
    for item in scene.particles:
        volume = item.volume
        result.add_particles(
            item.positions,
            radius=item.radii,
            density=_one_or_many(volume.extinction),
            albedo=_one_or_many(volume.albedo),
            emission=_one_or_many(volume.emission),
            velocity=item.velocities,
            ident=item.ids,
            anisotropy=volume.anisotropy,
            extinction_color=_one_or_many(volume.tint),
            name=item.name,
            matte_name=item.matte_name,
            light_set=item.light_set,
            shadow_set=item.shadow_set,
            visible_to_camera=item.visible_to_camera,
            map=volume.map,
        )
    for item in scene.meshes:
        result.add_mesh(
            item.vertices,
            item.triangles,
            item.matrix,
            item.name,
            item.casts_shadow,
            item.visible_to_camera,
            light_set=item.light_set,
            shadow_set=item.shadow_set,
            albedo=item.surface.albedo,
            emission=item.surface.emission,
            holdout=item.is_holdout,
            normals=item.normals,
        )
    return result


def add_lights(result: core.Scene, scene: Scene) -> None:
    """Adds the lights to a core scene that has none. Raises core.FumaroleError."""
    for item in scene.lights:
        if isinstance(item, World):
            item.add_to(result)
            continue
        result.add_light(
            item.type,
            item.matrix,
            item.power,
            item.color,
            item.name,
            normalize=item.normalize,
            casts_shadows=item.casts_shadows,
            cycles=compat.LIGHT_UNITS,
            light_sets=item.light_sets,
            shadow_sets=item.shadow_sets,
            **item.shape,
        )


def fingerprint(scene: Scene) -> bytes:
    """A hash of all that build_matter() hands over: what has the same one makes the same core scene without lights.

    By content: what Blender says of updates has no word of geometry nodes' attributes, nor of what a file held.
    """
    result = hashlib.blake2b(digest_size=32)
    for item in scene.particles:
        volume = item.volume
        _hash(result, "particles", item.name, item.matte_name, volume.anisotropy)
        _hash(result, item.positions, item.radii, item.velocities, item.ids)
        _hash(result, volume.extinction, volume.tint, volume.albedo, volume.emission, volume.map)
        _hash(result, item.light_set, item.shadow_set, item.visible_to_camera)
    for item in scene.meshes:
        _hash(result, "mesh", item.name, item.casts_shadow, item.visible_to_camera, item.light_set, item.shadow_set)
        _hash(result, item.vertices, item.triangles, item.matrix, item.normals, item.surface, item.is_holdout)
    return result.digest()


def _hash(result: hashlib.blake2b, *values: object) -> None:
    """Hashes arrays with their shapes, and what repr() tells exactly, so that no two sequences look alike."""
    for value in values:
        if isinstance(value, np.ndarray):
            result.update(f"{value.dtype.str}{value.shape};".encode())
            result.update(np.ascontiguousarray(value).reshape(-1).view(np.uint8))
        else:
            result.update(f"{value!r};".encode(errors="surrogatepass"))


def _one_or_many(values: np.ndarray) -> np.ndarray:
    return values[0] if len(values) == 1 else values


def _export_instance(
    instance: bpy.types.DepsgraphObjectInstance,
    depsgraph: bpy.types.Depsgraph,
    scene: Scene,
    reader: MeshReader,
    linker: Linker,
) -> None:
    owner = instance.object
    system = instance.particle_system
    # A system that is drawn as smoke by its own switch is not drawn as the objects it would be otherwise.
    if system is not None and system.settings.fumarole.smoke == "SMOKE":
        return
    check_modifiers(owner, depsgraph.scene, scene.warn)
    matrix = np.array(instance.matrix_world, dtype=np.float64)
    # Tells instances apart, and stays the same from frame to frame.
    key = f"{instance.parent.name_full}{tuple(instance.persistent_id)}" if instance.is_instance else ""
    original = instance.instance_object if instance.is_instance else owner
    parent = instance.parent if instance.is_instance else owner
    smoke: list[Particles] = []
    # What geometry nodes make comes as instances of the object itself with other data: its particles are not there.
    if instance.show_particles and not (instance.is_instance and owner.data != original.data):
        # Particles are in world space, where the original object emits them.
        moved = matrix @ np.linalg.pinv(np.array(original.matrix_world)) if instance.is_instance else None
        for found in smoke_systems(owner):
            _add(smoke, export_system(owner, found, depsgraph.scene, moved, key, scene.warn))
    if instance.show_self and owner.type == "POINTCLOUD":
        # Points of geometry nodes come as a passing object: the settings are those of the object that has the nodes.
        settings = original.fumarole
        if settings.smoke != "NOT_SMOKE":
            frame_rate = _frame_rate(depsgraph.scene.render)
            _add(smoke, export_points(owner, matrix, key, settings.radius_scale, frame_rate, scene.warn))
    if smoke:
        _set_visibility(smoke, owner, parent, depsgraph.view_layer_eval, scene)
        linker.add_matter(smoke, original, parent)
        scene.particles += smoke
    if instance.show_self:
        _export_object(owner, original, parent, matrix, depsgraph.view_layer_eval, scene, reader, linker)


def _export_object(
    owner: bpy.types.Object,
    original: bpy.types.Object,
    parent: bpy.types.Object,
    matrix: np.ndarray,
    layer: bpy.types.ViewLayer,
    scene: Scene,
    reader: MeshReader,
    linker: Linker,
) -> None:
    # Curves, text, surfaces and metaballs come as instances whose data is a mesh.
    if isinstance(owner.data, bpy.types.Mesh):
        if _is_gas_domain(owner):
            scene.warn(f"Object '{owner.name_full}': smoke of a fluid domain isn't drawn yet")
            return
        meshes = reader.export(owner, parent, matrix, layer)
        linker.add_matter(meshes, original, parent)
        scene.meshes += meshes
    elif owner.type == "LIGHT":
        light = export_light(owner, matrix, scene.warn)
        if light is not None:
            linker.add_light(light, original)
            scene.lights.append(light)
    elif owner.type == "VOLUME":
        scene.warn(f"Object '{owner.name_full}': volumes aren't drawn yet")
    elif owner.type == "CURVES":
        scene.warn(f"Object '{owner.name_full}': hair casts no shadow on smoke yet")


def _frame_rate(render: bpy.types.RenderSettings) -> float:
    return render.fps / render.fps_base


def _add(items: list, item: object | None) -> None:
    if item is not None:
        items.append(item)


def _is_gas_domain(owner: bpy.types.Object) -> bool:
    domains = (modifier for modifier in owner.modifiers if modifier.type == "FLUID" and modifier.fluid_type == "DOMAIN")
    return any(domain.domain_settings.domain_type == "GAS" for domain in domains)


def _set_visibility(
    smoke: list[Particles],
    owner: bpy.types.Object,
    parent: bpy.types.Object,
    layer: bpy.types.ViewLayer,
    scene: Scene,
) -> None:
    """What is instanced is hidden by its own switches and by those of what instances it."""
    is_holdout = parent.holdout_get(view_layer=layer)
    if is_holdout:
        scene.warn(f"Object '{owner.name_full}': smoke is no holdout, as volumes are none in Cycles; it is drawn")
    for item in smoke:
        item.casts_shadow = owner.visible_shadow and parent.visible_shadow
        item.visible_to_camera = owner.visible_camera and parent.visible_camera
        if parent.indirect_only_get(view_layer=layer) and not is_holdout:
            item.visible_to_camera = False
