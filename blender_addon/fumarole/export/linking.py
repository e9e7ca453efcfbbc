# SPDX-License-Identifier: GPL-3.0-or-later
"""Light linking: which lights shine on what and are blocked by what, as the sets of core.Scene."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import bpy

from .. import compat, core
from .lights import Light
from .meshes import Mesh
from .particles import Particles
from .world import World


@dataclass
class _Reach:
    """What one light shines on, or is blocked by."""

    light: Light | World
    states: dict[int, bool]  # by object: included or excluded
    on_smoke: bool
    on_solids: bool

    def holds(self, speaker: int, is_smoke: bool) -> bool:
        """As Cycles has it: where anything is included, nothing else is."""
        if not (self.on_smoke if is_smoke else self.on_solids):
            return False
        return self.states.get(speaker, not any(self.states.values()))


class Linker:
    """Notes lights, smoke and solids with their objects, and numbers the sets that the lights tell apart."""

    def __init__(self) -> None:
        self._receivers: list[_Reach] = []
        self._blockers: list[_Reach] = []
        # What is lit or blocks, its object and the one that instances it.
        self._matter: list[tuple[Particles | Mesh, int, int]] = []

    def add_light(self, light: Light, owner: bpy.types.Object) -> None:
        """`owner`: the lamp, of an instance that which is instanced."""
        receivers, blockers = compat.linked_collections(owner)
        reach = (owner.visible_volume_scatter, owner.visible_diffuse)
        self._receivers.append(_Reach(light, _states(receivers), *reach))
        if light.casts_shadows:
            self._blockers.append(_Reach(light, _states(blockers), True, True))

    def add_world(self, world: World) -> None:
        """A world is linked to nothing, but rays that scatter may not see it."""
        self._receivers.append(_Reach(world, {}, world.on_smoke, world.on_solids))

    def add_matter(self, items: Iterable[Particles | Mesh], owner: bpy.types.Object, parent: bpy.types.Object) -> None:
        """`owner`: the object that they are of, of an instance that which is instanced; `parent`: what instances it, or
        the same."""
        self._matter += [(item, _key(owner), _key(parent)) for item in items]

    def finish(self) -> None:
        """Numbers the sets. Raises core.FumaroleError where there are too many."""
        for reach, sets in _number(self._receivers, self._matter, "light_set", "light linking"):
            reach.light.light_sets = sets
        casting = [entry for entry in self._matter if entry[0].casts_shadow]
        for reach, sets in _number(self._blockers, casting, "shadow_set", "shadow linking"):
            reach.light.shadow_sets = sets
        for item, _own, _parent in self._matter:
            if isinstance(item, Particles) and not item.casts_shadow:
                item.shadow_set = -1


def _number(
    reaches: list[_Reach], matter: list[tuple[Particles | Mesh, int, int]], field: str, what: str
) -> list[tuple[_Reach, tuple[int, ...] | None]]:
    """Sets `field` of all matter. Gives the sets of each light; None where it is all."""
    linked = set().union(*(reach.states for reach in reaches))
    numbers: dict[tuple[bool, ...], int] = {}
    known: dict[tuple[int, bool], tuple[bool, ...]] = {}
    for item, own, parent in matter:
        # What is instanced is linked by what instances it, if that is linked to any light.
        speaker, is_smoke = parent if parent in linked else own, isinstance(item, Particles)
        key = (speaker, is_smoke)
        if key not in known:
            known[key] = tuple(reach.holds(speaker, is_smoke) for reach in reaches)
        number = numbers.setdefault(known[key], len(numbers))
        if number >= core.LINK_SETS:
            raise core.FumaroleError(
                core.ErrorCode.ARGUMENT, f"{item.name}: {what} makes more than {core.LINK_SETS} different sets of objects"
            )
        setattr(item, field, number)
    result = []
    for place, reach in enumerate(reaches):
        sets = tuple(number for held, number in numbers.items() if held[place])
        result.append((reach, None if len(sets) == len(numbers) else sets))
    return result


def _states(collection: bpy.types.Collection | None) -> dict[int, bool]:
    """Objects of a linking collection: included or not. Of nested collections the outermost decides."""
    states: dict[int, bool] = {}
    if collection is None:
        return states
    for child, entry in zip(collection.children, collection.collection_children):
        is_included = entry.light_linking.link_state == "INCLUDE"
        states.update({_key(member): is_included for member in child.all_objects})
    for member, entry in zip(collection.objects, collection.collection_objects):
        states[_key(member)] = entry.light_linking.link_state == "INCLUDE"
    return states


def _key(owner: bpy.types.Object) -> int:
    return owner.original.as_pointer()
