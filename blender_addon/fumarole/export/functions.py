# SPDX-License-Identifier: GPL-3.0-or-later
"""What function nodes compute, as Cycles does: over many points at once, and only of what a whole array can answer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import bpy
import numpy as np

Groups = tuple
_STEPS = 256  # of the tables that ramps and curves are read from, as in Cycles


class Reader(Protocol):
    """The inputs of nodes, as nodes.NodeReader reads them: (1|n,) and (1|n, 3) float32."""

    def number(self, node: bpy.types.Node, identifier: str, groups: Groups = ()) -> np.ndarray: ...
    def color(self, node: bpy.types.Node, identifier: str, groups: Groups = ()) -> np.ndarray: ...


Function = Callable[[Reader, bpy.types.Node, bpy.types.NodeSocket, Groups], "np.ndarray | None"]


def evaluate(
    reader: Reader, node: bpy.types.Node, output: bpy.types.NodeSocket, groups: Groups
) -> np.ndarray | None:
    """The value of a node's output, (1|n,) or (1|n, 3) float32; None where the node isn't one of these."""
    function = _FUNCTIONS.get(node.bl_idname)
    if function is None:
        return None
    with np.errstate(all="ignore"):
        values = function(reader, node, output, groups)
    return None if values is None else np.nan_to_num(values, copy=False).astype(np.float32, copy=False)


def blackbody(kelvin: np.ndarray) -> np.ndarray:
    """Linear RGB (n, 3) of glowing bodies (n,), of luminance 1; below 800 K as at 800 K, as in Cycles.

    Planck's law through the colour matching functions of Wyman, Sloan and Shirley 2013, "Simple analytic approximations
    to the CIE XYZ color matching functions" (multi-lobe fit).
    """
    table = np.geomspace(800.0, 40000.0, 512)
    wave = np.arange(360.0, 831.0, 2.0)
    power = wave**-5.0 / np.expm1(1.438777e7 / (wave * table[:, None]))
    lobes = (
        ((1.056, 599.8, 37.9, 31.0), (0.362, 442.0, 16.0, 26.7), (-0.065, 501.1, 20.4, 26.2)),
        ((0.821, 568.8, 46.9, 40.5), (0.286, 530.9, 16.3, 31.1)),
        ((1.217, 437.0, 11.8, 36.0), (0.681, 459.0, 26.0, 13.8)),
    )
    xyz = np.stack([power @ sum(_lobe(wave, *lobe) for lobe in channel) for channel in lobes], axis=-1)
    rgb = xyz / xyz[:, 1:2] @ np.linalg.inv(_XYZ_FROM_RGB).T
    kelvin = np.clip(kelvin, table[0], table[-1])
    return np.stack([np.interp(kelvin, table, np.maximum(rgb[:, c], 0)) for c in range(3)], axis=-1).astype(np.float32)


_XYZ_FROM_RGB = np.array(
    [[0.4123908, 0.3575843, 0.1804808], [0.2126390, 0.7151687, 0.0721923], [0.0193308, 0.1191948, 0.9505322]]
)


def _lobe(wave: np.ndarray, height: float, middle: float, below: float, above: float) -> np.ndarray:
    return height * np.exp(-0.5 * ((wave - middle) / np.where(wave < middle, below, above)) ** 2)


def _divide(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.divide(a, b, out=np.zeros(np.broadcast_shapes(a.shape, b.shape), np.float32), where=b != 0)


def _power(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.where((a < 0) & (b != np.trunc(b)), 0, np.power(a, b))


def _logarithm(a: np.ndarray, base: np.ndarray) -> np.ndarray:
    return np.where((a > 0) & (base > 0), _divide(np.log(np.maximum(a, 1e-38)), np.log(np.maximum(base, 1e-38))), 0)


def _wrap(a: np.ndarray, high: np.ndarray, low: np.ndarray) -> np.ndarray:
    span = high - low
    return np.where(span != 0, a - span * np.floor(_divide(a - low, span)), low)


def _pingpong(a: np.ndarray, scale: np.ndarray) -> np.ndarray:
    share = _divide(a - scale, 2 * scale)
    return np.where(scale == 0, 0, np.abs((share - np.floor(share)) * scale * 2 - scale))


def _smooth_min(a: np.ndarray, b: np.ndarray, distance: np.ndarray) -> np.ndarray:
    h = _divide(np.maximum(distance - np.abs(a - b), 0), distance)
    return np.where(distance != 0, np.minimum(a, b) - h**3 * distance / 6, np.minimum(a, b))


# Operations of Math by the number of their operands.
_MATH = {
    1: {
        "SQRT": lambda a: np.sqrt(np.maximum(a, 0)),
        "INVERSE_SQRT": lambda a: np.where(a > 0, 1 / np.sqrt(np.maximum(a, 1e-38)), 0),
        "ABSOLUTE": np.abs,
        "EXPONENT": np.exp,
        "SIGN": np.sign,
        "ROUND": lambda a: np.floor(a + 0.5),
        "FLOOR": np.floor,
        "CEIL": np.ceil,
        "TRUNC": np.trunc,
        "FRACT": lambda a: a - np.floor(a),
        "SINE": np.sin,
        "COSINE": np.cos,
        "TANGENT": np.tan,
        "ARCSINE": lambda a: np.where(np.abs(a) <= 1, np.arcsin(np.clip(a, -1, 1)), 0),
        "ARCCOSINE": lambda a: np.where(np.abs(a) <= 1, np.arccos(np.clip(a, -1, 1)), 0),
        "ARCTANGENT": np.arctan,
        "SINH": np.sinh,
        "COSH": np.cosh,
        "TANH": np.tanh,
        "RADIANS": np.radians,
        "DEGREES": np.degrees,
    },
    2: {
        "ADD": np.add,
        "SUBTRACT": np.subtract,
        "MULTIPLY": np.multiply,
        "DIVIDE": _divide,
        "POWER": _power,
        "LOGARITHM": _logarithm,
        "MINIMUM": np.minimum,
        "MAXIMUM": np.maximum,
        "LESS_THAN": np.less,
        "GREATER_THAN": np.greater,
        "MODULO": lambda a, b: np.where(b != 0, np.fmod(a, np.where(b != 0, b, 1)), 0),
        "FLOORED_MODULO": lambda a, b: np.where(b != 0, a - np.floor(_divide(a, b)) * b, 0),
        "SNAP": lambda a, b: np.floor(_divide(a, b)) * b,
        "PINGPONG": _pingpong,
        "ARCTAN2": np.arctan2,
    },
    3: {
        "MULTIPLY_ADD": lambda a, b, c: a * b + c,
        "COMPARE": lambda a, b, c: (a == b) | (np.abs(a - b) <= np.maximum(c, np.float32(np.finfo(np.float32).eps))),
        "SMOOTH_MIN": _smooth_min,
        "SMOOTH_MAX": lambda a, b, c: -_smooth_min(-a, -b, c),
        "WRAP": _wrap,
    },
}


def _math(reader: Reader, node: bpy.types.Node, _output: bpy.types.NodeSocket, groups: Groups) -> np.ndarray | None:
    for count, operations in _MATH.items():
        if node.operation in operations:
            names = ("Value", "Value_001", "Value_002")[:count]
            values = np.asarray(operations[node.operation](*(reader.number(node, name, groups) for name in names)))
            values = values.astype(np.float32)
            return np.clip(values, 0, 1) if node.use_clamp else values
    return None


def _vector_math(
    reader: Reader, node: bpy.types.Node, output: bpy.types.NodeSocket, groups: Groups
) -> np.ndarray | None:
    a = reader.color(node, "Vector", groups)
    if node.operation == "LENGTH":
        return np.linalg.norm(a, axis=1)
    if node.operation == "NORMALIZE":
        return _divide(a, np.linalg.norm(a, axis=1)[:, None])
    if node.operation == "SCALE":
        return a * reader.number(node, "Scale", groups)[:, None]
    operations = {
        "ADD": np.add,
        "SUBTRACT": np.subtract,
        "MULTIPLY": np.multiply,
        "DIVIDE": _divide,
        "MINIMUM": np.minimum,
        "MAXIMUM": np.maximum,
        "DOT_PRODUCT": lambda a, b: (a * b).sum(axis=1),
        "DISTANCE": lambda a, b: np.linalg.norm(a - b, axis=1),
    }
    operation = operations.get(node.operation)
    return None if operation is None else operation(a, reader.color(node, "Vector_001", groups))


def _map_range(
    reader: Reader, node: bpy.types.Node, _output: bpy.types.NodeSocket, groups: Groups
) -> np.ndarray | None:
    if node.data_type != "FLOAT":
        return None
    names = ("Value", "From Min", "From Max", "To Min", "To Max")
    value, from_low, from_high, to_low, to_high = (reader.number(node, name, groups) for name in names)
    share = _divide(value - from_low, from_high - from_low)
    if node.interpolation_type == "STEPPED":
        steps = reader.number(node, "Steps", groups)
        share = np.where(steps > 0, _divide(np.floor(share * (steps + 1)), steps), 0)
    elif node.interpolation_type in ("SMOOTHSTEP", "SMOOTHERSTEP"):
        t = np.clip(share, 0, 1)
        share = t * t * (3 - 2 * t) if node.interpolation_type == "SMOOTHSTEP" else t**3 * (t * (t * 6 - 15) + 10)
    result = to_low + share * (to_high - to_low)
    if node.clamp and node.interpolation_type in ("LINEAR", "STEPPED"):
        result = np.clip(result, np.minimum(to_low, to_high), np.maximum(to_low, to_high))
    return result


def _clamp(reader: Reader, node: bpy.types.Node, _output: bpy.types.NodeSocket, groups: Groups) -> np.ndarray:
    value, low, high = (reader.number(node, name, groups) for name in ("Value", "Min", "Max"))
    if node.clamp_type == "RANGE":
        low, high = np.minimum(low, high), np.maximum(low, high)
    return np.minimum(np.maximum(value, low), high)


def _ramp(reader: Reader, node: bpy.types.Node, output: bpy.types.NodeSocket, groups: Groups) -> np.ndarray:
    ramp = node.color_ramp
    place = np.clip(reader.number(node, "Fac", groups), 0, 1)
    table = np.array([tuple(ramp.evaluate(k / (_STEPS - 1))) for k in range(_STEPS)], dtype=np.float32)
    if ramp.interpolation == "CONSTANT":
        rows = table[(place * (_STEPS - 1)).astype(np.int32)]
    else:
        rows = _read_table(place, table)
    return rows[:, 3] if output.identifier == "Alpha" else rows[:, :3]


def _read_table(place: np.ndarray, table: np.ndarray) -> np.ndarray:
    """Rows (n, columns) of a table over 0..1 at places (n,)."""
    steps = np.linspace(0, 1, len(table))
    return np.stack([np.interp(place, steps, column) for column in table.T], axis=-1)


def _curve_table(mapping: bpy.types.CurveMapping, curve: bpy.types.CurveMap, low: float, high: float) -> np.ndarray:
    return np.array([mapping.evaluate(curve, x) for x in np.linspace(low, high, _STEPS)], dtype=np.float32)


def _apply_curve(values: np.ndarray, mapping: bpy.types.CurveMapping, curve: bpy.types.CurveMap) -> np.ndarray:
    """A curve of the range of its points, continued as the mapping says."""
    places = [point.location[0] for point in curve.points]
    low, high = min(0.0, *places), max(1.0, *places)
    table = _curve_table(mapping, curve, low, high)
    result = np.interp(values, np.linspace(low, high, _STEPS), table)
    if mapping.extend == "EXTRAPOLATED":
        step = (high - low) / (_STEPS - 1)
        result = np.where(values < low, table[0] + (values - low) * (table[1] - table[0]) / step, result)
        result = np.where(values > high, table[-1] + (values - high) * (table[-1] - table[-2]) / step, result)
    return result


def _float_curve(reader: Reader, node: bpy.types.Node, _output: bpy.types.NodeSocket, groups: Groups) -> np.ndarray:
    value, factor = reader.number(node, "Value", groups), reader.number(node, "Factor", groups)
    node.mapping.initialize()
    return value + factor * (_apply_curve(value, node.mapping, node.mapping.curves[0]) - value)


def _rgb_curves(reader: Reader, node: bpy.types.Node, _output: bpy.types.NodeSocket, groups: Groups) -> np.ndarray:
    color, factor = reader.color(node, "Color", groups), reader.number(node, "Fac", groups)[:, None]
    mapping = node.mapping
    mapping.initialize()
    channels = [
        _apply_curve(_apply_curve(color[:, c], mapping, mapping.curves[3]), mapping, mapping.curves[c])
        for c in range(3)
    ]
    return color + factor * (np.stack(channels, axis=-1) - color)


_BLENDS = {
    "MIX": lambda a, b: b,
    "ADD": np.add,
    "SUBTRACT": np.subtract,
    "MULTIPLY": np.multiply,
    "DIVIDE": lambda a, b: np.where(b != 0, _divide(a, b), a),
    "SCREEN": lambda a, b: 1 - (1 - a) * (1 - b),
    "DIFFERENCE": lambda a, b: np.abs(a - b),
    "DARKEN": np.minimum,
    "LIGHTEN": np.maximum,
}


def _mix_by(names: tuple[str, str, str]) -> Function:
    """The old colour mix and the new one call their inputs differently."""

    def mix(
        reader: Reader, node: bpy.types.Node, _output: bpy.types.NodeSocket, groups: Groups
    ) -> np.ndarray | None:
        if node.blend_type not in _BLENDS:
            return None
        factor = reader.number(node, names[0], groups)[:, None]
        if getattr(node, "clamp_factor", True):
            factor = np.clip(factor, 0, 1)
        a, b = reader.color(node, names[1], groups), reader.color(node, names[2], groups)
        result = a + factor * (_BLENDS[node.blend_type](a, b) - a)
        return np.clip(result, 0, 1) if getattr(node, "clamp_result", getattr(node, "use_clamp", False)) else result

    return mix


def _mix(reader: Reader, node: bpy.types.Node, output: bpy.types.NodeSocket, groups: Groups) -> np.ndarray | None:
    if node.data_type == "RGBA":
        return _mix_by(("Factor_Float", "A_Color", "B_Color"))(reader, node, output, groups)
    if node.data_type == "FLOAT":
        a, b = reader.number(node, "A_Float", groups), reader.number(node, "B_Float", groups)
        factor = reader.number(node, "Factor_Float", groups)
    elif node.data_type == "VECTOR":
        a, b = reader.color(node, "A_Vector", groups), reader.color(node, "B_Vector", groups)
        is_uniform = node.factor_mode == "UNIFORM"
        factor = reader.number(node, "Factor_Float", groups)[:, None] if is_uniform else None
        factor = reader.color(node, "Factor_Vector", groups) if factor is None else factor
    else:
        return None
    return a + (np.clip(factor, 0, 1) if node.clamp_factor else factor) * (b - a)


def _separate(reader: Reader, node: bpy.types.Node, output: bpy.types.NodeSocket, groups: Groups) -> np.ndarray | None:
    if getattr(node, "mode", "RGB") != "RGB":
        return None
    channel = [entry.identifier for entry in node.outputs].index(output.identifier)
    return reader.color(node, node.inputs[0].identifier, groups)[:, channel]


def _combine(reader: Reader, node: bpy.types.Node, _output: bpy.types.NodeSocket, groups: Groups) -> np.ndarray | None:
    if getattr(node, "mode", "RGB") != "RGB":
        return None
    channels = [reader.number(node, entry.identifier, groups) for entry in list(node.inputs)[:3]]
    return np.stack(np.broadcast_arrays(*channels), axis=-1)


def _invert(reader: Reader, node: bpy.types.Node, _output: bpy.types.NodeSocket, groups: Groups) -> np.ndarray:
    color = reader.color(node, "Color", groups)
    return color + reader.number(node, "Fac", groups)[:, None] * (1 - 2 * color)


def _gamma(reader: Reader, node: bpy.types.Node, _output: bpy.types.NodeSocket, groups: Groups) -> np.ndarray:
    color = reader.color(node, "Color", groups)
    return np.where(color > 0, np.power(np.maximum(color, 1e-38), reader.number(node, "Gamma", groups)[:, None]), color)


def _blackbody(reader: Reader, node: bpy.types.Node, _output: bpy.types.NodeSocket, groups: Groups) -> np.ndarray:
    return blackbody(reader.number(node, "Temperature", groups))


_FUNCTIONS: dict[str, Function] = {
    "ShaderNodeMath": _math,
    "ShaderNodeVectorMath": _vector_math,
    "ShaderNodeMapRange": _map_range,
    "ShaderNodeClamp": _clamp,
    "ShaderNodeValToRGB": _ramp,
    "ShaderNodeFloatCurve": _float_curve,
    "ShaderNodeRGBCurve": _rgb_curves,
    "ShaderNodeMix": _mix,
    "ShaderNodeMixRGB": _mix_by(("Fac", "Color1", "Color2")),
    "ShaderNodeSeparateColor": _separate,
    "ShaderNodeSeparateRGB": _separate,
    "ShaderNodeSeparateXYZ": _separate,
    "ShaderNodeCombineColor": _combine,
    "ShaderNodeCombineRGB": _combine,
    "ShaderNodeCombineXYZ": _combine,
    "ShaderNodeInvert": _invert,
    "ShaderNodeGamma": _gamma,
    "ShaderNodeBlackbody": _blackbody,
}
