# SPDX-License-Identifier: GPL-3.0-or-later
"""Fumarole: a Blender render engine for smoke made of particles.

The package is the add-on; `fumarole.core` works without Blender, so bpy is imported in register() alone.
"""

bl_info = {
    "name": "Fumarole",
    "author": "Fumarole developers",
    "version": (0, 1, 0),
    "blender": (3, 4, 0),
    "location": "Render Properties > Render Engine > Fumarole",
    "description": "Render engine for smoke made of particles",
    "category": "Render",
}


def register() -> None:
    """Adds the engine, its settings and its panels. Raises core.FumaroleError when the library can't be loaded."""
    from . import core, engine, properties, ui

    core.version()
    properties.register()
    engine.register()
    ui.register()


def unregister() -> None:
    """Takes away what register() added."""
    from . import engine, properties, ui

    ui.unregister()
    engine.unregister()
    properties.unregister()
