# SPDX-License-Identifier: GPL-3.0-or-later
"""The look of smoke: what a material's volume shader says about extinction, scattering and emission."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from .. import compat
from .functions import blackbody
from .maps import read_map
from .nodes import Attributes, NodeReader, Warn, upstream

# Luminance of Principled Volume's blackbody, 1 / K^4.
_RADIANCE_PER_KELVIN4 = 5.670373e-14 / np.pi

# What smoke without a volume material looks like: a Blender particle of default size then has an optical depth of
# about 0.6 through its centre.
DEFAULT_EXTINCTION = 10.0
DEFAULT_ALBEDO = 0.8


@dataclass
class Volume:
    """A participating medium; the first axis of the arrays is 1 (the same for all) or the number of points."""

    extinction: np.ndarray  # (1|n,) 1/m, the mean of red, green and blue
    tint: np.ndarray  # (1|n, 3) extinction of red, green and blue over their mean
    albedo: np.ndarray  # (1|n, 3) 0..1
    emission: np.ndarray  # (1|n, 3) W / (m^3 sr)
    anisotropy: float  # Henyey-Greenstein g, -1..1
    radius_factor: np.ndarray  # (1|n,) on the points' radius
    map: np.ndarray | None = None  # (height, width, 4) colour and opacity on each point, 0..1


@dataclass
class _Medium:
    """Coefficients of one volume closure, (1|n, 3) in 1/m, and g weighted by the scattering."""

    scattering: np.ndarray
    absorption: np.ndarray
    emission: np.ndarray
    forward: np.ndarray  # (1|n,) scattering times g
    phases: frozenset[float]

    def __add__(self, other: _Medium) -> _Medium:
        return _Medium(
            self.scattering + other.scattering,
            self.absorption + other.absorption,
            self.emission + other.emission,
            self.forward + other.forward,
            self.phases | other.phases,
        )

    def __mul__(self, weight: np.ndarray) -> _Medium:
        column = weight[:, None]
        return _Medium(
            self.scattering * column,
            self.absorption * column,
            self.emission * column,
            self.forward * weight,
            self.phases if np.any(weight > 0) else frozenset(),
        )


# Single precision throughout, as in Blender and in the library: doubles would cost copies of every attribute.
_NOTHING = np.zeros((1, 3), dtype=np.float32)
_GREY = np.ones((1, 3), dtype=np.float32)
_ZERO = np.zeros(1, dtype=np.float32)
_ONE = np.ones(1, dtype=np.float32)
_EMPTY = _Medium(_NOTHING, _NOTHING, _NOTHING, _ZERO, frozenset())


def _mean(colors: np.ndarray) -> np.ndarray:
    """The mean (n,) of the three channels; by columns, since numpy is slow at sums over short rows."""
    return (colors[:, 0] + colors[:, 1] + colors[:, 2]) / 3


def _spread(colors: np.ndarray) -> np.ndarray:
    """The largest less the smallest (n,) of the three channels."""
    red, green, blue = colors.T
    return np.maximum(np.maximum(red, green), blue) - np.minimum(np.minimum(red, green), blue)


def volume_socket(material: bpy.types.Material | None) -> bpy.types.NodeSocket | None:
    """The linked Volume input of the material's output, or None."""
    return _output_socket(material, "Volume")


def surface_socket(material: bpy.types.Material | None) -> bpy.types.NodeSocket | None:
    """The linked Surface input of the material's output, or None."""
    return _output_socket(material, "Surface")


def is_volume_only(material: bpy.types.Material | None) -> bool:
    """Whether the material makes a volume and no surface, so that its mesh is no solid."""
    return volume_socket(material) is not None and surface_socket(material) is None


def lets_light_through(material: bpy.types.Material | None) -> bool:
    """Whether the surface shader has a node that lets light pass."""
    socket = surface_socket(material)
    see_through = {"ShaderNodeBsdfTransparent", "ShaderNodeBsdfGlass", "ShaderNodeBsdfRefraction"}
    return socket is not None and any(node.bl_idname in see_through for node in upstream(socket))


def emits_light(material: bpy.types.Material | None) -> bool:
    """Whether the surface shader has an emission node."""
    socket = surface_socket(material)
    return socket is not None and any(node.bl_idname == "ShaderNodeEmission" for node in upstream(socket))


def default_volume() -> Volume:
    """Grey smoke for particles without a volume material."""
    extinction = np.full(1, DEFAULT_EXTINCTION, dtype=np.float32)
    return Volume(extinction, _GREY, np.full((1, 3), DEFAULT_ALBEDO, dtype=np.float32), _NOTHING, 0.0, _ONE)


def read_volume(
    material: bpy.types.Material | None,
    smoke: str,
    warn: Warn,
    attributes: Attributes = lambda name: None,
    particles: Attributes = lambda name: None,
) -> Volume:
    """The medium that `material` describes for the smoke of that name.

    Follows Cycles: Principled Volume scatters colour x density, Volume Scatter colour x density, Volume Absorption
    absorbs (1 - colour) x density. Without a volume shader it is grey smoke, with a warning. An AOV Output node named
    Radius gives a factor on the radius, one named Map an image on every point. `attributes` and `particles` as NodeReader has them.
    """
    socket = volume_socket(material)
    if socket is None:
        which = f"material '{material.name}' has no volume shader" if material else "there is no material"
        warn(f"{smoke}: {which}; it is drawn as grey smoke with a density of {DEFAULT_EXTINCTION:g} per metre")
        return default_volume()
    owner = f"Material '{material.name}'"
    reader = NodeReader(owner, warn, attributes, particles)
    volume = _volume(_closure(reader, socket, ()), owner, warn)
    by_radius, by_map = _output_named(material, "Radius"), _output_named(material, "Map")
    if by_radius is not None:
        volume.radius_factor = np.maximum(reader.number(by_radius, "Value"), 0)
    if by_map is not None:
        volume.map = read_map(by_map, owner, warn)
    return volume


def _output_named(material: bpy.types.Material, name: str) -> bpy.types.Node | None:
    """The material's AOV Output node of that name."""
    nodes = (node for node in compat.node_tree(material).nodes if node.bl_idname == "ShaderNodeOutputAOV")
    return next((node for node in nodes if compat.aov_name(node) == name), None)


def _volume(medium: _Medium, owner: str, warn: Warn) -> Volume:
    scattering, absorption = np.maximum(medium.scattering, 0), np.maximum(medium.absorption, 0)
    total = scattering + absorption
    extinction = _mean(total)
    # What rounding makes of grey stays grey: each channel that differs costs a render.
    is_tinted = (_spread(total) > 1e-4 * extinction)[:, None]
    tint = np.divide(total, extinction[:, None], out=np.ones_like(total), where=is_tinted) if is_tinted.any() else _GREY
    albedo = np.divide(scattering, total, out=np.zeros_like(total), where=total > 0)
    scattered = _mean(scattering).sum(dtype=np.float64)
    anisotropy = float(medium.forward.sum(dtype=np.float64) / scattered) if scattered > 0 else 0.0
    if len(medium.phases) > 1:
        shown = ", ".join(f"{g:.4g}" for g in sorted(medium.phases))
        warn(f"{owner}: anisotropies {shown} are mixed; their average {anisotropy:.4g} is used")
    g = float(np.clip(anisotropy, -0.999, 0.999))
    return Volume(extinction, tint, albedo, np.maximum(medium.emission, 0), g, _ONE)


def _closure(reader: NodeReader, socket: bpy.types.NodeSocket, groups: tuple) -> _Medium:
    node, groups = reader.shader(socket, groups)
    if node is None:
        return _EMPTY
    if node.bl_idname == "ShaderNodeAddShader":
        return _closure(reader, node.inputs[0], groups) + _closure(reader, node.inputs[1], groups)
    if node.bl_idname == "ShaderNodeMixShader":
        factor = np.clip(reader.number(node, "Fac", groups), 0, 1)
        first, second = _closure(reader, node.inputs[1], groups), _closure(reader, node.inputs[2], groups)
        return first * (1 - factor) + second * factor
    leaf = _LEAVES.get(node.bl_idname)
    if leaf is None:
        which = f"{reader.owner}: node '{node.name}' ({node.bl_label})"
        reader.warn(f"{which} isn't supported in smoke; it counts as nothing")
        return _EMPTY
    return leaf(reader, node, groups)


def _scattering(reader: NodeReader, node: bpy.types.Node, groups: tuple, scattering: np.ndarray) -> _Medium:
    """A medium that scatters, with the node's phase function."""
    phase = getattr(node, "phase", "HENYEY_GREENSTEIN")
    if phase == "HENYEY_GREENSTEIN":
        g = reader.number(node, "Anisotropy", groups)
    else:
        which = f"{reader.owner}: phase function {phase} of node '{node.name}'"
        reader.warn(f"{which} isn't supported; smoke scatters evenly")
        g = _ZERO
    forward = _mean(scattering) * g
    return _Medium(scattering, _NOTHING, _NOTHING, forward, frozenset(np.unique(g).tolist()[:3]))


def _principled(reader: NodeReader, node: bpy.types.Node, groups: tuple) -> _Medium:
    density = np.maximum(reader.number(node, "Density", groups), 0)
    by_density = reader.attributes(reader.text(node, "Density Attribute"))
    if by_density is not None:
        density = density * np.maximum(by_density if by_density.ndim == 1 else _mean(by_density), 0)
    colour = np.clip(reader.color(node, "Color", groups), 0, 1)
    by_colour = reader.attributes(reader.text(node, "Color Attribute"))
    if by_colour is not None:
        colour = colour * np.clip(by_colour if by_colour.ndim == 2 else by_colour[:, None], 0, 1)
    absorbing = np.sqrt(np.clip(reader.color(node, "Absorption Color", groups), 0, 1))
    medium = _scattering(reader, node, groups, colour * density[:, None])
    medium.absorption = (1 - colour) * (1 - absorbing) * density[:, None]
    strength = reader.number(node, "Emission Strength", groups)
    medium.emission = reader.color(node, "Emission Color", groups) * strength[:, None]
    if np.any(reader.number(node, "Blackbody Intensity", groups) > 0):
        medium.emission = medium.emission + _blackbody(reader, node, groups)
    return medium


def _blackbody(reader: NodeReader, node: bpy.types.Node, groups: tuple) -> np.ndarray:
    """Emission (1|n, 3) of Principled Volume's blackbody: by its intensity, from next to nothing to the law of Stefan and
    Boltzmann."""
    share = np.clip(reader.number(node, "Blackbody Intensity", groups), 0, 1)
    kelvin = np.maximum(reader.number(node, "Temperature", groups), 0)
    by_temperature = reader.attributes(reader.text(node, "Temperature Attribute"))
    if by_temperature is not None:
        kelvin = kelvin * np.maximum(by_temperature if by_temperature.ndim == 1 else _mean(by_temperature), 0)
    strength = _RADIANCE_PER_KELVIN4 * (1 + share * (kelvin**4 - 1))
    tint = reader.color(node, "Blackbody Tint", groups)
    return (share > 0)[:, None] * tint * blackbody(kelvin) * strength[:, None]


def _scatter(reader: NodeReader, node: bpy.types.Node, groups: tuple) -> _Medium:
    density = np.maximum(reader.number(node, "Density", groups), 0)
    return _scattering(reader, node, groups, np.maximum(reader.color(node, "Color", groups), 0) * density[:, None])


def _absorption(reader: NodeReader, node: bpy.types.Node, groups: tuple) -> _Medium:
    density = np.maximum(reader.number(node, "Density", groups), 0)
    absorption = np.clip(1 - reader.color(node, "Color", groups), 0, 1) * density[:, None]
    return _Medium(_NOTHING, absorption, _NOTHING, _ZERO, frozenset())


def _coefficients(reader: NodeReader, node: bpy.types.Node, groups: tuple) -> _Medium:
    medium = _scattering(reader, node, groups, np.maximum(reader.color(node, "Scatter Coefficients", groups), 0))
    medium.absorption = np.maximum(reader.color(node, "Absorption Coefficients", groups), 0)
    medium.emission = reader.color(node, "Emission Coefficients", groups)
    return medium


def _emission(reader: NodeReader, node: bpy.types.Node, groups: tuple) -> _Medium:
    emission = reader.color(node, "Color", groups) * reader.number(node, "Strength", groups)[:, None]
    return _Medium(_NOTHING, _NOTHING, emission, _ZERO, frozenset())


_LEAVES = {
    "ShaderNodeVolumePrincipled": _principled,
    "ShaderNodeVolumeScatter": _scatter,
    "ShaderNodeVolumeAbsorption": _absorption,
    "ShaderNodeVolumeCoefficients": _coefficients,
    "ShaderNodeEmission": _emission,
}


def _output_socket(material: bpy.types.Material | None, identifier: str) -> bpy.types.NodeSocket | None:
    tree = compat.node_tree(material) if material is not None else None
    if tree is None:
        return None
    # EEVEE materials may have an output of their own; the one for all engines or for Cycles describes the physics.
    output = tree.get_output_node("CYCLES")
    socket = next((socket for socket in output.inputs if socket.identifier == identifier), None) if output else None
    return socket if socket is not None and socket.is_linked else None
