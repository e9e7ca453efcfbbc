# SPDX-License-Identifier: GPL-3.0-or-later
"""Which of the library's passes a view layer asks for."""

from __future__ import annotations

import bpy

from . import core

# The view layer's switch of each pass that is optional. Names, channels and kinds are in the library's pass table.
SWITCHES = {"Depth": "use_pass_z"}


def enabled(view_layer: bpy.types.ViewLayer) -> list[core.Pass]:
    """The passes to render: Combined, which every view layer has, and those that are switched on."""
    switched_on = (name for name, switch in SWITCHES.items() if getattr(view_layer, switch))
    return [core.PASSES[name] for name in ("Combined", *switched_on)]
