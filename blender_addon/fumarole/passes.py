# SPDX-License-Identifier: GPL-3.0-or-later
"""Which of the library's passes a view layer asks for, and what Blender calls them."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass

import bpy
import numpy as np

from . import core
from .export.lights import Light
from .export.scene import Scene
from .export.world import World

# The view layer's switch of each pass that is optional. Names, channels and kinds are in the library's pass table.
SWITCHES = {
    "Depth": "use_pass_z",
    "Position": "use_pass_position",
    "Emit": "use_pass_emit",
    "Shadow": "use_pass_shadow",
    "Vector": "use_pass_vector",
}

# Those that Blender has no switches for: the switch in its group of settings.
OWN_SWITCHES = {
    "Opacity": "use_pass_opacity",
    "Depth Front": "use_pass_depth_range",
    "Depth Back": "use_pass_depth_range",
    "Albedo": "use_pass_albedo",
    "Solid Shadow": "use_pass_solid_shadow",
    "Error": "use_pass_error",
}

# Passes of single lights: the switch, and what the pass is called with the light's name behind it.
LIGHT_SWITCHES = {
    "Light": ("use_pass_lights", "Light"),
    "Light Shadow": ("use_pass_light_shadows", "Shadow"),
    "Light Solid Shadow": ("use_pass_light_solid_shadows", "Solid Shadow"),
}

# Longest name of a pass in Blender, in bytes.
_LONGEST_NAME = 63


@dataclass(frozen=True)
class LayerPass:
    """A pass of a view layer. is_part: of the library's passes of single lights, which are of it; None: of none.
    number: which one of a pass of which there are several; None: there is one."""

    name: str
    item: core.Pass
    is_part: Callable[[Light | World], bool] | None = None
    number: int | None = None

    def wanted(self, lights: list[Light | World]) -> list[core.Wanted]:
        """What to ask the library for."""
        if self.number is not None:
            return [(self.item.name, self.number)]
        if self.is_part is None:
            return [self.item.name]
        return [(self.item.name, index) for index, light in enumerate(lights) if self.is_part(light)]

    def pixels(self, result: core.Result, lights: list[Light | World]) -> np.ndarray:
        """The pass: of several lights their sum, and of their shadows the first."""
        parts = [result[name] for name in self.wanted(lights)]
        if not parts:
            return np.full((*result["Combined"].shape[:2], 3), float(self.is_shadow), np.float32)
        return parts[0] if self.is_shadow else sum(parts[1:], parts[0])

    @property
    def is_shadow(self) -> bool:
        return self.item.name in ("Light Shadow", "Light Solid Shadow")


def enabled(view_layer: bpy.types.ViewLayer, world: bpy.types.World | None = None) -> list[LayerPass]:
    """The passes to render: Combined, which every view layer has, and those that are switched on, also of the scene's
    world. Light groups have theirs by Cycles' names."""
    switched_on = [name for name, switch in SWITCHES.items() if getattr(view_layer, switch)]
    switched_on += [name for name, switch in OWN_SWITCHES.items() if getattr(view_layer.fumarole, switch)]
    found = [LayerPass(name, core.PASSES[name]) for name in ("Combined", *switched_on)]
    names = [owner.name for owner in view_layer.objects if owner.type == "LIGHT" and not owner.hide_render]
    if world is not None and view_layer.use_sky and World.owner not in names:
        names.append(World.owner)
    for core_name, (switch, called) in LIGHT_SWITCHES.items():
        if getattr(view_layer.fumarole, switch):
            found += [_of_light(core_name, f"{called} {name}", name) for name in names]
    return found + [_of_group(group.name) for group in view_layer.lightgroups] + _cryptomatte(view_layer)


def warnings(wanted: list[LayerPass], lights: list[Light | World]) -> list[str]:
    """What the passes don't show."""
    return [
        f"Pass '{item.name}': the light is there {len(item.wanted(lights))} times; the pass is of the first one"
        for item in wanted
        if item.is_shadow and len(item.wanted(lights)) > 1
    ]


def crypto_fields(view_layer: bpy.types.ViewLayer, scene: Scene) -> dict[str, str]:
    """What the metadata of a picture says of its Cryptomatte (Cryptomatte Specification 1.2.0); empty without one."""
    if not _cryptomatte(view_layer):
        return {}
    layer = f"{view_layer.name}.CryptoObject"
    key = f"cryptomatte/{core.crypto_hash(layer):08x}"[:-1]
    manifest = {item.matte_name: f"{core.crypto_hash(item.matte_name):08x}" for item in scene.particles}
    values = {"name": layer, "hash": "MurmurHash3_32", "conversion": "uint32_to_float32"}
    values["manifest"] = json.dumps(manifest, ensure_ascii=False, separators=(",", ":"))
    return {f"{key}/{name}": value for name, value in values.items()}


def _cryptomatte(view_layer: bpy.types.ViewLayer) -> list[LayerPass]:
    if not view_layer.use_pass_cryptomatte_object:
        return []
    item = core.PASSES["CryptoObject"]
    pairs = (view_layer.pass_cryptomatte_depth + 1) // 2
    return [LayerPass(f"{item.name}{pair:02}", item, number=pair) for pair in range(pairs)]


def _of_light(core_name: str, name: str, light_name: str) -> LayerPass:
    return LayerPass(_shortened(name), core.PASSES[core_name], lambda light: light.owner == light_name)


def _of_group(name: str) -> LayerPass:
    return LayerPass(_shortened(f"Combined_{name}"), core.PASSES["Light"], lambda light: light.group == name)


def _shortened(name: str) -> str:
    return name.encode()[:_LONGEST_NAME].decode(errors="ignore")
