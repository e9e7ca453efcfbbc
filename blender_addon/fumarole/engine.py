# SPDX-License-Identifier: GPL-3.0-or-later
"""The render engine: export, render, hand over, and what the user is told meanwhile."""

from __future__ import annotations

import contextlib
import os
import traceback
from collections.abc import Iterator

import bpy
import numpy as np

from . import compat, core, deep
from .export.camera import border, resolution
from .export.scene import Scene, export_scene
from .kept import Keeper
from .passes import crypto_fields, enabled, warnings as pass_warnings
from .picture import Picture, Progress
from .shots import CoreScenes, Timeline

# Warnings the user has seen in this render or animation.
_reported: set[str] = set()

_last_stats: core.Stats | None = None


# What Blender's persistent data keeps; there is none while the add-on is disabled.
_keeper: Keeper | None = None


def last_stats() -> core.Stats | None:
    """What the last render did, None before the first one."""
    return _last_stats


def accuracy_text(stats: core.Stats) -> str:
    """The measured errors of the light in a few words; T is the transmittance to a light."""
    rms, p95, worst, bias = stats.accuracy_rms, stats.accuracy_p95, stats.accuracy_worst, stats.accuracy_bias
    return f"T within {rms:.1g} rms, 95 % within {p95:.1g}, {worst:.1g} worst, bias {bias:+.1g}"


@bpy.app.handlers.persistent
def _forget_warnings(*_arguments: object) -> None:
    _reported.clear()


@bpy.app.handlers.persistent
def _forget_scene(*_arguments: object) -> None:
    if _keeper is not None:
        _keeper.clear()


class FumaroleEngine(bpy.types.RenderEngine):
    """Renders the smoke of a view layer. A failure is an ERROR report, which is all that makes Blender fail."""

    bl_idname = "FUMAROLE"
    bl_label = "Fumarole"
    bl_use_eevee_viewport = True

    def __init__(self, *arguments: object, **keywords: object) -> None:
        super().__init__(*arguments, **keywords)
        self._scene: Scene | None = None
        self._deep_files: dict[str, list[str]] = {}  # that this frame has written, by view layer

    def update(self, data: bpy.types.BlendData | None = None, depsgraph: bpy.types.Depsgraph | None = None) -> None:
        """Exports the depsgraph, while Blender keeps it from changing."""
        self._scene = None
        layer = depsgraph.view_layer_eval.name
        if layer in self._deep_files:  # another frame: persistent data keeps engines
            self._deep_files = {}
        self._deep_files[layer] = []
        with self._reporting():
            self.update_stats("", "Reading the scene")
            self._scene = export_scene(depsgraph)
            self._warn(self._scene.warnings)

    def render(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Renders what update() exported, all views of the depsgraph's view layer."""
        scene, self._scene = self._scene, None
        if scene is None:
            return
        with self._reporting():
            render = depsgraph.scene.render
            threads = render.threads if render.threads_mode == "FIXED" else 0
            is_moving = compat.motion_blur(depsgraph.scene, depsgraph.view_layer_eval)
            with _keeping(render.use_persistent_data, is_moving) as keeper, CoreScenes(threads, keeper) as core_scenes:
                views = _views(render)
                for index, view in enumerate(views):
                    self._render_view(depsgraph, core_scenes, scene, view, self._progress(index, len(views)))

    def update_render_passes(
        self, scene: bpy.types.Scene | None = None, renderlayer: bpy.types.ViewLayer | None = None
    ) -> None:
        """Tells the compositor which passes there will be."""
        for layer_pass in enabled(renderlayer, scene.world):
            item = layer_pass.item
            self.register_pass(scene, renderlayer, layer_pass.name, len(item.channels), item.channels, item.kind)

    def _render_view(
        self,
        depsgraph: bpy.types.Depsgraph,
        core_scenes: CoreScenes,
        scene: Scene,
        view: str,
        progress: Progress,
    ) -> None:
        layer_name = depsgraph.view_layer_eval.name
        pixels: dict[str, np.ndarray] = {}
        size = _size(depsgraph.scene.render)
        try:
            self.active_view_set(view)
            passes = enabled(depsgraph.view_layer_eval, depsgraph.scene.world)
            deep_path = None if self.is_preview else deep.wanted_path(depsgraph, view, self.is_animation)
            settings = depsgraph.scene.fumarole
            with Timeline(self, depsgraph, scene) as timeline:
                picture = Picture(
                    timeline,
                    core_scenes,
                    passes,
                    settings.to_core(),
                    settings.blur_samples,
                    is_opaque=not depsgraph.scene.render.film_transparent,
                    has_deep=deep_path is not None,
                    progress=progress,
                )
                result, exposure = picture.draw()
            if deep_path is not None and exposure.is_blurred:
                scene.warn("Deep EXR: the file is without motion blur and depth of field")
            self._warn([*scene.warnings, *result.warnings, *pass_warnings(passes, scene.lights)])
            samples = result.samples if exposure.is_blurred else 0
            self._tell_statistics(result.stats, samples)
            global _last_stats
            _last_stats = result.stats
            if deep_path is not None:
                with result.deep as in_depth:
                    deep.write(in_depth, deep_path, depsgraph.scene.render)
                self._deep_files[layer_name].append(deep_path)
            pixels = dict(result)
        finally:
            self._hand_over(layer_name, view, size, pixels)
        prefix = ".".join(filter(None, ("fumarole", layer_name, view)))
        self._stamp(prefix, result.stats, samples, crypto_fields(depsgraph.view_layer_eval, scene))

    def _hand_over(self, layer: str, view: str, size: tuple[int, int], pixels: dict[str, np.ndarray]) -> None:
        """Gives Blender the passes. It needs a result even if there are none: without one some of its writers crash."""
        result = self.begin_result(0, 0, *size, layer=layer, view=view)
        try:
            for name, values in pixels.items():
                compat.set_pass_pixels(result.layers[0].passes.find_by_name(name, view), values)
        finally:
            self.end_result(result, cancel=not pixels)

    def _stamp(self, prefix: str, stats: core.Stats, blur_samples: int, fields: dict[str, str]) -> None:
        """Writes metadata of the picture: `fields`, `prefix`.blur_samples if there are any, and the measured accuracy as
        `prefix`.transmittance_rms and so on."""
        rendered = self.get_result()
        if rendered is None:
            return
        for name, value in fields.items():
            rendered.stamp_data_add_field(name, value)
        if blur_samples:
            rendered.stamp_data_add_field(f"{prefix}.blur_samples", str(blur_samples))
        if stats.accuracy_count == 0:
            return
        rendered.stamp_data_add_field(f"{prefix}.transmittance_points", str(stats.accuracy_count))
        for name in ("rms", "p95", "worst", "bias"):
            value = getattr(stats, f"accuracy_{name}")
            rendered.stamp_data_add_field(f"{prefix}.transmittance_{name}", f"{value:.3g}")

    @contextlib.contextmanager
    def _reporting(self) -> Iterator[None]:
        """Turns exceptions into reports. Of cancelling Blender knows, unless an interrupt came as an exception."""
        try:
            with self._withdrawing():
                yield
        except core.Cancelled:
            pass
        except core.FumaroleError as error:
            self.report({"ERROR"}, f"Fumarole: {error}")
        except KeyboardInterrupt:
            self.report({"ERROR"}, "Fumarole: the render was interrupted")
        except Exception as error:
            traceback.print_exc()
            self.report({"ERROR"}, f"Fumarole: internal error, please report it: {type(error).__name__}: {error}")

    @contextlib.contextmanager
    def _withdrawing(self) -> Iterator[None]:
        """Removes the deep files of a frame that fails, as Blender saves no picture of it."""
        try:
            yield
        except BaseException:
            for path in [path for paths in self._deep_files.values() for path in paths]:
                with contextlib.suppress(OSError):
                    os.remove(path)
            raise

    def _progress(self, view: int, view_count: int) -> Progress:
        told = ""

        def tell(fraction: float, text: str) -> bool:
            nonlocal told
            self.update_progress((view + fraction) / view_count)
            if text and text != told:
                self.update_stats("", text)
                told = text
            return self.test_break()

        return Progress(tell)

    def _tell_statistics(self, stats: core.Stats, blur_samples: int) -> None:
        mebibytes = stats.memory_bytes / 2**20
        self.update_memory_stats(memory_used=mebibytes, memory_peak=mebibytes)
        self.update_stats(
            "",
            f"{stats.particle_count:,} particles, {stats.light_count} lights, {mebibytes:,.0f} MiB, "
            f"lighting {stats.light_s:.2f} s, drawing {stats.draw_s:.2f} s on {stats.device or 'nothing'}"
            + (f", {blur_samples} blur samples" if blur_samples else "")
            + (f", {accuracy_text(stats)}" if stats.accuracy_count else ""),
        )

    def _warn(self, warnings: list[str]) -> None:
        for text in warnings:
            if text not in _reported:
                _reported.add(text)
                self.report({"WARNING"}, f"Fumarole: {text}")


@contextlib.contextmanager
def _keeping(is_persistent: bool, is_moving: bool) -> Iterator[Keeper | None]:
    """What keeps core scenes: that of persistent data, or one for a render that may need several; None: nothing does."""
    if is_persistent and _keeper is not None:
        yield _keeper
        return
    _forget_scene()
    own = Keeper() if is_moving else None
    try:
        yield own
    finally:
        if own is not None:
            own.close()


def _views(render: bpy.types.RenderSettings) -> list[str]:
    """Names of the views to render, "" where there is one only."""
    if not render.use_multiview:
        return [""]
    views = render.stereo_views if render.views_format == "STEREO_3D" else render.views
    return [view.name for view in views if view.use]


def _size(render: bpy.types.RenderSettings) -> tuple[int, int]:
    """Width and height of the rendered part of the picture in pixels."""
    width, height = resolution(render)
    if not render.use_border:
        return width, height
    x0, y0, x1, y1 = border(render, width, height)
    return x1 - x0, y1 - y0


def register() -> None:
    global _keeper
    bpy.utils.register_class(FumaroleEngine)
    _keeper = Keeper()
    bpy.app.handlers.render_init.append(_forget_warnings)
    bpy.app.handlers.load_pre.append(_forget_scene)


def unregister() -> None:
    global _keeper
    bpy.app.handlers.load_pre.remove(_forget_scene)
    bpy.app.handlers.render_init.remove(_forget_warnings)
    if _keeper is not None:
        _keeper.close()
    _keeper = None
    bpy.utils.unregister_class(FumaroleEngine)
