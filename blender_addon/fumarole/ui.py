# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels in the places where a Cycles user looks, and Blender's own panels that apply to Fumarole."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from . import compat
from .engine import FumaroleEngine, last_stats
from .passes import LIGHT_SWITCHES, OWN_SWITCHES, SWITCHES

# Panels for all engines that show what Fumarole doesn't have, or that the ones below show better.
_EXCLUDED = {"DATA_PT_light", "DATA_PT_area", "DATA_PT_distance", "DATA_PT_falloff_curve", "NODE_DATA_PT_light"}
_EXCLUDED_PREFIXES = ("RENDER_PT_freestyle", "VIEWLAYER_PT_freestyle", "MATERIAL_PT_freestyle", "DATA_PT_lightprobe")
# EEVEE's panels for settings that Fumarole shares.
_INCLUDED = {
    "EEVEE_MATERIAL_PT_context_material",
    "EEVEE_MATERIAL_PT_surface",
    "EEVEE_MATERIAL_PT_volume",
    "EEVEE_WORLD_PT_surface",
    "MATERIAL_PT_preview",
}


class FumarolePanel:
    """What all panels of the engine share."""

    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    COMPAT_ENGINES = {FumaroleEngine.bl_idname}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return context.engine in cls.COMPAT_ENGINES

    def column(self) -> bpy.types.UILayout:
        """A column in Blender's usual two-column look."""
        self.layout.use_property_split = True
        self.layout.use_property_decorate = False
        return self.layout.column()


class FUMAROLE_PT_lighting(FumarolePanel, bpy.types.Panel):
    bl_label = "Lighting"
    bl_context = "render"

    def draw(self, context: bpy.types.Context) -> None:
        column = self.column()
        column.prop(context.scene.fumarole, "tolerance")
        column.prop(context.scene.fumarole, "light_samples")


class FUMAROLE_PT_accuracy(FumarolePanel, bpy.types.Panel):
    """How wrong the light of the last render is, as it was measured."""

    bl_label = "Accuracy"
    bl_context = "render"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        column = self.column()
        stats = last_stats()
        if stats is None or stats.accuracy_count == 0:
            column.label(text="Not measured yet" if stats is None else "No light in the smoke in view")
            return
        column.label(text="Last render: errors of the light's transmittance")
        rows = column.split(factor=0.4)
        names, values = rows.column(), rows.column()
        names.alignment = "RIGHT"
        for name, value in (
            ("RMS", f"{stats.accuracy_rms:.2g}"),
            ("95th percentile", f"{stats.accuracy_p95:.2g}"),
            ("Worst", f"{stats.accuracy_worst:.2g}"),
            ("Bias", f"{stats.accuracy_bias:+.2g}"),
            ("Points", f"{stats.accuracy_count:,}"),
            ("Refined", f"{stats.refinement_count} times"),
        ):
            names.label(text=name)
            values.label(text=value)


class FUMAROLE_PT_artistic(FumarolePanel, bpy.types.Panel):
    bl_label = "Artistic"
    bl_context = "render"
    bl_parent_id = "FUMAROLE_PT_lighting"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        column = self.column()
        column.prop(context.scene.fumarole, "shadowing_density")
        column.prop(context.scene.fumarole, "solid_shadow_intensity")
        column.prop(context.scene.fumarole, "intersection_scale")
        column.prop(context.scene.fumarole, "subsampling")


class FUMAROLE_PT_film(FumarolePanel, bpy.types.Panel):
    bl_label = "Film"
    bl_context = "render"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        column = self.column()
        column.prop(context.scene.render, "film_transparent", text="Transparent")
        column.prop(context.scene.fumarole, "solids")


class FUMAROLE_PT_blur(FumarolePanel, bpy.types.Panel):
    bl_label = "Blur"
    bl_context = "render"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        column = self.column()
        scene = context.scene
        column.prop(scene.render, "use_motion_blur", text="Motion Blur")
        shutter = column.column()
        shutter.enabled = scene.render.use_motion_blur
        position = compat.shutter_settings(scene)
        if position is not None:
            shutter.prop(position, "motion_blur_position", text="Position")
        shutter.prop(scene.render, "motion_blur_shutter", text="Shutter")
        column.prop(scene.fumarole, "blur_samples")


class FUMAROLE_PT_performance(FumarolePanel, bpy.types.Panel):
    bl_label = "Performance"
    bl_context = "render"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        column = self.column()
        render = context.scene.render
        column.prop(render, "threads_mode")
        threads = column.column()
        threads.enabled = render.threads_mode == "FIXED"
        threads.prop(render, "threads")
        column.prop(context.scene.fumarole, "device")
        column.prop(context.scene.fumarole, "leaf_size")
        column.prop(render, "use_persistent_data", text="Persistent Data")


class FUMAROLE_PT_deep(FumarolePanel, bpy.types.Panel):
    bl_label = "Deep EXR"
    bl_context = "output"
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header(self, context: bpy.types.Context) -> None:
        self.layout.prop(context.scene.fumarole, "use_deep", text="")

    def draw(self, context: bpy.types.Context) -> None:
        column = self.column()
        column.active = context.scene.fumarole.use_deep
        column.prop(context.scene.fumarole, "deep_path", text="File")


class FUMAROLE_PT_passes(FumarolePanel, bpy.types.Panel):
    bl_label = "Passes"
    bl_context = "view_layer"

    def draw(self, context: bpy.types.Context) -> None:
        column = self.column()
        for name, switch in SWITCHES.items():
            column.prop(context.view_layer, switch, text=name)
        for switch in dict.fromkeys(OWN_SWITCHES.values()):
            column.prop(context.view_layer.fumarole, switch)
        for switch, _name in LIGHT_SWITCHES.values():
            column.prop(context.view_layer.fumarole, switch)
        column.prop(context.view_layer, "use_pass_cryptomatte_object", text="Cryptomatte")
        depth = column.column()
        depth.enabled = context.view_layer.use_pass_cryptomatte_object
        depth.prop(context.view_layer, "pass_cryptomatte_depth", text="Levels")


class FUMAROLE_PT_particles(FumarolePanel, bpy.types.Panel):
    bl_label = "Smoke"
    bl_context = "particle"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        system = context.particle_system
        settings = system.settings if system else context.particle_settings
        return super().poll(context) and settings is not None and settings.type != "HAIR"

    def draw(self, context: bpy.types.Context) -> None:
        system = context.particle_system
        settings = system.settings if system else context.particle_settings
        _draw_smoke(self.column(), settings.fumarole)


class FUMAROLE_PT_object(FumarolePanel, bpy.types.Panel):
    bl_label = "Smoke of Points"
    bl_context = "object"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        owner = context.object
        makes_points = owner is not None and any(modifier.type == "NODES" for modifier in owner.modifiers)
        return super().poll(context) and owner is not None and (owner.type == "POINTCLOUD" or makes_points)

    def draw(self, context: bpy.types.Context) -> None:
        _draw_smoke(self.column(), context.object.fumarole)


class FUMAROLE_PT_light(FumarolePanel, bpy.types.Panel):
    bl_label = "Light"
    bl_context = "data"

    # Drawn where the light has them: that depends on its type and on the version of Blender.
    PROPERTIES = (
        "color",
        "use_temperature",
        "temperature",
        "energy",
        "exposure",
        "normalize",
        "angle",
        "shape",
        "size",
        "size_y",
        "spread",
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return super().poll(context) and context.light is not None

    def draw(self, context: bpy.types.Context) -> None:
        light = context.light
        self.layout.row().prop(light, "type", expand=True)
        column = self.column()
        for name in self.PROPERTIES:
            if hasattr(light, name) and (name != "size_y" or light.shape in ("RECTANGLE", "ELLIPSE")):
                column.prop(light, name)
        if light.type in ("POINT", "SPOT"):
            column.prop(light, "shadow_soft_size", text="Radius")


def _draw_smoke(column: bpy.types.UILayout, settings: bpy.types.PropertyGroup) -> None:
    column.prop(settings, "smoke")
    scale = column.column()
    scale.enabled = settings.smoke != "NOT_SMOKE"
    scale.prop(settings, "radius_scale")


_PANELS = (
    FUMAROLE_PT_lighting,
    FUMAROLE_PT_artistic,
    FUMAROLE_PT_accuracy,
    FUMAROLE_PT_film,
    FUMAROLE_PT_blur,
    FUMAROLE_PT_performance,
    FUMAROLE_PT_deep,
    FUMAROLE_PT_passes,
    FUMAROLE_PT_light,
    FUMAROLE_PT_particles,
    FUMAROLE_PT_object,
)


def _shared_panels() -> Iterator[type[bpy.types.Panel]]:
    """Blender's own panels that apply to Fumarole."""
    for panel in bpy.types.Panel.__subclasses__():
        name, engines = panel.__name__, getattr(panel, "COMPAT_ENGINES", ())
        excluded = name in _EXCLUDED or name.startswith(_EXCLUDED_PREFIXES)
        if name in _INCLUDED or ("BLENDER_RENDER" in engines and not excluded):
            yield panel


def register() -> None:
    for panel in _PANELS:
        bpy.utils.register_class(panel)
    for panel in _shared_panels():
        panel.COMPAT_ENGINES.add(FumaroleEngine.bl_idname)


def unregister() -> None:
    for panel in _shared_panels():
        panel.COMPAT_ENGINES.discard(FumaroleEngine.bl_idname)
    for panel in reversed(_PANELS):
        bpy.utils.unregister_class(panel)
