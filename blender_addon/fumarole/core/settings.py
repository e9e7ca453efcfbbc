# SPDX-License-Identifier: GPL-3.0-or-later
"""Settings of a render; their defaults are the library's."""

from __future__ import annotations

import ctypes
import dataclasses
import functools
from typing import Any

from . import _abi, _arrays
from ._library import library
from .errors import argument_error

SOLVERS = _abi.choices("FUM_SOLVER_")
DEVICES = _abi.choices("FUM_DEVICE_")
SOLIDS = _abi.choices("FUM_SOLIDS_")


@functools.cache
def _defaults() -> _abi.fum_settings:
    settings = _abi.fum_settings()
    library().fum_settings_init(ctypes.byref(settings))
    return settings


def _default(name: str) -> Any:
    return dataclasses.field(default_factory=lambda: getattr(_defaults(), name))


@dataclasses.dataclass
class Settings:
    """How a scene is lit and drawn. Values out of range raise FumaroleError when the settings are used.

    solver: "AUTOMATIC" takes the faster one that keeps the tolerance; "EXACT"; "SWEEP" where a sweep is possible.
    device: what draws: "AUTO", "TILES" or "GL".
    leaf_size: an octree cell is subdivided above this many particles, 1..4096.
    light_samples: most sample points of a soft light, 1..1024.
    tolerance: relative error that lighting and drawing may cause, 1e-4..0.5; transmittance keeps a tenth of it.
    solids: "HOLDOUT": they hide smoke and are transparent; "SHADED": Lambertian, lit by the lights.

    Artistic ones, which leave physics at any other than their default:
    shadowing_density: factor on optical depth towards lights, at least 0; default 1.
    solid_shadow_intensity: share of a light's power that solids block, 0..1; default 1.
    subsampling: share of the particles that cast shadows on smoke, above 0 and at most 1; default 1.
    intersection_scale: factor on the particles' radius towards lights, 0.01..100; default 1.
    """

    solver: str = "AUTOMATIC"
    device: str = "AUTO"
    leaf_size: int = _default("leaf_size")
    light_samples: int = _default("light_samples")
    tolerance: float = _default("tolerance")
    solids: str = "HOLDOUT"
    shadowing_density: float = _default("shadowing_density")
    solid_shadow_intensity: float = _default("solid_shadow_intensity")
    subsampling: float = _default("subsampling")
    intersection_scale: float = _default("intersection_scale")

    def struct(self) -> _abi.fum_settings:
        """The C description. Raises FumaroleError for a value that is no number or no known name."""
        settings = _abi.fum_settings()
        library().fum_settings_init(ctypes.byref(settings))
        names = {"solver": SOLVERS, "device": DEVICES, "solids": SOLIDS}
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if field.name in names:
                if value not in names[field.name]:
                    expected = ", ".join(names[field.name])
                    raise argument_error(f"settings: {field.name} is {value!r}, expected one of {expected}")
                value = names[field.name][value]
            elif isinstance(getattr(settings, field.name), int):
                value = _arrays.whole(value, f"settings: {field.name}")
            else:
                value = _arrays.number(value, f"settings: {field.name}")
            setattr(settings, field.name, value)
        return settings
