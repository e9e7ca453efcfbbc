# SPDX-License-Identifier: GPL-3.0-or-later
"""The C interface as ctypes sees it. Written by scripts/abi.py from csrc/include/fumarole.h; do not edit."""

import ctypes

FUM_VERSION_MAJOR = 0
FUM_VERSION_MINOR = 1
FUM_VERSION_PATCH = 0
FUM_OK = 0
FUM_ERROR_ARGUMENT = 1
FUM_ERROR_MEMORY = 2
FUM_ERROR_CANCELLED = 3
FUM_ERROR_DEVICE = 4
FUM_ERROR_LIBRARY = 5
FUM_ERROR_FILE = 6
FUM_STAGE_OCTREE = 0
FUM_STAGE_LIGHTING = 1
FUM_STAGE_SORTING = 2
FUM_STAGE_DRAWING = 3
FUM_STAGE_PASSES = 4
FUM_LIGHT_POINT = 0
FUM_LIGHT_SPOT = 1
FUM_LIGHT_SUN = 2
FUM_LIGHT_AREA = 3
FUM_LIGHT_ENVIRONMENT = 4
FUM_AREA_RECTANGLE = 0
FUM_AREA_ELLIPSE = 1
FUM_CAMERA_PERSPECTIVE = 0
FUM_CAMERA_ORTHOGRAPHIC = 1
FUM_SOLVER_AUTOMATIC = 0
FUM_SOLVER_EXACT = 1
FUM_SOLVER_SWEEP = 2
FUM_DEVICE_AUTO = 0
FUM_DEVICE_GL = 1
FUM_DEVICE_TILES = 2
FUM_SOLIDS_HOLDOUT = 0
FUM_SOLIDS_SHADED = 1
FUM_PASS_COMBINED = 0
FUM_PASS_DEPTH = 1
FUM_PASS_POSITION = 2
FUM_PASS_EMISSION = 3
FUM_PASS_SHADOW = 4
FUM_PASS_LIGHT = 5
FUM_PASS_LIGHT_SHADOW = 6
FUM_PASS_OPACITY = 7
FUM_PASS_DEPTH_FRONT = 8
FUM_PASS_DEPTH_BACK = 9
FUM_PASS_ALBEDO = 10
FUM_PASS_VECTOR = 11
FUM_PASS_SOLID_SHADOW = 12
FUM_PASS_LIGHT_SOLID_SHADOW = 13
FUM_PASS_ERROR = 14
FUM_PASS_CRYPTO_OBJECT = 15
FUM_PASS_HOLDOUT = 16
FUM_LINK_SETS = 64
FUM_PER_PICTURE = 0
FUM_PER_LIGHT = 1
FUM_PER_RANKS = 2
FUM_MAX_RANK_PAIRS = 8
FUM_VISIBLE_TO_SHADOW = 1
FUM_VISIBLE_TO_CAMERA = 2


class fum_context(ctypes.Structure):
    """Opaque."""


class fum_scene(ctypes.Structure):
    """Opaque."""


class fum_abi_field(ctypes.Structure):
    _fields_ = [
        ("struct_name", ctypes.c_char_p),
        ("field_name", ctypes.c_char_p),
        ("offset", ctypes.c_uint32),
        ("size", ctypes.c_uint32),
    ]


fum_progress_fn = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_int32, ctypes.c_float, ctypes.c_char_p)


class fum_particles_desc(ctypes.Structure):
    _fields_ = [
        ("struct_size", ctypes.c_uint32),
        ("anisotropy", ctypes.c_float),
        ("name", ctypes.c_char_p),
        ("count", ctypes.c_int64),
        ("positions", ctypes.POINTER(ctypes.c_float)),
        ("radii", ctypes.POINTER(ctypes.c_float)),
        ("densities", ctypes.POINTER(ctypes.c_float)),
        ("albedos", ctypes.POINTER(ctypes.c_float)),
        ("emissions", ctypes.POINTER(ctypes.c_float)),
        ("velocities", ctypes.POINTER(ctypes.c_float)),
        ("ids", ctypes.POINTER(ctypes.c_uint64)),
        ("radius", ctypes.c_float),
        ("density", ctypes.c_float),
        ("albedo", ctypes.c_float * 3),
        ("emission", ctypes.c_float * 3),
        ("light_set", ctypes.c_int32),
        ("shadow_set", ctypes.c_int32),
        ("visible_to_camera", ctypes.c_int32),
        ("extinction_colors", ctypes.POINTER(ctypes.c_float)),
        ("extinction_color", ctypes.c_float * 3),
        ("matte_name", ctypes.c_char_p),
        ("map", ctypes.POINTER(ctypes.c_float)),
        ("map_width", ctypes.c_int32),
        ("map_height", ctypes.c_int32),
    ]


class fum_mesh_desc(ctypes.Structure):
    _fields_ = [
        ("struct_size", ctypes.c_uint32),
        ("visibility", ctypes.c_uint32),
        ("name", ctypes.c_char_p),
        ("vertex_count", ctypes.c_int64),
        ("triangle_count", ctypes.c_int64),
        ("vertices", ctypes.POINTER(ctypes.c_float)),
        ("triangles", ctypes.POINTER(ctypes.c_uint32)),
        ("world_from_local", ctypes.c_double * 16),
        ("light_set", ctypes.c_int32),
        ("shadow_set", ctypes.c_int32),
        ("albedo", ctypes.c_float * 3),
        ("emission", ctypes.c_float * 3),
        ("is_holdout", ctypes.c_int32),
        ("normals", ctypes.POINTER(ctypes.c_float)),
    ]


class fum_light_desc(ctypes.Structure):
    _fields_ = [
        ("struct_size", ctypes.c_uint32),
        ("type", ctypes.c_int32),
        ("name", ctypes.c_char_p),
        ("world_from_light", ctypes.c_double * 16),
        ("intensity", ctypes.c_float * 3),
        ("radius", ctypes.c_float),
        ("sun_angle", ctypes.c_float),
        ("spot_angle", ctypes.c_float),
        ("spot_blend", ctypes.c_float),
        ("spot_cosine", ctypes.c_int32),
        ("area_shape", ctypes.c_int32),
        ("area_size", ctypes.c_float * 2),
        ("area_spread", ctypes.c_float),
        ("casts_shadows", ctypes.c_int32),
        ("light_sets", ctypes.c_uint64),
        ("shadow_sets", ctypes.c_uint64),
        ("environment_pixels", ctypes.POINTER(ctypes.c_float)),
        ("environment_width", ctypes.c_int32),
        ("environment_height", ctypes.c_int32),
    ]


class fum_settings(ctypes.Structure):
    _fields_ = [
        ("struct_size", ctypes.c_uint32),
        ("solver", ctypes.c_int32),
        ("device", ctypes.c_int32),
        ("leaf_size", ctypes.c_int32),
        ("light_samples", ctypes.c_int32),
        ("tolerance", ctypes.c_float),
        ("shadowing_density", ctypes.c_float),
        ("solid_shadow_intensity", ctypes.c_float),
        ("subsampling", ctypes.c_float),
        ("intersection_scale", ctypes.c_float),
        ("solids", ctypes.c_int32),
    ]


class fum_camera(ctypes.Structure):
    _fields_ = [
        ("struct_size", ctypes.c_uint32),
        ("type", ctypes.c_int32),
        ("world_from_camera", ctypes.c_double * 16),
        ("window", ctypes.c_double * 4),
        ("clip_start", ctypes.c_double),
        ("clip_end", ctypes.c_double),
        ("width", ctypes.c_int32),
        ("height", ctypes.c_int32),
        ("moves", ctypes.c_int32),
        ("previous_world_from_camera", ctypes.c_double * 16),
        ("previous_window", ctypes.c_double * 4),
        ("next_world_from_camera", ctypes.c_double * 16),
        ("next_window", ctypes.c_double * 4),
        ("shutter_open", ctypes.c_double),
        ("shutter_close", ctypes.c_double),
        ("aperture_radius", ctypes.c_double),
        ("focus_distance", ctypes.c_double),
        ("aperture_blades", ctypes.c_int32),
        ("aperture_rotation", ctypes.c_float),
        ("aperture_ratio", ctypes.c_float),
    ]


class fum_pass_info(ctypes.Structure):
    _fields_ = [
        ("pass", ctypes.c_int32),
        ("channel_count", ctypes.c_int32),
        ("name", ctypes.c_char_p),
        ("channels", ctypes.c_char_p),
        ("kind", ctypes.c_char_p),
        ("description", ctypes.c_char_p),
        ("per", ctypes.c_int32),
    ]


class fum_pass_buffer(ctypes.Structure):
    _fields_ = [
        ("pass", ctypes.c_int32),
        ("number", ctypes.c_int32),
        ("pixels", ctypes.POINTER(ctypes.c_float)),
        ("pixels_size", ctypes.c_int64),
    ]


class fum_render_stats(ctypes.Structure):
    _fields_ = [
        ("struct_size", ctypes.c_uint32),
        ("light_count", ctypes.c_int32),
        ("light_sample_count", ctypes.c_int32),
        ("solver", ctypes.c_int32),
        ("particle_count", ctypes.c_int64),
        ("drawn_count", ctypes.c_int64),
        ("triangle_count", ctypes.c_int64),
        ("memory_bytes", ctypes.c_uint64),
        ("build_s", ctypes.c_double),
        ("light_s", ctypes.c_double),
        ("sort_s", ctypes.c_double),
        ("draw_s", ctypes.c_double),
        ("passes_s", ctypes.c_double),
        ("total_s", ctypes.c_double),
        ("device", ctypes.c_char * 128),
        ("light_points", ctypes.c_int64),
        ("slab_count", ctypes.c_int64),
        ("refinement_count", ctypes.c_int64),
        ("accuracy_count", ctypes.c_int64),
        ("accuracy_rms", ctypes.c_double),
        ("accuracy_p95", ctypes.c_double),
        ("accuracy_worst", ctypes.c_double),
        ("accuracy_bias", ctypes.c_double),
        ("meter_s", ctypes.c_double),
    ]


class fum_deep_sample(ctypes.Structure):
    _fields_ = [
        ("rgba", ctypes.c_float * 4),
        ("depth", ctypes.c_float),
        ("depth_back", ctypes.c_float),
    ]


class fum_deep(ctypes.Structure):
    """Opaque."""


class fum_reference_settings(ctypes.Structure):
    _fields_ = [
        ("struct_size", ctypes.c_uint32),
        ("light_samples", ctypes.c_int32),
        ("tolerance", ctypes.c_double),
        ("solids", ctypes.c_int32),
    ]


class fum_reference_stats(ctypes.Structure):
    _fields_ = [
        ("struct_size", ctypes.c_uint32),
        ("light_sample_count", ctypes.c_int32),
        ("particle_count", ctypes.c_int64),
        ("step_count", ctypes.c_int64),
        ("unconverged_count", ctypes.c_int64),
        ("error", ctypes.c_double),
        ("total_s", ctypes.c_double),
    ]


class fum_image_layer(ctypes.Structure):
    _fields_ = [
        ("name", ctypes.c_char_p),
        ("channels", ctypes.c_char_p),
        ("pixels", ctypes.POINTER(ctypes.c_float)),
    ]


class fum_frame_part(ctypes.Structure):
    _fields_ = [
        ("frame_width", ctypes.c_int32),
        ("frame_height", ctypes.c_int32),
        ("left", ctypes.c_int32),
        ("bottom", ctypes.c_int32),
    ]


STRUCTS = (
    fum_abi_field,
    fum_particles_desc,
    fum_mesh_desc,
    fum_light_desc,
    fum_settings,
    fum_camera,
    fum_pass_info,
    fum_pass_buffer,
    fum_render_stats,
    fum_deep_sample,
    fum_reference_settings,
    fum_reference_stats,
    fum_image_layer,
    fum_frame_part,
)

# name: (result, parameters)
FUNCTIONS = {
    "fum_version": (ctypes.c_char_p, []),
    "fum_build_info": (ctypes.c_char_p, []),
    "fum_abi_fields": (ctypes.c_int32, [ctypes.POINTER(ctypes.POINTER(fum_abi_field))]),
    "fum_context_create": (ctypes.c_int32, [ctypes.POINTER(ctypes.POINTER(fum_context))]),
    "fum_context_destroy": (None, [ctypes.POINTER(fum_context)]),
    "fum_context_set_threads": (ctypes.c_int32, [ctypes.POINTER(fum_context), ctypes.c_int32]),
    "fum_context_set_progress": (None, [ctypes.POINTER(fum_context), fum_progress_fn, ctypes.c_void_p]),
    "fum_last_error": (ctypes.c_char_p, [ctypes.POINTER(fum_context)]),
    "fum_warning_count": (ctypes.c_int32, [ctypes.POINTER(fum_context)]),
    "fum_warning": (ctypes.c_char_p, [ctypes.POINTER(fum_context), ctypes.c_int32]),
    "fum_warnings_clear": (None, [ctypes.POINTER(fum_context)]),
    "fum_scene_create": (ctypes.c_int32, [ctypes.POINTER(fum_context), ctypes.POINTER(ctypes.POINTER(fum_scene))]),
    "fum_scene_destroy": (None, [ctypes.POINTER(fum_scene)]),
    "fum_particles_desc_init": (None, [ctypes.POINTER(fum_particles_desc)]),
    "fum_scene_add_particles": (ctypes.c_int32, [ctypes.POINTER(fum_scene), ctypes.POINTER(fum_particles_desc)]),
    "fum_mesh_desc_init": (None, [ctypes.POINTER(fum_mesh_desc)]),
    "fum_scene_add_mesh": (ctypes.c_int32, [ctypes.POINTER(fum_scene), ctypes.POINTER(fum_mesh_desc)]),
    "fum_light_desc_init": (None, [ctypes.POINTER(fum_light_desc)]),
    "fum_scene_add_light": (ctypes.c_int32, [ctypes.POINTER(fum_scene), ctypes.POINTER(fum_light_desc)]),
    "fum_scene_clear_lights": (None, [ctypes.POINTER(fum_scene)]),
    "fum_settings_init": (None, [ctypes.POINTER(fum_settings)]),
    "fum_camera_init": (None, [ctypes.POINTER(fum_camera)]),
    "fum_pass_get": (ctypes.c_int32, [ctypes.c_int32, ctypes.POINTER(fum_pass_info)]),
    "fum_render_stats_init": (None, [ctypes.POINTER(fum_render_stats)]),
    "fum_render": (ctypes.c_int32, [ctypes.POINTER(fum_scene), ctypes.POINTER(fum_camera), ctypes.POINTER(fum_settings), ctypes.c_int32, ctypes.POINTER(fum_pass_buffer), ctypes.POINTER(fum_render_stats)]),
    "fum_blur_measure": (ctypes.c_int32, [ctypes.POINTER(fum_scene), ctypes.POINTER(fum_camera), ctypes.POINTER(fum_settings), ctypes.POINTER(ctypes.c_double), ctypes.POINTER(ctypes.c_int32)]),
    "fum_render_deep": (ctypes.c_int32, [ctypes.POINTER(fum_scene), ctypes.POINTER(fum_camera), ctypes.POINTER(fum_settings), ctypes.c_int32, ctypes.POINTER(fum_pass_buffer), ctypes.POINTER(ctypes.POINTER(fum_deep)), ctypes.POINTER(fum_render_stats)]),
    "fum_deep_samples": (ctypes.c_int64, [ctypes.POINTER(fum_deep), ctypes.POINTER(ctypes.POINTER(ctypes.c_uint32)), ctypes.POINTER(ctypes.POINTER(fum_deep_sample))]),
    "fum_deep_destroy": (None, [ctypes.POINTER(fum_deep)]),
    "fum_scene_transmittance": (ctypes.c_int32, [ctypes.POINTER(fum_scene), ctypes.POINTER(fum_settings), ctypes.c_int32, ctypes.c_int64, ctypes.POINTER(ctypes.c_float), ctypes.POINTER(ctypes.c_float)]),
    "fum_scene_irradiance": (ctypes.c_int32, [ctypes.POINTER(fum_scene), ctypes.POINTER(fum_settings), ctypes.c_int32, ctypes.c_int64, ctypes.POINTER(ctypes.c_float), ctypes.POINTER(ctypes.c_float), ctypes.POINTER(ctypes.c_float)]),
    "fum_crypto_hash": (ctypes.c_uint32, [ctypes.c_char_p]),
    "fum_reference_settings_init": (None, [ctypes.POINTER(fum_reference_settings)]),
    "fum_reference_stats_init": (None, [ctypes.POINTER(fum_reference_stats)]),
    "fum_reference_render": (ctypes.c_int32, [ctypes.POINTER(fum_scene), ctypes.POINTER(fum_camera), ctypes.POINTER(fum_reference_settings), ctypes.POINTER(ctypes.c_double), ctypes.c_int64, ctypes.POINTER(ctypes.c_double), ctypes.c_int64, ctypes.POINTER(fum_reference_stats)]),
    "fum_exr_write": (ctypes.c_int32, [ctypes.POINTER(fum_context), ctypes.c_char_p, ctypes.c_int32, ctypes.c_int32, ctypes.c_int32, ctypes.POINTER(fum_image_layer)]),
    "fum_deep_write": (ctypes.c_int32, [ctypes.POINTER(fum_deep), ctypes.c_char_p, ctypes.POINTER(fum_frame_part)]),
}


def choices(prefix: str) -> dict[str, int]:
    """Constants whose name starts with `prefix`, by the rest of their name: choices("FUM_SOLVER_")["EXACT"]."""
    return {name[len(prefix) :]: value for name, value in globals().items() if name.startswith(prefix)}
