/* SPDX-License-Identifier: GPL-3.0-or-later */
/**
 * Fumarole: smoke made of particles, lit through a density octree and drawn as sorted billboards.
 *
 * A session goes one way:
 *
 *     fum_context_create      errors, warnings, threads, progress
 *     fum_scene_create        then fum_scene_add_particles, _add_mesh, _add_light
 *     fum_render              one camera; any number of passes; call again for other cameras
 *                             (fum_render_deep: and samples in depth for compositing, to be destroyed by the caller)
 *     fum_scene_destroy, fum_context_destroy
 *
 * Conventions
 * - Every call that can fail returns FUM_OK (0) or a FUM_ERROR_ code. fum_last_error() then holds a sentence for a
 *   person that names the object and the value that was wrong. Outputs are untouched on failure.
 * - Structs start with `struct_size`; fill them with their `_init` function, which sets it and every default.
 *   Fields are only ever appended, so a caller built against an older header keeps working.
 * - The unit of length is the metre (Blender's world unit), angles are radians, colours are linear RGB.
 * - Matrices are row-major, m[4 * row + column], and act on column vectors: world = m * local.
 * - Pictures have their first row at the bottom, as in Blender. Pixels are float, channels interleaved.
 * - A particle is a Gaussian: peak extinction `density` (1/m) at its centre and sigma = radius / 2. Particles add up:
 *   extinction K(x) = sum_i density_i exp(-|x - c_i|^2 / (2 sigma_i^2)), for red, green and blue each times a factor
 *   of the particle's extinction colour, so that smoke tints the light that passes it.
 * - Arrays in descriptions are copied before the call returns.
 * - A context and its scenes belong to one thread at a time. Different contexts are independent.
 * - The same scene gives the same bits, whatever the number of threads.
 * - The library never prints, exits or asserts.
 */
#ifndef FUMAROLE_H
#define FUMAROLE_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#if defined(__GNUC__)
#define FUM_API __attribute__((visibility("default")))
#else
#define FUM_API
#endif

#define FUM_VERSION_MAJOR 0
#define FUM_VERSION_MINOR 1
#define FUM_VERSION_PATCH 0

/** Status of a call. */
enum {
  FUM_OK = 0,
  FUM_ERROR_ARGUMENT = 1,  /**< A value out of range, a null pointer, a wrong struct_size. */
  FUM_ERROR_MEMORY = 2,    /**< Not enough memory; the message says how much was needed. */
  FUM_ERROR_CANCELLED = 3, /**< The progress callback returned nonzero. */
  FUM_ERROR_DEVICE = 4,    /**< No usable OpenGL; the message says what to install. */
  FUM_ERROR_LIBRARY = 5,   /**< Embree or OpenEXR failed, or is not the one this library was built for. */
  FUM_ERROR_FILE = 6       /**< A file could not be written. */
};

/** Stage of a render, for progress. */
enum {
  FUM_STAGE_OCTREE = 0,
  FUM_STAGE_LIGHTING = 1,
  FUM_STAGE_SORTING = 2,
  FUM_STAGE_DRAWING = 3,
  FUM_STAGE_PASSES = 4
};

enum {
  FUM_LIGHT_POINT = 0,
  FUM_LIGHT_SPOT = 1,
  FUM_LIGHT_SUN = 2,
  FUM_LIGHT_AREA = 3,
  FUM_LIGHT_ENVIRONMENT = 4 /**< shines from all around: a colour, or a picture of the surroundings */
};

enum { FUM_AREA_RECTANGLE = 0, FUM_AREA_ELLIPSE = 1 };

enum { FUM_CAMERA_PERSPECTIVE = 0, FUM_CAMERA_ORTHOGRAPHIC = 1 };

/**
 * How the optical depth to the lights is computed. Exact sums the closed form of all particles that can be heard from a
 * ray. Sweep adds them to a grid over the light's view, in time that grows with their number alone, and sums exactly
 * those that are large as seen from the light; what it can't do is solved exactly. Automatic takes what it predicts to
 * be faster, sweep only for a tolerance of 0.005 or more, and exact where the meter then finds that the tolerance is
 * missed.
 */
enum { FUM_SOLVER_AUTOMATIC = 0, FUM_SOLVER_EXACT = 1, FUM_SOLVER_SWEEP = 2 };

/**
 * What draws the particles. Tiles: in C; light is known everywhere, inside particles too, and overlapping particles are
 * integrated together. GL: OpenGL, every particle lit at its centre and blended as a whole, as in the paper. Automatic
 * takes tiles.
 */
enum { FUM_DEVICE_AUTO = 0, FUM_DEVICE_GL = 1, FUM_DEVICE_TILES = 2 };

/**
 * How solids look in Combined. Holdout: transparent; they hide what is behind them. Shaded: Lambertian and opaque, lit
 * by the lights alone, through smoke and past other solids.
 */
enum { FUM_SOLIDS_HOLDOUT = 0, FUM_SOLIDS_SHADED = 1 };

/** Passes, in the order of the pass table (fum_pass_get). */
enum {
  FUM_PASS_COMBINED = 0,
  FUM_PASS_DEPTH = 1,
  FUM_PASS_POSITION = 2,
  FUM_PASS_EMISSION = 3,
  FUM_PASS_SHADOW = 4,
  FUM_PASS_LIGHT = 5,        /**< of one light */
  FUM_PASS_LIGHT_SHADOW = 6, /**< of one light */
  FUM_PASS_OPACITY = 7,
  FUM_PASS_DEPTH_FRONT = 8,
  FUM_PASS_DEPTH_BACK = 9,
  FUM_PASS_ALBEDO = 10,
  FUM_PASS_VECTOR = 11,
  FUM_PASS_SOLID_SHADOW = 12,
  FUM_PASS_LIGHT_SOLID_SHADOW = 13, /**< of one light */
  FUM_PASS_ERROR = 14,
  FUM_PASS_CRYPTO_OBJECT = 15, /**< of two ranks */
  FUM_PASS_HOLDOUT = 16
};

/** Sets by which lights are linked to what they shine on and to what blocks them. */
enum { FUM_LINK_SETS = 64 };
/** Of what a pass is one among several (fum_pass_info.per). */
enum {
  FUM_PER_PICTURE = 0, /**< there is one */
  FUM_PER_LIGHT = 1,   /**< one for every light */
  FUM_PER_RANKS = 2    /**< one for every two ranks of Cryptomatte, at most FUM_MAX_RANK_PAIRS */
};

enum { FUM_MAX_RANK_PAIRS = 8 };

typedef struct fum_context fum_context;
typedef struct fum_scene fum_scene;

/* ---- Library ---------------------------------------------------------------------------------------------------- */

/** "major.minor.patch" of the library that was loaded. */
FUM_API const char *fum_version(void);

/** One line for bug reports: version, instruction set in use, Embree and OpenEXR versions reached. */
FUM_API const char *fum_build_info(void);

/** Size and offset of a struct's field as compiled into the library, so that a foreign-language mirror can be checked.
 */
typedef struct fum_abi_field {
  const char *struct_name;
  const char *field_name; /**< "" for the struct as a whole. */
  uint32_t offset;        /**< bytes; 0 for the struct as a whole */
  uint32_t size;          /**< bytes */
} fum_abi_field;

/** The table of all public structs' fields. `*out_fields` points to static memory. Returns the number of entries. */
FUM_API int32_t fum_abi_fields(const fum_abi_field **out_fields);

/* ---- Context ---------------------------------------------------------------------------------------------------- */

/**
 * Called on the thread that called the library: for each new stage or message, and at least ten times a second during
 * long work.
 * `fraction` is 0..1 within the stage; `message` is valid during the call. Return nonzero to cancel.
 */
typedef int32_t (*fum_progress_fn)(void *user, int32_t stage, float fraction, const char *message);

/** Creates a context. Checks that the Embree it reaches is the one it was built for (FUM_ERROR_LIBRARY if not). */
FUM_API int32_t fum_context_create(fum_context **out_context);

/** Destroys the context and its drawing thread. Its scenes must be gone. NULL is allowed. */
FUM_API void fum_context_destroy(fum_context *context);

/** Number of threads for the calls that follow; 0 (default) uses all cores. At most 1024. */
FUM_API int32_t fum_context_set_threads(fum_context *context, int32_t threads);

/** Sets or clears (NULL) the progress callback. */
FUM_API void fum_context_set_progress(fum_context *context, fum_progress_fn progress, void *user);

/** What went wrong in the last failed call, or "" if none failed. With NULL: why fum_context_create failed (per
 * thread). */
FUM_API const char *fum_last_error(const fum_context *context);

/** Warnings gathered since the last fum_warnings_clear, each once. */
FUM_API int32_t fum_warning_count(const fum_context *context);
/** Text of warning `index`, or NULL if out of range. Valid until the next call with this context. */
FUM_API const char *fum_warning(const fum_context *context, int32_t index);
FUM_API void fum_warnings_clear(fum_context *context);

/* ---- Scene ------------------------------------------------------------------------------------------------------ */

FUM_API int32_t fum_scene_create(fum_context *context, fum_scene **out_scene);

/** NULL is allowed. */
FUM_API void fum_scene_destroy(fum_scene *scene);

/**
 * A set of particles with one material. Arrays may be NULL; the value beside them then holds for every particle.
 * Particles with a non-finite position, or a non-finite or negative radius, density, albedo, emission or extinction
 * colour, or an albedo above 1 are dropped, counted and reported as a warning. Particles with radius 0 are dropped in
 * silence (they hold no matter); with density 0 they are kept and neither absorb nor scatter.
 *
 * A map lies on a square that faces the camera, as wide as the particle (two sigmas to each side of its centre), turned
 * by an angle of the particle's own that follows from its id. It is linear between its pixels, its border goes on
 * beyond the square, and where its pixels are smaller than those of the picture it is averaged. A ray's optical depth
 * through the particle is multiplied by the opacity where it passes, over the mean opacity (weighted with the
 * particle's Gaussian, at least 1e-6): the map changes a particle's shape, and not how much smoke it is. The colour
 * there multiplies albedo and emission. Lights don't know maps: towards them the particle is the Gaussian that it is
 * without.
 */
typedef struct fum_particles_desc {
  uint32_t struct_size;
  float anisotropy;          /**< g of Henyey-Greenstein, above -1 and below 1; default 0 */
  const char *name;          /**< for messages; NULL is "particles" */
  int64_t count;             /**< 0 or more; at most 4294967294 over all sets of a scene */
  const float *positions;    /**< [3 count] world space; required unless count is 0 */
  const float *radii;        /**< [count] m; sigma = radius / 2 */
  const float *densities;    /**< [count] peak extinction, 1/m */
  const float *albedos;      /**< [3 count] single-scattering albedo, 0..1 */
  const float *emissions;    /**< [3 count] radiance emitted per metre at the centre, W / (m^3 sr) */
  const float *velocities;   /**< [3 count] world space, m a frame; for the pass Vector. NULL: at rest */
  const uint64_t *ids;       /**< [count] what random choices hang on, with the set's name: the same particle's in every
                                  frame, others' in other sets of this name. NULL: 0, 1, 2... */
  float radius;              /**< default 0.1 */
  float density;             /**< default 1 */
  float albedo[3];           /**< default 0.8 */
  float emission[3];         /**< default 0 */
  int32_t light_set;         /**< a light shines on them if its light_sets hold this set, 0..63; default 0 */
  int32_t shadow_set;        /**< they block a light if its shadow_sets hold this set, 0..63; -1: no light; default 0 */
  int32_t visible_to_camera; /**< 0: they aren't drawn, but block light all the same; default 1 */

  const float *extinction_colors; /**< [3 count] factors on the density for red, green and blue light, 0 or more */
  float extinction_color[3];      /**< default 1 */
  const char *matte_name;         /**< UTF-8: what Cryptomatte calls them; sets of one name are one. NULL: `name` */

  const float *map; /**< [map_height][map_width][4] linear RGB, not premultiplied, and opacity, each 0..1, first row at
                       the bottom: shapes and colours each particle as the camera sees it, see below. NULL: none */
  int32_t map_width, map_height; /**< 1..16384 each, of `map` */
} fum_particles_desc;

FUM_API void fum_particles_desc_init(fum_particles_desc *desc);
FUM_API int32_t fum_scene_add_particles(fum_scene *scene, const fum_particles_desc *desc);

/** Triangles that cast shadows on the smoke and hide it; shaded from both sides. Degenerate triangles are harmless. */
typedef struct fum_mesh_desc {
  uint32_t struct_size;
  uint32_t visibility; /**< FUM_VISIBLE_ flags; default all */
  const char *name;    /**< for messages; NULL is "mesh" */
  int64_t vertex_count;
  int64_t triangle_count;
  const float *vertices;       /**< [3 vertex_count], local space, finite */
  const uint32_t *triangles;   /**< [3 triangle_count], indices below vertex_count */
  double world_from_local[16]; /**< default identity */
  int32_t light_set;           /**< as of particles; where light on solids is asked for */
  int32_t shadow_set;          /**< as of particles, but not -1 */
  float albedo[3];             /**< share of the light that it reflects where solids are shaded, 0..1; default 0.8 */
  float emission[3];           /**< radiance that it shows where solids are shaded, W/(m^2 sr), at least 0; it lights
                                    nothing else. Default 0 */
  int32_t is_holdout;          /**< 1: a holdout also where solids are shaded; default 0 */
  const float *normals; /**< [9 triangle_count] of the triangles' corners, local space, any length, finite: between
                             them light on the triangle is as on a smooth surface. NULL: flat */
} fum_mesh_desc;

enum {
  FUM_VISIBLE_TO_SHADOW = 1, /**< casts shadows on smoke */
  FUM_VISIBLE_TO_CAMERA = 2  /**< hides the smoke behind it */
};

FUM_API void fum_mesh_desc_init(fum_mesh_desc *desc);
FUM_API int32_t fum_scene_add_mesh(fum_scene *scene, const fum_mesh_desc *desc);

/**
 * A light in physical units, so that each host's own watts are converted where that host is known.
 * Point, spot and area lights stand at the matrix's translation; spot, sun and area lights shine along its local -Z.
 * An environment's picture is equirectangular, as Blender's: its middle is seen along local X, the middle of its left
 * half along local Y, its uppermost row around local Z.
 */
typedef struct fum_light_desc {
  uint32_t struct_size;
  int32_t type;                /**< FUM_LIGHT_ */
  const char *name;            /**< for messages; NULL is "light" */
  double world_from_light[16]; /**< default identity; rotation and translation are used, and for a spot the scale too:
                                    its cone is that of the direction in local space */
  float intensity[3];          /**< point, spot: radiant intensity, W/sr. sun: irradiance on a plane facing it, W/m^2.
                                    area, environment: radiance, W/(m^2 sr); a picture is multiplied by it. At least 0;
                                    default 1 */
  float radius;                /**< point, spot: radius of the disc that faces the receiver, m; default 0 */
  float sun_angle;             /**< sun: full angle of its disc, 0..pi; default 0 */
  float spot_angle;            /**< spot: full angle of the cone, above 0 and at most pi; default pi/4 */
  float spot_blend;            /**< spot: share of the cone that is soft, 0..1; default 0.15 */
  int32_t spot_cosine;         /**< spot: 1 multiplies by the cosine to the axis (Cycles of Blender 3.4); default 0 */
  int32_t area_shape;          /**< FUM_AREA_; default rectangle */
  float area_size[2];          /**< area: full width and height along local X and Y, m, scale included; default 1, 1 */
  float area_spread;           /**< area: full angle that light spreads over, above 0 and at most pi; default pi */
  int32_t casts_shadows;       /**< 0: neither solids nor smoke block it; default 1 */
  uint64_t light_sets;         /**< bit s: it shines on particles and meshes whose light_set is s; default all */
  uint64_t shadow_sets;        /**< bit s: particles and meshes whose shadow_set is s block it; default all */
  const float *environment_pixels; /**< environment: [height][width][3] linear RGB, finite and at least 0, first row at
                                        the bottom; NULL (default): white all around */
  int32_t environment_width, environment_height; /**< 1..16384 each, of environment_pixels */
} fum_light_desc;

FUM_API void fum_light_desc_init(fum_light_desc *desc);
/** Lights are numbered from 0 in the order they are added. */
FUM_API int32_t fum_scene_add_light(fum_scene *scene, const fum_light_desc *desc);
/** Removes all lights; particles, meshes and what was built from them are kept. */
FUM_API void fum_scene_clear_lights(fum_scene *scene);

/* ---- Settings and camera ---------------------------------------------------------------------------------------- */

/** Settings of one render. The artistic ones bend physics as in the paper's table 1; their defaults do not. */
typedef struct fum_settings {
  uint32_t struct_size;
  int32_t solver;               /**< FUM_SOLVER_; default automatic */
  int32_t device;               /**< FUM_DEVICE_; default auto */
  int32_t leaf_size;            /**< an octree cell is subdivided above this many particles, 1..4096 */
  int32_t light_samples;        /**< most sample points of a soft light, 1..1024; default 16. Lights that look small
                                     from all the smoke take fewer; an environment takes three times as many
                                     directions, with a picture four times, at most 1024, and fewer beside brighter lights
                                     or where the picture has fewer pixels that shine */
  float tolerance;              /**< relative error that cut-offs may cause in the picture, 1e-4..0.5; default 0.01.
                                     Exactly solved, transmittance to a light is kept within a tenth of it. That particles are lit at
                                     their centres by FUM_DEVICE_GL isn't covered: see docs/ACCURACY.md */
  float shadowing_density;      /**< artistic: factor on optical depth towards lights, at least 0; default 1 */
  float solid_shadow_intensity; /**< artistic: share of a light's power that solids block, 0..1; default 1 */
  float subsampling; /**< artistic: share of the particles that cast shadows on smoke, above 0 and at most 1, chosen by
                          id, their density rescaled; default 1 */
  float intersection_scale; /**< artistic: factor on particles' radius towards lights, 0.01..100; default 1 */
  int32_t solids;           /**< FUM_SOLIDS_; default holdout */
} fum_settings;

FUM_API void fum_settings_init(fum_settings *settings);

/**
 * A camera looking along its local -Z. Blurred by its shutter or aperture, each particle is drawn with the mean of its
 * optical depth over both; dense ones with less, so that the mean of what they hide stays. It is lit where it stands
 * now. Solids, and the passes of depth, aren't blurred.
 */
typedef struct fum_camera {
  uint32_t struct_size;
  int32_t type;                 /**< FUM_CAMERA_; default perspective */
  double world_from_camera[16]; /**< rotation and translation; scale is removed. Default identity */
  double window[4];             /**< left, right, bottom, top of the picture at unit depth (perspective) or in metres
                                     (orthographic); left < right, bottom < top; default -1, 1, -1, 1 */
  double clip_start, clip_end;  /**< depth along the axis, m, 0 <= start < end; default 0.1, 1000. Smoke nearer than
                                     clip_start or farther than clip_end isn't drawn */
  int32_t width, height;        /**< pixels, 1..65536; default 512, 512 */
  int32_t moves;                /**< 1: where it is one frame before and one frame after is given below; for the pass
                                     Vector and for motion blur. Default 0 */
  double previous_world_from_camera[16], previous_window[4];
  double next_world_from_camera[16], next_window[4];
  double shutter_open, shutter_close; /**< frames from now, -1 <= open <= close <= 1; default 0, 0: no motion blur */
  double aperture_radius;             /**< m, at least 0; default 0: no depth of field */
  double focus_distance;              /**< depth along the axis at which it is sharp, m, above 0; default 10 */
  int32_t aperture_blades;            /**< corners of the aperture, 3..64; 0 (default): it is round */
  float aperture_rotation;            /**< of the corners, the first of which lies along local X; default 0 */
  float aperture_ratio;               /**< by which it is narrowed along local X, above 0; default 1 */
} fum_camera;

FUM_API void fum_camera_init(fum_camera *camera);

/* ---- Render ----------------------------------------------------------------------------------------------------- */

/** What a pass is. The pass table is the one list of passes; hosts register from it. */
typedef struct fum_pass_info {
  int32_t pass; /**< FUM_PASS_ */
  int32_t channel_count;
  const char *name;        /**< "Combined", "Depth" */
  const char *channels;    /**< a letter a channel: "RGBA", "Z" */
  const char *kind;        /**< "COLOR", "VALUE" or "VECTOR" */
  const char *description; /**< a sentence with units */
  int32_t per;             /**< FUM_PER_ */
} fum_pass_info;

/** Pass `index` of the table in `*out_info`; FUM_ERROR_ARGUMENT past its end. */
FUM_API int32_t fum_pass_get(int32_t index, fum_pass_info *out_info);

/** A pass asked for and where its pixels go. Only what is asked for is computed. */
typedef struct fum_pass_buffer {
  int32_t pass;   /**< FUM_PASS_ */
  int32_t number; /**< of the light, or of the two ranks (0: the first two), of passes of which there are several; 0
                     else */
  float *pixels;  /**< [height][width][channel_count], written only when the render succeeds */
  int64_t pixels_size; /**< number of floats at `pixels`; checked */
} fum_pass_buffer;

/** What a render did. */
typedef struct fum_render_stats {
  uint32_t struct_size;
  int32_t light_count;
  int32_t light_sample_count; /**< sample points over all lights */
  int32_t solver;             /**< FUM_SOLVER_ that ran */
  int64_t particle_count;     /**< in the scene */
  int64_t drawn_count;        /**< in front of the camera and within its frame */
  int64_t triangle_count;
  uint64_t memory_bytes; /**< largest amount the scene and the render held at once, drawing device not counted */
  double build_s;        /**< octree and mesh hierarchy; 0 when kept from an earlier call */
  double light_s;
  double sort_s;
  double draw_s;
  double passes_s; /**< passes other than Combined */
  double total_s;
  char device[128];         /**< name of what drew, "" when nothing was */
  int64_t light_points;     /**< points at which light was found: particles, or samples between which it is
                                 interpolated */
  int64_t slab_count;       /**< slabs that the smoke in view was cut into; 0 with GL */
  int64_t refinement_count; /**< times that light was found anew in smaller steps, because it missed the tolerance */
  int64_t accuracy_count;   /**< points in the smoke at which light was found again, exactly, and compared; 0: none */
  double accuracy_rms;   /**< errors there of the transmittance through smoke to a light, 0..1: root mean square... */
  double accuracy_p95;   /**< ...95 of 100 are smaller than this... */
  double accuracy_worst; /**< ...largest... */
  double accuracy_bias;  /**< ...mean; above 0: too bright */
  double meter_s;        /**< what finding them took; not in light_s */
} fum_render_stats;

FUM_API void fum_render_stats_init(fum_render_stats *stats);

/**
 * Lights and draws the scene. `settings` may be NULL (defaults), `out_stats` may be NULL.
 * Combined is premultiplied RGBA radiance, of the smoke, and of solids if they are shaded. Where extinction colours
 * aren't grey, red, green and blue are lit and drawn one after the other (stages of progress begin anew for each),
 * alpha is the mean of what they lose, and passes that aren't colours are found by the mean extinction; the stats'
 * seconds and points are those of all three, the accuracy that of the channel where light is farthest off. Depth is the
 * distance along the camera's axis at which the transmittance from the camera passes one half, else that of the solid
 * there, else clip_end.
 */
FUM_API int32_t fum_render(fum_scene *scene, const fum_camera *camera, const fum_settings *settings, int32_t pass_count,
                           const fum_pass_buffer *passes, fum_render_stats *out_stats);

/**
 * How well one picture shows the blur of a camera's shutter and aperture, each particle with the mean optical depth
 * that it has on its way and over the aperture: the error of the picture's opacity that comes of taking this mean,
 * found in some pixels by rays at times and through places of the aperture, relative to the opacity (root mean
 * squares). Solids stand still. `*out_error` is that error, `*out_samples` (1..64) how many pictures with a part of the
 * shutter and of the aperture each have a mean that is within the settings' tolerance. `settings` may be NULL.
 */
FUM_API int32_t fum_blur_measure(fum_scene *scene, const fum_camera *camera, const fum_settings *settings,
                                 double *out_error, int32_t *out_samples);

/**
 * The smoke in depth: a list of samples for each pixel, nearest first, that don't overlap. A sample is smoke spread
 * evenly from `depth` to `depth_back`: its nearest part, a share f of its length, has the opacity 1 - (1 - a)^f, and of
 * its radiance a share as of its opacity.
 */
typedef struct fum_deep_sample {
  float rgba[4];           /**< premultiplied radiance and opacity of the sample alone; over one another, nearest first,
                              they make Combined, but for shaded solids */
  float depth, depth_back; /**< along the camera's axis, m; depth < depth_back */
} fum_deep_sample;

typedef struct fum_deep fum_deep;

/**
 * As fum_render, and the smoke in depth as well, unless `out_deep` is NULL. `pass_count` may be 0 then.
 * Samples are as long as the tolerance allows: in front of any depth, the opacity that they have is off by at most that
 * share of the pixel's opacity, and their radiance by that share of its brightest channel. In pixels with less than a
 * quarter of opacity it is the share that a quarter would have; what glows keeps its own.
 * Smoke is cut at solids; these have no samples. Where a solid's edge runs through a pixel, the pixel holds the mean of
 * what is in front of the solid and beside it. The opacity of smoke that tints light is the mean over red, green and
 * blue, as Combined's. Device OpenGL can't do it.
 * What it gives belongs to the scene's context and must be destroyed before that.
 */
FUM_API int32_t fum_render_deep(fum_scene *scene, const fum_camera *camera, const fum_settings *settings,
                                int32_t pass_count, const fum_pass_buffer *passes, fum_deep **out_deep,
                                fum_render_stats *out_stats);

/** All samples, pixel after pixel, first row at the bottom, and the number of samples of each pixel, [height][width].
 *  They live as long as `deep`. Returns the number of samples. */
FUM_API int64_t fum_deep_samples(const fum_deep *deep, const uint32_t **out_counts,
                                 const fum_deep_sample **out_samples);

/** NULL is allowed. */
FUM_API void fum_deep_destroy(fum_deep *deep);

/**
 * Share of a light that reaches points through smoke and past solids, 0..1; a soft light's sample points are averaged,
 * and red, green and blue where they differ. Points are in no set: every light shines on them, and is blocked by its
 * own shadow_sets. `positions` [3 count] world space, `out_transmittance` [count].
 */
FUM_API int32_t fum_scene_transmittance(fum_scene *scene, const fum_settings *settings, int32_t light, int64_t count,
                                        const float *positions, float *out_transmittance);

/**
 * Light that arrives at points through smoke and past solids: irradiance of a surface with the unit `normals`
 * [3 count], or without cosine if NULL (what a small puff of smoke receives). `out_irradiance` [3 count], W/m^2.
 */
FUM_API int32_t fum_scene_irradiance(fum_scene *scene, const fum_settings *settings, int32_t light, int64_t count,
                                     const float *positions, const float *normals, float *out_irradiance);

/**
 * What Cryptomatte calls an object of this name (UTF-8): MurmurHash3 of 32 bits, seed 0, some of its bits changed so
 * that it is a number as a float (Friedman and Jones 2015). The pass holds these bits as float.
 */
FUM_API uint32_t fum_crypto_hash(const char *name);

/* ---- Reference -------------------------------------------------------------------------------------------------- */

/** How exactly fum_reference_render works. */
typedef struct fum_reference_settings {
  uint32_t struct_size;
  int32_t light_samples; /**< sample points of every light that has a size, 1..65536, rounded up to a square;
                              default 256. Near an area light more are taken */
  double tolerance;      /**< error that is allowed in a pixel's RGB, as a share of its brightest channel, 1e-10..0.1;
                              default 1e-4 */
  int32_t solids;        /**< FUM_SOLIDS_; default holdout */
} fum_reference_settings;

FUM_API void fum_reference_settings_init(fum_reference_settings *settings);

/** What fum_reference_render did. */
typedef struct fum_reference_stats {
  uint32_t struct_size;
  int32_t light_sample_count; /**< sample points over all lights */
  int64_t particle_count;     /**< in the scene */
  int64_t step_count;         /**< points of the pixels' rays at which radiance was found */
  int64_t unconverged_count;  /**< pixels that missed the tolerance */
  double error;               /**< estimated: RMS of the pixels' errors over the RMS of their brightest channels */
  double total_s;
} fum_reference_stats;

FUM_API void fum_reference_stats_init(fum_reference_stats *stats);

/**
 * The picture that fum_render aims at, slowly: single scattering through the sum of the Gaussians, integrated along the
 * ray of each pixel's centre in double precision until it has converged, every step lit by the closed form. It shares
 * no lighting or drawing with fum_render and has none of its artistic settings.
 * `settings` may be NULL (defaults), `out_stats` may be NULL.
 * `out_combined` [height][width][4] as the pass Combined, `combined_size` doubles; `out_depth` [height][width] as the
 * pass Depth, `depth_size` doubles, or NULL.
 * Features much smaller than the smallest particle that the steps start from, such as the shadow of a thin wire, may
 * be missed. What costs time: particles, pixels, sharp shadows, and light_samples for every soft light.
 */
FUM_API int32_t fum_reference_render(fum_scene *scene, const fum_camera *camera, const fum_reference_settings *settings,
                                     double *out_combined, int64_t combined_size, double *out_depth, int64_t depth_size,
                                     fum_reference_stats *out_stats);

/* ---- Output ----------------------------------------------------------------------------------------------------- */

/** One layer of an OpenEXR file; its channels are called `name`.`letter`, or just the letter when name is "". */
typedef struct fum_image_layer {
  const char *name;
  const char *channels; /**< a letter a channel, e.g. "RGBA" */
  const float *pixels;  /**< [height][width][number of letters], first row at the bottom */
} fum_image_layer;

/** Writes a 32-bit float, ZIP-compressed scanline OpenEXR file. `path` is UTF-8. An existing file is replaced in one
 *  step once the new one is complete; on failure it stays as it was. */
FUM_API int32_t fum_exr_write(fum_context *context, const char *path, int32_t width, int32_t height,
                              int32_t layer_count, const fum_image_layer *layers);

/** Part of a larger frame that a picture is. */
typedef struct fum_frame_part {
  int32_t frame_width, frame_height;
  int32_t left, bottom; /**< of the picture, pixels from the frame's lower left corner */
} fum_frame_part;

/** Writes a deep scanline OpenEXR file with the channels R, G, B, A, Z and ZBack in 32-bit float, ZIPS-compressed.
 * `part` NULL: the picture is the frame. Else as fum_exr_write. */
FUM_API int32_t fum_deep_write(const fum_deep *deep, const char *path, const fum_frame_part *part);

#ifdef __cplusplus
}
#endif

#endif
