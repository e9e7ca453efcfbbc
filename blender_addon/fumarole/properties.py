# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings that Fumarole adds to scenes, particle settings and objects."""

import dataclasses

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from . import compat, core

# The library's own defaults. (Blender reads the annotations below, so they must not be postponed.)
_DEFAULTS = core.Settings()

# The numbers are written to .blend files: never change them.
_SMOKE = (
    ("AUTOMATIC", "Automatic", "Smoke if it is a particle emitter rendered as Halo, or a point cloud", 0),
    ("SMOKE", "Smoke", "Draw it as smoke, however it is rendered otherwise", 1),
    ("NOT_SMOKE", "Not Smoke", "Don't draw it as smoke", 2),
)


_DEVICES = (
    ("AUTO", "Automatic", "The best there is", 0),
    ("TILES", "Processor", "Smoke is added up in slabs along each pixel and lit everywhere, inside particles too", 2),
    ("GL", "OpenGL", "Every particle is lit at its centre and drawn as a billboard by the graphics driver: right for "
     "many small particles, too dark for few large or dense ones", 1),
)


_SOLIDS = (
    ("HOLDOUT", "Holdout", "They hide smoke and are transparent, so that the picture goes over one of the solids", 0),
    ("SHADED", "Shaded", "They are drawn plainly: matt, in their materials' colours, lit by the lights alone. Objects "
     "and collections may stay holdouts", 1),
)


def _smoke_switch() -> EnumProperty:
    return EnumProperty(name="Smoke", description="Whether the particles are drawn as smoke", items=_SMOKE, default=0)


def _radius_scale() -> FloatProperty:
    return FloatProperty(
        name="Radius Scale",
        description="Factor on the particles' size, which gives the radius of each in the smoke: two standard "
        "deviations of its density",
        default=1.0,
        min=0.0,
        soft_max=10.0,
    )


class FumaroleParticleSettings(bpy.types.PropertyGroup):
    """How the particles of a system become smoke."""

    smoke: _smoke_switch()
    radius_scale: _radius_scale()


class FumaroleObjectSettings(bpy.types.PropertyGroup):
    """How the points of a point cloud become smoke."""

    smoke: _smoke_switch()
    radius_scale: _radius_scale()


class FumaroleSceneSettings(bpy.types.PropertyGroup):
    """How smoke is lit and drawn."""

    device: EnumProperty(name="Device", description="What draws the smoke", items=_DEVICES, default=0)
    tolerance: FloatProperty(
        name="Tolerance",
        description="Relative error that lighting and drawing may cause in the picture. The light that reaches a "
        "particle is kept within a tenth of it",
        default=_DEFAULTS.tolerance,
        min=1e-4,
        max=0.5,
        precision=4,
    )
    solids: EnumProperty(name="Solids", description="How meshes look in the picture", items=_SOLIDS, default=0)
    light_samples: IntProperty(
        name="Light Samples",
        description="Most points that a light with a size is sampled at. Lights that look small from the smoke take "
        "fewer",
        default=_DEFAULTS.light_samples,
        min=1,
        max=1024,
    )
    leaf_size: IntProperty(
        name="Leaf Size",
        description="An octree cell that holds more particles than this is divided. It changes speed, not the picture",
        default=_DEFAULTS.leaf_size,
        min=1,
        max=4096,
    )
    shadowing_density: FloatProperty(
        name="Shadowing Density",
        description="Factor on the density of the smoke as lights see it: higher makes shadows in the smoke darker. "
        "1 is physically right",
        default=1.0,
        min=0.0,
        soft_max=10.0,
    )
    solid_shadow_intensity: FloatProperty(
        name="Solid Shadow Intensity",
        description="Share of a light's power that solids block: lower gives softer shadows of objects on smoke. "
        "1 is physically right",
        default=1.0,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
    )
    subsampling: FloatProperty(
        name="Particle Subsampling",
        description="Share of the particles that cast shadows on smoke, chosen at random and made denser in turn: "
        "lower is faster and rougher. 1 is physically right",
        default=1.0,
        min=1e-4,
        max=1.0,
        subtype="FACTOR",
    )
    intersection_scale: FloatProperty(
        name="Intersection Size",
        description="Factor on the particles' radius as lights see them: larger makes shadows in the smoke wider and "
        "darker. 1 is physically right",
        default=1.0,
        min=0.01,
        max=100.0,
        soft_max=10.0,
    )
    blur_samples: IntProperty(
        name="Blur Samples",
        description="Renders at parts of the shutter and of the aperture whose mean is the picture. 1 blurs all in one "
        "pass, 0 takes as many as the tolerance needs",
        default=0,
        min=0,
        max=core.MOST_SAMPLES,
    )
    use_deep: BoolProperty(
        name="Deep EXR",
        description="Write the smoke in depth to a file for each frame, for compositing: samples with R, G, B, A, Z and "
        "ZBack, as long as the tolerance allows",
        default=False,
    )
    deep_path: StringProperty(
        name="Deep EXR File",
        description="The last # in the file's name become the frame's number",
        default="//deep/smoke_####.exr",
        subtype="FILE_PATH",
        options=compat.FILE_PATH_OPTIONS,
    )

    def to_core(self) -> core.Settings:
        """The settings of a render."""
        names = {field.name for field in dataclasses.fields(core.Settings)} & self.__annotations__.keys()
        return core.Settings(**{name: getattr(self, name) for name in names})


def _tell_passes(_settings: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    """Has the compositor's nodes show the passes that there are now."""
    context.view_layer.update_render_passes()


class FumaroleViewLayerSettings(bpy.types.PropertyGroup):
    """Passes that Blender has no switches for."""

    use_pass_opacity: BoolProperty(
        name="Opacity",
        description="The opacity of the smoke, and of solids if they are shaded, whatever is put behind",
        update=_tell_passes,
    )
    use_pass_depth_range: BoolProperty(
        name="Depth Range",
        description="Two passes, Depth Front and Depth Back: between them are nine tenths of the smoke's opacity",
        update=_tell_passes,
    )
    use_pass_albedo: BoolProperty(
        name="Albedo",
        description="The smoke's colour, times opacity",
        update=_tell_passes,
    )
    use_pass_solid_shadow: BoolProperty(
        name="Solid Shadow",
        description="The share of the light on the smoke that solids let through",
        update=_tell_passes,
    )
    use_pass_error: BoolProperty(
        name="Error",
        description="How far the light in the smoke is off, found exactly in each pixel: as share of the lights. Slow",
        update=_tell_passes,
    )
    use_pass_lights: BoolProperty(
        name="Lights",
        description="A pass for each light: what the smoke scatters of it. Together with Emit they add up to Combined",
        update=_tell_passes,
    )
    use_pass_light_shadows: BoolProperty(
        name="Shadows of Lights",
        description="A pass for each light: the share of it that smoke lets through to the solid in a pixel",
        update=_tell_passes,
    )
    use_pass_light_solid_shadows: BoolProperty(
        name="Solid Shadows of Lights",
        description="A pass for each light: the share of it that solids let through to the smoke",
        update=_tell_passes,
    )


_GROUPS = {
    bpy.types.ViewLayer: FumaroleViewLayerSettings,
    bpy.types.Scene: FumaroleSceneSettings,
    bpy.types.ParticleSettings: FumaroleParticleSettings,
    bpy.types.Object: FumaroleObjectSettings,
}


def register() -> None:
    for owner, group in _GROUPS.items():
        bpy.utils.register_class(group)
        owner.fumarole = PointerProperty(type=group)


def unregister() -> None:
    for owner, group in _GROUPS.items():
        del owner.fumarole
        bpy.utils.unregister_class(group)
