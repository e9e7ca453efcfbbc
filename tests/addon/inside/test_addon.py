# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on in Blender's interface: enabling, panels, settings that are saved."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import addon_utils
import bpy
import pytest
import scenes
from fumarole import core, passes


def shared_panels() -> set[str]:
    panels = bpy.types.Panel.__subclasses__()
    return {panel.__name__ for panel in panels if "FUMAROLE" in getattr(panel, "COMPAT_ENGINES", ())}


def test_enabling_and_disabling_twice_leaves_nothing(tmp_path: Path) -> None:
    before = shared_panels()
    handlers = len(bpy.app.handlers.render_init)
    for _ in range(2):
        addon_utils.disable("fumarole")
        assert not shared_panels() - {name for name in shared_panels() if name.startswith("FUMAROLE")}
        assert not hasattr(bpy.types.Scene, "fumarole")
        assert not hasattr(bpy.types.ParticleSettings, "fumarole")
        assert len(bpy.app.handlers.render_init) == handlers - 1
        assert not hasattr(bpy.types, "FUMAROLE_PT_lighting")
        assert addon_utils.enable("fumarole", default_set=True) is not None
    assert shared_panels() >= before
    bpy.context.scene.render.engine = "FUMAROLE"
    scenes.emitter(count=5)
    scenes.camera()
    assert scenes.render_combined(tmp_path).shape == (64, 64, 4)


def test_importing_core_imports_no_bpy() -> None:
    import subprocess
    import sys

    folder = Path(core.__file__).parents[2]
    code = "import sys, fumarole.core; sys.exit('bpy' in sys.modules)"
    python = Path("/usr/bin/python3") if bpy.app.version < (4, 0, 0) else Path(sys.executable)
    environment = {"PYTHONPATH": str(folder), "PATH": "/usr/bin:/bin"}
    assert subprocess.run([python, "-c", code], env=environment, timeout=60).returncode == 0


def test_blenders_panels_that_apply_are_there() -> None:
    expected = {
        "RENDER_PT_format",
        "RENDER_PT_output",
        "DATA_PT_lens",
        "DATA_PT_spot",
        "EEVEE_MATERIAL_PT_volume",
        "EEVEE_WORLD_PT_surface",
        "PARTICLE_PT_emission",
        "PARTICLE_PT_render",
    }
    assert expected <= shared_panels()
    assert not {name for name in shared_panels() if "freestyle" in name}


class Layout:
    """Stands for a UILayout: every property that a panel draws must exist."""

    def __init__(self) -> None:
        self.drawn: list[str] = []

    def column(self) -> Layout:
        return self

    row = column

    def prop(self, owner: bpy.types.bpy_struct, name: str, text: str = "", expand: bool = False) -> None:
        assert name in owner.bl_rna.properties, f"{owner} has no property {name}"
        self.drawn.append(name)


def draw(panel: str, **context: object) -> list[str]:
    kind = getattr(bpy.types, panel)
    full = SimpleNamespace(engine="FUMAROLE", scene=bpy.context.scene, view_layer=bpy.context.view_layer, **context)
    assert kind.poll(full)
    layout = Layout()
    drawer = SimpleNamespace(layout=layout, PROPERTIES=getattr(kind, "PROPERTIES", ()))
    drawer.column = lambda: kind.column(drawer)
    if hasattr(kind, "draw_header"):
        kind.draw_header(drawer, full)
    kind.draw(drawer, full)
    return layout.drawn


def test_panels_draw_every_setting(scene: bpy.types.Scene) -> None:
    drawn = []
    for panel in ("lighting", "artistic", "film", "blur", "performance", "deep"):
        drawn += draw(f"FUMAROLE_PT_{panel}")
    settings = [name for name in scene.fumarole.bl_rna.properties.keys() if name not in ("rna_type", "name")]
    assert set(settings) <= set(drawn)
    own = {name for name in bpy.context.view_layer.fumarole.bl_rna.properties.keys() if name.startswith("use_pass")}
    cryptomatte = {"use_pass_cryptomatte_object", "pass_cryptomatte_depth"}
    assert {*passes.SWITCHES.values(), *own, *cryptomatte} == set(draw("FUMAROLE_PT_passes"))


def test_particle_and_object_panels(scene: bpy.types.Scene) -> None:
    system = scenes.emitter().particle_systems[0]
    assert draw("FUMAROLE_PT_particles", particle_system=system) == ["smoke", "radius_scale"]
    cloud = scenes.points_by_nodes("Cloud", [(0, 0, 0)])
    assert draw("FUMAROLE_PT_object", object=cloud) == ["smoke", "radius_scale"]
    plain = SimpleNamespace(engine="FUMAROLE", object=scenes.plane("Plain"))
    assert not bpy.types.FUMAROLE_PT_object.poll(plain)


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ("POINT", ["type", "color", "energy", "shadow_soft_size"]),
        ("SPOT", ["type", "color", "energy", "shadow_soft_size"]),
        ("SUN", ["type", "color", "energy", "angle"]),
        ("AREA", ["type", "color", "energy", "shape", "size", "spread"]),
    ],
)
def test_light_panel(scene: bpy.types.Scene, kind: str, expected: list[str]) -> None:
    light = scenes.light(kind).data
    newer = ["use_temperature", "temperature", "exposure", "normalize"]
    drawn = draw("FUMAROLE_PT_light", light=light)
    assert [name for name in drawn if name not in newer] == expected
    assert {name for name in drawn if name in newer} == {name for name in newer if hasattr(light, name)}
    assert len(drawn) == len(set(drawn))


def test_panels_are_for_fumarole_only(scene: bpy.types.Scene) -> None:
    assert not bpy.types.FUMAROLE_PT_lighting.poll(SimpleNamespace(engine="CYCLES"))


def test_every_pass_of_the_library_is_reachable() -> None:
    layer = bpy.context.view_layer
    scenes.light()
    layer.update()
    for switch, _called in passes.LIGHT_SWITCHES.values():
        setattr(layer.fumarole, switch, True)
    layer.use_pass_cryptomatte_object = True
    several = {item.item.name for item in passes.enabled(layer)} - {"Combined"}
    assert several == {name for name, item in core.PASSES.items() if item.per != "PICTURE"}
    assert set(core.PASSES) == {"Combined", "Holdout", *passes.SWITCHES, *passes.OWN_SWITCHES, *several}
    for name, switch in passes.OWN_SWITCHES.items():
        setattr(layer.fumarole, switch, False)
        assert name not in [item.name for item in passes.enabled(layer)]
        setattr(layer.fumarole, switch, True)
        assert name in [item.name for item in passes.enabled(layer)]
    for name, switch in passes.SWITCHES.items():
        assert name not in [item.name for item in passes.enabled(layer)]
        setattr(layer, switch, True)
        assert name in [item.name for item in passes.enabled(layer)]


@pytest.mark.parametrize(("name", "number"), [("AUTOMATIC", 0), ("SMOKE", 1), ("NOT_SMOKE", 2)])
def test_numbers_in_blend_files_never_change(scene: bpy.types.Scene, name: str, number: int) -> None:
    owner = scenes.emitter()
    settings = owner.particle_systems[0].settings
    for group in (settings.fumarole, owner.fumarole):
        assert group.bl_rna.properties["smoke"].enum_items[name].value == number


def test_settings_are_saved(scene: bpy.types.Scene, tmp_path: Path) -> None:
    owner = scenes.emitter()
    scene.fumarole.tolerance = 0.05
    owner.particle_systems[0].settings.fumarole.smoke = "NOT_SMOKE"
    owner.fumarole.radius_scale = 3.0
    path = str(tmp_path / "saved.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.wm.open_mainfile(filepath=path)
    owner = bpy.data.objects["Emitter"]
    assert bpy.context.scene.fumarole.tolerance == pytest.approx(0.05)
    assert owner.particle_systems[0].settings.fumarole.smoke == "NOT_SMOKE"
    assert owner.fumarole.radius_scale == 3.0


def test_defaults_are_those_of_the_library(scene: bpy.types.Scene) -> None:
    defaults = core.Settings()
    for name in type(scene.fumarole).__annotations__.keys() - {"use_deep", "deep_path", "blur_samples"}:
        assert getattr(scene.fumarole, name) == pytest.approx(getattr(defaults, name)), name
