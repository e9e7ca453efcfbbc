# SPDX-License-Identifier: GPL-3.0-or-later
"""Pictures: what F12 gives back, in files and in the compositor."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest
import scenes
from exr import read_exr, read_metadata, stack
from fumarole import core

CLIP_END = 100.0


def smoke(count: int = 300) -> bpy.types.Object:
    """A puff in front of the camera, lit from above; its particles are at y = 0 and rise in z."""
    owner = scenes.emitter(count=count)
    owner.rotation_euler.x = np.pi / 2
    owner.show_instancer_for_render = False
    owner.data.materials.append(scenes.material("Smoke", Density=8.0, Color=(0.8, 0.8, 0.8, 1)))
    scenes.light("POINT", energy=2000, location=(0, -3, 4))
    scenes.camera(clip_end=CLIP_END)
    bpy.context.scene.render.film_transparent = True
    return owner


def printed(capfd: pytest.CaptureFixture) -> str:
    """What was printed since the last call; Blender prints reports in the background."""
    return "".join(capfd.readouterr())


def test_smoke_is_drawn(tmp_path: Path) -> None:
    smoke()
    pixels = scenes.render_combined(tmp_path)
    assert pixels.shape == (64, 64, 4)
    assert np.isfinite(pixels).all()
    assert pixels[28:36, 28:36, 3].min() > 0.5
    assert pixels[28:36, 28:36, :3].min() > 0
    assert pixels[0, 0].max() == 0


def test_result_is_that_of_the_core(tmp_path: Path) -> None:
    """The same arrays through fumarole.core give the same picture: nothing is lost or turned in the hand-over."""
    from fumarole.export.scene import build

    smoke()
    through_blender = scenes.render_channels(tmp_path)
    (exported,) = scenes.export_layers()
    with core.Context() as context:
        result = core.render(build(exported.scene, context), exported.camera, core.Settings(), ["Combined"])
    layer = bpy.context.view_layer.name
    assert np.array_equal(stack(through_blender, f"{layer}.Combined", "RGBA"), result["Combined"])


@pytest.mark.parametrize("threads", [1, 2])
def test_threads_change_no_bit(threads: int, tmp_path: Path) -> None:
    smoke()
    automatic = scenes.render_combined(tmp_path)
    render = bpy.context.scene.render
    render.threads_mode, render.threads = "FIXED", threads
    assert np.array_equal(scenes.render_combined(tmp_path), automatic)


def test_number_of_threads_reaches_the_library(monkeypatch: pytest.MonkeyPatch) -> None:
    numbers = []

    class Context(core.Context):
        def __init__(self, threads: int) -> None:
            numbers.append(threads)
            super().__init__(threads)

    monkeypatch.setattr(core, "Context", Context)
    scenes.camera()
    render = bpy.context.scene.render
    bpy.ops.render.render()
    render.threads_mode, render.threads = "FIXED", 3
    bpy.ops.render.render()
    assert numbers == [0, 3]


def test_settings_reach_the_library(tmp_path: Path) -> None:
    smoke()
    plain = scenes.render_combined(tmp_path)
    settings = bpy.context.scene.fumarole
    settings.shadowing_density = 5.0
    assert scenes.render_combined(tmp_path)[..., :3].sum() < 0.9 * plain[..., :3].sum()
    settings.shadowing_density = 1.0
    scenes.plane("Roof", location=(0, -1.5, 2), rotation=(50, 0, 0))
    blocked = scenes.render_combined(tmp_path)
    settings.solid_shadow_intensity = 0.0
    unblocked = scenes.render_combined(tmp_path)
    assert blocked[..., :3].sum() < 0.9 * unblocked[..., :3].sum()


def test_accuracy_is_in_the_metadata_the_status_and_the_panel(tmp_path: Path, capfd: pytest.CaptureFixture) -> None:
    from fumarole import engine, ui

    smoke()
    scenes.render_combined(tmp_path)
    stats = engine.last_stats()
    assert stats is not None and stats.accuracy_count > 100 and 0 < stats.accuracy_rms < 0.01
    metadata = read_metadata(tmp_path / "render.exr")
    prefix = f"fumarole.{bpy.context.view_layer.name}.transmittance"
    assert int(metadata[f"{prefix}_points"]) == stats.accuracy_count
    for name in ("rms", "p95", "worst", "bias"):
        assert float(metadata[f"{prefix}_{name}"]) == pytest.approx(getattr(stats, f"accuracy_{name}"), rel=0.01)
    if bpy.app.version < (5, 0, 0):  # later ones don't print the status
        assert engine.accuracy_text(stats) in printed(capfd)
    texts: list[str] = []

    class Layout:
        """Notes labels; whatever it is asked for is another layout."""

        def label(self, text: str) -> None:
            texts.append(text)

        def column(self) -> Layout:
            return self

        def split(self, factor: float) -> Layout:
            return self

    panel = type("Panel", (), {"layout": Layout(), "column": ui.FumarolePanel.column})()
    ui.FUMAROLE_PT_accuracy.draw(panel, bpy.context)
    assert f"{stats.accuracy_rms:.2g}" in texts and f"{stats.accuracy_worst:.2g}" in texts


def test_background_goes_under_the_smoke_unless_film_is_transparent(tmp_path: Path) -> None:
    smoke()
    unlit = scenes.render_combined(tmp_path)
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("World")
    scene.world.use_nodes = True
    background = next(node for node in scene.world.node_tree.nodes if node.bl_idname == "ShaderNodeBackground")
    background.inputs["Color"].default_value = (0.1, 0.2, 0.4, 1)
    background.inputs["Strength"].default_value = 2.0
    alone = scenes.render_combined(tmp_path)
    assert np.array_equal(alone[..., 3], unlit[..., 3])  # and its light is all that it adds
    assert alone[32, 32, 2] > 1.05 * unlit[32, 32, 2]
    scene.render.film_transparent = False
    pixels = scenes.render_combined(tmp_path)
    expected = alone[..., :3] + (1 - alone[..., 3:]) * np.array((0.2, 0.4, 0.8), dtype=np.float32)
    assert np.allclose(pixels[..., :3], expected, atol=1e-6)
    assert np.all(pixels[..., 3] == 1)


def test_depth_pass(tmp_path: Path) -> None:
    smoke()
    bpy.context.view_layer.use_pass_z = True
    channels = scenes.render_channels(tmp_path)
    depth = channels[f"{bpy.context.view_layer.name}.Depth.Z"]
    assert depth[0, 0] == CLIP_END
    assert np.allclose(depth[28:36, 28:36], 8, atol=0.3)


def test_passes_that_are_off_are_not_written(tmp_path: Path) -> None:
    smoke()
    assert not [name for name in scenes.render_channels(tmp_path) if "Depth" in name]


def test_border_crops_the_picture(tmp_path: Path) -> None:
    smoke()
    whole = scenes.render_combined(tmp_path)
    render = bpy.context.scene.render
    render.use_border = render.use_crop_to_border = True
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.25, 0.7, 0.3, 0.9
    part = scenes.render_combined(tmp_path)
    assert part.shape == (int(0.9 * 64) - int(0.3 * 64), int(0.7 * 64) - 16, 4)
    assert np.allclose(part, whole[19:57, 16:44], atol=1e-4)


def test_border_without_cropping_keeps_the_size(tmp_path: Path) -> None:
    smoke()
    whole = scenes.render_combined(tmp_path)
    render = bpy.context.scene.render
    render.use_border, render.use_crop_to_border = True, False
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.25, 0.75, 0.25, 0.75
    part = scenes.render_combined(tmp_path)
    assert part.shape == whole.shape
    assert np.allclose(part[16:48, 16:48], whole[16:48, 16:48], atol=1e-4)
    assert part[:16].max() == 0


def test_percentage(tmp_path: Path) -> None:
    smoke()
    whole = scenes.render_combined(tmp_path)
    bpy.context.scene.render.resolution_percentage = 51
    part = scenes.render_combined(tmp_path)
    assert part.shape == (32, 32, 4)
    assert np.allclose(part, whole.reshape(32, 2, 32, 2, 4).mean(axis=(1, 3)), atol=0.1)


def test_two_view_layers(tmp_path: Path) -> None:
    owner = smoke()
    scene = bpy.context.scene
    collection = bpy.data.collections.new("Smoke")
    scene.collection.children.link(collection)
    scene.collection.objects.unlink(owner)
    collection.objects.link(owner)
    empty = scene.view_layers.new("Empty")
    empty.layer_collection.children["Smoke"].exclude = True
    scene.view_layers.new("Unused").use = False
    empty.use_pass_z = True
    channels = scenes.render_channels(tmp_path)
    full = stack(channels, f"{scene.view_layers[0].name}.Combined", "RGBA")
    assert full[32, 32, 3] > 0.5
    assert stack(channels, "Empty.Combined", "RGBA").max() == 0
    depths = [name for name in channels if "Depth" in name]
    assert depths == ["Empty.Depth.Z"]


def test_stereo_views_see_the_smoke_from_two_places(tmp_path: Path) -> None:
    smoke()
    scene = bpy.context.scene
    scene.render.use_multiview = True
    scene.render.views_format = "STEREO_3D"
    stereo = scene.camera.data.stereo
    stereo.interocular_distance, stereo.convergence_distance = 0.2, 2.0
    scenes.exr_output(tmp_path / "stereo.exr", multilayer=True)
    scene.render.image_settings.views_format = "MULTIVIEW"
    bpy.ops.render.render(write_still=True)
    (path,) = tmp_path.glob("*.exr")
    channels = read_exr(path)
    left, right = (channels[f"{bpy.context.view_layer.name}.Combined.{view}.A"] for view in ("left", "right"))
    columns = np.arange(64)
    middles = [(alpha.sum(axis=0) * columns).sum() / alpha.sum() for alpha in (left, right)]
    pixels_a_radian = 64 * scene.camera.data.lens / scene.camera.data.sensor_width
    assert middles[1] - middles[0] == pytest.approx(0.2 * (1 / 2 - 1 / 8) * pixels_a_radian, abs=0.3)


def test_multiview_renders_each_camera(tmp_path: Path) -> None:
    smoke()
    scene = bpy.context.scene
    scene.render.use_multiview = True
    scene.render.views_format = "MULTIVIEW"
    for view in list(scene.render.views):
        view.use = False
    near = scene.render.views.new("near")
    near.camera_suffix = "_near"
    far = scene.render.views.new("far")
    far.camera_suffix = "_far"
    scene.camera.name = "Camera_near"
    other = scenes.link("Camera_far", scene.camera.data, location=(0, -16, 0), rotation=(90, 0, 0))
    assert other.name == "Camera_far"
    scenes.exr_output(tmp_path / "views.exr", multilayer=True)
    scene.render.image_settings.views_format = "MULTIVIEW"
    bpy.ops.render.render(write_still=True)
    (path,) = tmp_path.glob("*.exr")
    channels = read_exr(path)
    layer = bpy.context.view_layer.name
    seen = {name: (channels[f"{layer}.Combined.{name}.A"] > 0.1).sum() for name in ("near", "far")}
    assert seen["near"] > 2 * seen["far"] > 0


def test_multilayer_file_through_the_compositor(tmp_path: Path) -> None:
    smoke()
    scene = bpy.context.scene
    bpy.context.view_layer.use_pass_z = True
    if bpy.app.version >= (5, 0, 0):
        tree = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
        scene.compositing_node_group = tree
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        end = tree.nodes.new("NodeGroupOutput")
        writer = tree.nodes.new("CompositorNodeOutputFile")
        writer.directory, writer.file_name = str(tmp_path), "m_"
        writer.file_output_items.clear()
        writer.file_output_items.new("RGBA", "Smoke")
        writer.file_output_items.new("FLOAT", "Far")
        writer.format.media_type = "MULTI_LAYER_IMAGE"
        writer.format.use_exr_interleave = True
    else:
        scene.use_nodes = True
        tree = scene.node_tree
        tree.nodes.clear()
        end = tree.nodes.new("CompositorNodeComposite")
        writer = tree.nodes.new("CompositorNodeOutputFile")
        writer.base_path = str(tmp_path / "m_")
        writer.format.file_format = "OPEN_EXR_MULTILAYER"
        writer.layer_slots.clear()
        writer.layer_slots.new("Smoke")
        writer.layer_slots.new("Far")
    writer.format.exr_codec, writer.format.color_depth = "NONE", "32"
    layers = tree.nodes.new("CompositorNodeRLayers")
    layers.scene = scene
    tree.links.new(layers.outputs["Image"], end.inputs[0])
    tree.links.new(layers.outputs["Image"], writer.inputs[0])
    tree.links.new(layers.outputs["Depth"], writer.inputs[1])
    bpy.ops.render.render()
    (path,) = tmp_path.glob("m_*.exr")
    channels = read_exr(path)
    alpha = next(values for name, values in channels.items() if name.startswith("Smoke") and name.endswith("A"))
    depth = next(values for name, values in channels.items() if name.startswith("Far"))
    assert alpha[32, 32] > 0.5
    assert depth[0, 0] == CLIP_END and abs(depth[32, 32] - 8) < 0.3


def test_nothing_at_all_is_a_clear_picture_with_a_warning(tmp_path: Path, capfd: pytest.CaptureFixture) -> None:
    scenes.camera()
    bpy.context.scene.render.film_transparent = True
    assert scenes.render_combined(tmp_path).max() == 0
    assert "no smoke" in printed(capfd)


def test_no_lights_is_black_smoke_with_a_warning(tmp_path: Path, capfd: pytest.CaptureFixture) -> None:
    smoke()
    bpy.data.objects.remove(bpy.data.objects["Point"])
    pixels = scenes.render_combined(tmp_path)
    assert pixels[..., :3].max() == 0 and pixels[32, 32, 3] > 0.5
    assert "no lights" in printed(capfd)


def test_no_camera_is_an_error() -> None:
    scenes.emitter()
    with pytest.raises(RuntimeError, match="camera"):
        bpy.ops.render.render()


def test_solids_hide_the_smoke_behind_them(tmp_path: Path) -> None:
    smoke()
    scenes.plane("Wall", size=20, location=(0, -4, -10), rotation=(90, 0, 0))
    pixels = scenes.render_combined(tmp_path)
    assert pixels[:28, :, 3].max() == 0
    assert pixels[36, 32, 3] > 0.5


def test_point_clouds_are_drawn(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    owner = scenes.points_by_nodes("Cloud", random.normal(0, 0.3, (300, 3)).tolist(), radius=0.2)
    scenes.set_point_material(owner, scenes.material("Smoke", Density=8.0))
    scenes.light("POINT", location=(0, -3, 4))
    scenes.camera()
    bpy.context.scene.render.film_transparent = True
    pixels = scenes.render_combined(tmp_path)
    assert pixels[32, 32, 3] > 0.5 and pixels[32, 32, 0] > 0


def test_unicode_names_and_path(tmp_path: Path) -> None:
    owner = smoke()
    owner.name = "煙の源 🌋"
    owner.particle_systems[0].name = "Дым"
    folder = tmp_path / "café 煙"
    folder.mkdir()
    assert scenes.render_combined(folder)[32, 32, 3] > 0.5


def test_linked_library(scene: bpy.types.Scene, tmp_path: Path) -> None:
    smoke()
    scenes.bake()
    scene.frame_set(5)
    expected = scenes.render_combined(tmp_path)
    collection = bpy.data.collections.new("Effects")
    for owner in list(scene.collection.objects):
        scene.collection.objects.unlink(owner)
        collection.objects.link(owner)
    collection.use_fake_user = True
    library = tmp_path / "library.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(library))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    with bpy.data.libraries.load(str(library), link=True) as (_source, target):
        target.collections = ["Effects"]
    scene.collection.children.link(bpy.data.collections["Effects"])
    scene.camera = bpy.data.objects["Camera"]
    scene.render.engine = "FUMAROLE"
    scene.render.resolution_x = scene.render.resolution_y = 64
    scene.render.film_transparent = True
    scene.frame_set(5)
    assert np.array_equal(scenes.render_combined(tmp_path), expected)


def test_warnings_are_reported_once_an_animation(
    scene: bpy.types.Scene, tmp_path: Path, capfd: pytest.CaptureFixture
) -> None:
    smoke()
    bpy.context.view_layer.material_override = bpy.data.materials.new("Clay")
    scene.frame_end = 3
    scene.render.filepath = str(tmp_path / "frame_")
    bpy.ops.render.render(animation=True)
    assert len(list(tmp_path.glob("frame_*.png"))) == 3
    assert printed(capfd).count("material_override") == 1
    bpy.ops.render.render()
    assert printed(capfd).count("material_override") == 1


def test_an_error_of_the_engine_leaves_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    smoke()

    def fail(*_arguments: object, **_keywords: object) -> None:
        raise ValueError("something broke")

    monkeypatch.setattr(core, "render", fail)
    scenes.exr_output(tmp_path / "render.exr", multilayer=True)
    with pytest.raises(RuntimeError, match="something broke"):
        bpy.ops.render.render(write_still=True)
    assert not list(tmp_path.iterdir())
    monkeypatch.undo()
    assert scenes.render_combined(tmp_path)[32, 32, 3] > 0.5


def test_an_error_of_the_export_fails_the_render(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from fumarole import engine

    smoke()

    def fail(*_arguments: object) -> None:
        raise core.FumaroleError(core.ErrorCode.ARGUMENT, "'Emitter' is wrong")

    monkeypatch.setattr(engine, "export_scene", fail)
    scenes.exr_output(tmp_path / "render.exr", multilayer=True)
    with pytest.raises(RuntimeError, match="'Emitter' is wrong"):
        bpy.ops.render.render(write_still=True)
    assert not list(tmp_path.iterdir())


def test_bad_mesh_is_an_error_that_names_it(tmp_path: Path) -> None:
    smoke()
    wall = scenes.plane("Crooked wall")
    wall.data.vertices[2].co.x = float("nan")
    scenes.exr_output(tmp_path / "render.exr", multilayer=True)
    with pytest.raises(RuntimeError, match="'Crooked wall'.*vertex 2"):
        bpy.ops.render.render(write_still=True)
    assert not list(tmp_path.iterdir())


def test_bad_points_are_dropped_counted_and_named(tmp_path: Path, capfd: pytest.CaptureFixture) -> None:
    places = [(0, 0, 0), (float("nan"), 0, 0), (0, 0, 0.3)]
    owner = scenes.points_by_nodes("Cloud", places, radius=0.5)
    scenes.set_point_material(owner, scenes.material("Smoke", Density=8.0))
    scenes.camera()
    bpy.context.scene.render.film_transparent = True
    pixels = scenes.render_combined(tmp_path)
    assert np.isfinite(pixels).all() and pixels[32, 32, 3] > 0.3
    (line,) = [line for line in printed(capfd).splitlines() if "'Cloud'" in line and "WARNING" in line.upper()]
    assert "1" in line
