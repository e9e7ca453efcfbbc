# SPDX-License-Identifier: GPL-3.0-or-later
"""Particle systems as smoke."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import bpy
import numpy as np

from .caches import check_point_cache
from .materials import Volume, read_volume
from .nodes import Warn

_ALIVE = 3


@dataclass
class Particles:
    """Particles of one material, in world space; the arrays follow core.Scene.add_particles."""

    name: str
    positions: np.ndarray  # (n, 3) float32
    radii: np.ndarray  # (n,) float32, m; two standard deviations
    velocities: np.ndarray | None  # (n, 3) float32, m a frame
    ids: np.ndarray  # (n,) uint64, the same particle's in every frame
    volume: Volume
    matte_name: str  # in Cryptomatte
    casts_shadow: bool = True
    visible_to_camera: bool = True
    light_set: int = 0
    shadow_set: int = 0


def is_smoke(system: bpy.types.ParticleSystem) -> bool:
    """Whether the system is drawn as smoke: emitters rendered as Halo, unless its own switch says otherwise."""
    settings = system.settings
    if settings.type == "HAIR" or settings.fumarole.smoke == "NOT_SMOKE":
        return False
    automatic = settings.type == "EMITTER" and settings.render_type == "HALO"
    return automatic or settings.fumarole.smoke == "SMOKE"


def smoke_systems(owner: bpy.types.Object) -> list[bpy.types.ParticleSystem]:
    """The systems of an evaluated object that are smoke and enabled in renders."""
    modifiers = (modifier for modifier in owner.modifiers if modifier.type == "PARTICLE_SYSTEM")
    systems = (modifier.particle_system for modifier in modifiers if modifier.show_render)
    return [system for system in systems if is_smoke(system)]


def export_system(
    owner: bpy.types.Object,
    system: bpy.types.ParticleSystem,
    scene: bpy.types.Scene,
    instance_matrix: np.ndarray | None,
    instance_key: str,
    warn: Warn,
) -> Particles | None:
    """The living particles of an evaluated system, or None if none lives.

    `instance_matrix` (4, 4) moves the system's particles to where an instance of `owner` is; None for the object
    itself. `instance_key` tells instances apart.
    """
    name = f"Particle system '{system.name}' of '{owner.name_full}'"
    settings = system.settings
    count = len(system.particles)
    alive = np.flatnonzero(_read(system, "alive_state", count, 1, np.int16) == _ALIVE)
    _warn_of_wrong_positions(owner, system, scene, name, warn)
    if len(alive) == 0:
        return None
    # Blender moves a particle by velocity x timestep a frame, whatever the frame rate.
    positions = _read(system, "location", count, 3, np.float32)[alive]
    velocities = _read(system, "velocity", count, 3, np.float32)[alive] * np.float32(settings.timestep)
    radii = _read(system, "size", count, 1, np.float32)[alive] * np.float32(settings.fumarole.radius_scale)
    if instance_matrix is not None:
        positions = transform_points(instance_matrix, positions)
        velocities = transform_vectors(instance_matrix, velocities)
        radii = radii * np.float32(length_scale(instance_matrix))
    ids = stable_ids(f"{owner.name_full}\0{system.name}\0{instance_key}", alive)
    info = _ParticleInfo(system, scene, alive, positions, ids)
    volume = read_volume(_material(owner, settings.material), name, warn, particles=info.read)
    is_only = len(smoke_systems(owner)) == 1
    matte_name = owner.name if is_only else f"{owner.name}.{system.name}"
    return Particles(name, positions, radii * volume.radius_factor, velocities, ids, volume, matte_name)


@dataclass
class _ParticleInfo:
    """What the node Particle Info says of the living particles."""

    system: bpy.types.ParticleSystem
    scene: bpy.types.Scene
    alive: np.ndarray  # (n,) their indices
    positions: np.ndarray
    ids: np.ndarray

    def read(self, output: str) -> np.ndarray | None:
        """The values of an output by its identifier, (n,) or (n, 3) float32; None where they aren't known."""
        if output == "Index":
            return self.alive.astype(np.float32)
        if output == "Random":
            return _random(self.ids)
        if output == "Age":
            frame = np.float32(self.scene.frame_current_final)
            return frame - self._of_all("birth_time", 1)
        if output == "Lifetime":
            return self._of_all("lifetime", 1)
        if output == "Location":
            return self.positions
        if output == "Size":
            return self._of_all("size", 1)
        if output == "Velocity":
            return self._of_all("velocity", 3)
        if output == "Angular Velocity":
            return self._of_all("angular_velocity", 3)
        return None

    def _of_all(self, attribute: str, width: int) -> np.ndarray:
        return _read(self.system, attribute, len(self.system.particles), width, np.float32)[self.alive]


def _random(ids: np.ndarray) -> np.ndarray:
    """A number in 0..1 for each id (SplitMix64's finaliser)."""
    with np.errstate(over="ignore"):
        bits = (ids ^ (ids >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return ((bits ^ (bits >> np.uint64(31))) >> np.uint64(40)).astype(np.float32) * np.float32(2.0**-24)


def stable_ids(key: str, indices: np.ndarray) -> np.ndarray:
    """Ids (n,) uint64 that tell the points of this `key` from those of others, as long as indices stay the same."""
    ids = indices.astype(np.uint32).astype(np.uint64)
    ids |= np.uint64(zlib.crc32(key.encode())) << np.uint64(32)
    return ids


def transform_points(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (n, 3) moved by a (4, 4) matrix, float32."""
    moved = points @ matrix[:3, :3].T
    moved += matrix[:3, 3]
    return moved.astype(np.float32)


def transform_vectors(matrix: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Directions (n, 3) turned by a (4, 4) matrix, float32."""
    return (vectors @ matrix[:3, :3].T).astype(np.float32)


def length_scale(matrix: np.ndarray) -> float:
    """The factor by which a (4, 4) matrix scales lengths on average."""
    return float(np.cbrt(abs(np.linalg.det(matrix[:3, :3]))))


def _read(system: bpy.types.ParticleSystem, attribute: str, count: int, width: int, kind: type) -> np.ndarray:
    values = np.empty(count * width, dtype=kind)
    system.particles.foreach_get(attribute, values)
    return values.reshape(-1, width) if width > 1 else values


def _material(owner: bpy.types.Object, slot: int) -> bpy.types.Material | None:
    slots = owner.material_slots
    return slots[min(slot, len(slots)) - 1].material if len(slots) else None


def _warn_of_wrong_positions(
    owner: bpy.types.Object, system: bpy.types.ParticleSystem, scene: bpy.types.Scene, name: str, warn: Warn
) -> None:
    """Blender simulates an unbaked system frame by frame, as many particles as it displays."""
    cache, shown = system.point_cache, system.settings.display_percentage
    if system.settings.physics_type == "NO":
        return
    if shown != 100 and not cache.is_baked and not cache.use_external:
        warn(
            f"{name} isn't baked and its viewport display amount is {shown} %: its particles are wrong. Bake it or "
            "set the amount to 100 %"
        )
        return
    check_point_cache(cache, owner, name, "positions", scene, warn)
