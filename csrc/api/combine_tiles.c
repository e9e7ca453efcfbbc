/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "api/attributes.h"
#include "api/light_error.h"
#include "api/particle_light.h"
#include "api/smeared.h"
#include "api/smeared_parts.h"
#include "api/solid_shadow.h"
#include "billboard/coarse.h"
#include "billboard/drawn.h"
#include "lighting/centres.h"
#include "lighting/inscatter.h"

#include <string.h>

/* Light as tiles look it up. */
typedef struct smoke_light {
  fum_slabs slabs;
  fum_lattice lattice;
  float *centres;   /* [3 count] of particles lit at their centres; NULL: the lattice holds the light */
  float **by_light; /* [light_count] [3 count] the same of lights that are asked for by themselves; NULL: none is */
  int32_t light_count;
} smoke_light;

static void smoke_light_free(fum_context *context, smoke_light *light) {
  fum_lattice_free(context, &light->lattice);
  fum_slabs_free(context, &light->slabs);
  fum_free(context, &light->centres);
  for (int32_t l = 0; l < light->light_count && light->by_light != NULL; l++)
    fum_free(context, &light->by_light[l]);
  fum_free(context, &light->by_light);
}

/* What lighting the smoke needs to know. */
typedef struct plan {
  fum_rendering *r;
  fum_lighting *lighting;
  float footprint, thinnest;
  const fum_smears *smears;
} plan;

/* Cuts the view into slabs and places samples, unlit (fum_slabs_find). */
static int32_t place(const plan *p, float tolerance, float light_tolerance, smoke_light *out_light) {
  const fum_rendering *r = p->r;
  const fum_octree *all = r->scene->caches->all;
  /* Steps' errors grow with the root of the extinction, and maps gather it. */
  const fum_map_traits traits = fum_scene_map_traits(r->scene);
  tolerance /= sqrtf(traits.contrast);
  light_tolerance /= sqrtf(traits.contrast);
  const fum_smears *smears = p->smears->items != NULL ? p->smears : NULL;
  int32_t status =
      fum_slabs_find(r->context, all, &r->view, smears, tolerance, light_tolerance, p->thinnest, &out_light->slabs);
  out_light->slabs.has_holes = traits.has_maps;
  if (status != FUM_OK || out_light->slabs.count == 0) return status;
  return fum_lattice_place(r->context, all, &r->view, &out_light->slabs, p->footprint, tolerance, &out_light->lattice);
}

static int32_t light_lattice(const plan *p, smoke_light *light) {
  return fum_lattice_light(&p->lighting->gathering, &p->r->view, &light->slabs, &p->lighting->lamps, &light->lattice);
}

/* How much of the tolerance the light takes: above 1 it is missed. The meter's points are what the camera sees, and a
 * pixel adds up the light of such points, so that their relative RMS is about the most that the picture's can be. */
static double share_of_tolerance(const fum_rendering *r, const fum_accuracy *accuracy) {
  return accuracy->rms > 0.0 ? accuracy->rms / ((double)r->settings.tolerance * accuracy->level) : 0.0;
}

static int32_t read_meter(fum_rendering *r, const fum_meter *meter, double *out_share) {
  fum_accuracy accuracy;
  const int32_t status = fum_meter_read(meter, &accuracy);
  if (status != FUM_OK) return status;
  fum_note_accuracy(&accuracy, &r->stats);
  *out_share = share_of_tolerance(r, &accuracy);
  return FUM_OK;
}

static int32_t begin_meter(const plan *p, const smoke_light *light, fum_meter *meter) {
  const fum_rendering *r = p->r;
  const fum_meter_options options = fum_find_meter_options(r, p->lighting);
  const fum_meter_sight sight = {&r->view, (double)p->footprint, r->solid.depths, &light->slabs,
                                 &light->lattice.hidden};
  return fum_meter_begin_points(r->context, &options, &sight, meter);
}

/* Lights every particle at its centre; the meter compares that with light around them. */
static int32_t light_centres(const plan *p, smoke_light *light, double *out_share, fum_meter *meter) {
  fum_rendering *r = p->r;
  const fum_octree *all = r->scene->caches->all;
  fum_gathering g = p->lighting->gathering;
  const fum_viewpoint viewpoint = fum_find_viewpoint(&r->view);
  int32_t status = fum_alloc(r->context, all->count, 3 * sizeof(float), "lighting", &light->centres);
  g.listen = fum_meter_listen;
  g.listen_user = meter;
  if (status == FUM_OK) status = fum_inscatter(r->scene, &g, &p->lighting->lamps, &viewpoint, NULL, light->centres);
  if (status == FUM_OK) status = read_meter(r, meter, out_share);
  if (status != FUM_OK || *out_share <= 1.0) return status;
  fum_free(r->context, &light->centres);
  return FUM_OK;
}

/* Light at the particles' centres is added up over lights and with what they emit. */
static bool asks_lattice(const fum_rendering *r) {
  for (int32_t l = 0; l < r->scene->light_count; l++) {
    if (r->lights[l] != NULL) return true;
  }
  return r->emission != NULL || r->error != NULL || fum_solid_shadow_is_wanted(r);
}

/* Are the particles fewer than the samples that were placed, and light at their centres enough? */
static bool prefers_centres(const plan *p, const smoke_light *light) {
  const fum_rendering *r = p->r;
  const fum_octree *all = r->scene->caches->all;
  return !asks_lattice(r) && all->count < light->lattice.lit_count &&
         fum_centres_suffice(r->scene, all, &r->view, &light->slabs, &p->lighting->lamps, r->scene->caches->solids,
                             r->settings.tolerance);
}

static int32_t ask_lattice(const plan *p, const smoke_light *light, double *out_share, fum_meter *meter) {
  fum_meter_ask(meter, &light->slabs, &light->lattice);
  return read_meter(p->r, meter, out_share);
}

/* Lights the lattice, and again in smaller steps if the meter says so. Errors of both kinds of step grow with the
 * tolerance that they are made for; those of light less than that where particles are smaller than its samples are
 * far apart. */
static int32_t light_and_refine(const plan *p, smoke_light *light, double *out_share, fum_meter *meter) {
  enum { REFINEMENTS = 2 };
  fum_rendering *r = p->r;
  float tolerance = r->settings.tolerance, light_tolerance = tolerance;
  int32_t status = light_lattice(p, light);
  if (status == FUM_OK) status = fum_meter_find_exact(meter);
  if (status == FUM_OK) status = ask_lattice(p, light, out_share, meter);
  while (status == FUM_OK && *out_share > 1.0 && fum_solver_fall_back(&p->lighting->solver)) {
    fum_lattice_forget(r->context, &light->lattice);
    status = light_lattice(p, light);
    if (status == FUM_OK) status = ask_lattice(p, light, out_share, meter);
  }
  while (status == FUM_OK && *out_share > 1.0 && r->stats.refinement_count < REFINEMENTS) {
    smoke_light finer = {0};
    const float less = fmaxf(0.25F, 0.7F / (float)*out_share);
    tolerance *= less;
    light_tolerance *= less * less;
    status = place(p, tolerance, light_tolerance, &finer);
    if (status == FUM_OK) status = light_lattice(p, &finer);
    if (status != FUM_OK) {
      smoke_light_free(r->context, &finer);
      break;
    }
    smoke_light_free(r->context, light);
    *light = finer;
    r->stats.refinement_count++;
    status = ask_lattice(p, light, out_share, meter);
  }
  if (status == FUM_ERROR_MEMORY && *out_share > 1.0) {
    fum_warn(r->context, "light can't be found in smaller steps: %s", r->context->error);
    return FUM_OK;
  }
  return status;
}

/* What is seen of a particle elsewhere than where it stands is lit as it is there: by the light at its own centre, not
 * by that at the pixel. Closer than this to where it stands, in sigmas, the pixel's is better: it is known inside of
 * particles too, and what it is off by on one side of a particle it makes up for on the other. */
static const double BLUR_OF_LATTICE = 1.5;

static bool is_blurred(const plan *p) {
  return p->smears->items != NULL && p->smears->worst > BLUR_OF_LATTICE;
}

static int32_t light_blurred(const plan *p, smoke_light *light) {
  fum_rendering *r = p->r;
  const fum_octree *all = r->scene->caches->all;
  const char *what = "light of the particles";
  if (r->error != NULL || fum_solid_shadow_is_wanted(r)) {
    return fum_fail(r->context, FUM_ERROR_ARGUMENT, "pass %s can't be drawn with motion blur or depth of field",
                    r->error != NULL ? "Error" : "Solid Shadow");
  }
  int32_t status = fum_slabs_find(r->context, all, &r->view, p->smears, r->settings.tolerance, r->settings.tolerance,
                                  p->thinnest, &light->slabs);
  if (status != FUM_OK || light->slabs.count == 0) return status;
  light->light_count = r->scene->light_count;
  status = fum_alloc(r->context, all->count, 3 * sizeof(float), what, &light->centres);
  if (status == FUM_OK)
    status = fum_alloc(r->context, light->light_count, sizeof *light->by_light, what, &light->by_light);
  for (int32_t l = 0; l < light->light_count && status == FUM_OK; l++) {
    if (r->lights[l] != NULL) status = fum_alloc(r->context, all->count, 3 * sizeof(float), what, &light->by_light[l]);
  }
  return status == FUM_OK ? fum_light_particles(r, p->lighting, light->by_light, light->centres) : status;
}

/* Lights the smoke in view. */
static int32_t light_smoke(const plan *p, smoke_light *light, fum_meter *meter) {
  fum_rendering *r = p->r;
  double share = 0.0;
  if (is_blurred(p)) return light_blurred(p, light);
  int32_t status = place(p, r->settings.tolerance, r->settings.tolerance, light);
  if (status != FUM_OK || light->slabs.count == 0) return status;
  status = begin_meter(p, light, meter);
  if (status == FUM_OK && prefers_centres(p, light)) status = light_centres(p, light, &share, meter);
  if (status == FUM_OK && light->centres == NULL) status = light_and_refine(p, light, &share, meter);
  if (status == FUM_OK && share > 1.0) {
    fum_warn(
        r->context,
        "light misses the tolerance %g: transmittances to the lights are wrong by %.2g of their own size (root mean "
        "squares)",
        (double)r->settings.tolerance, share * (double)r->settings.tolerance);
  }
  return status;
}

/* Particles that are lit at their centres glow. */
static void use_centres(const smoke_light *light, fum_tile_job *job) {
  if (light->centres == NULL) return;
  job->centre_light = light->centres;
  job->class_count = 0;
  job->is_uniform = false;
  job->glows = true;
  job->light_rgb = NULL;
  job->emission = NULL;
}

/* Tails that are cut off add up where many particles overlap, so that particles are drawn further out than they ask for
 * light. Interpolation has them place samples out there anyway. Of the thinnest, a share of the tolerance is moved. */
static fum_footprints drawn_footprints(const fum_rendering *r, const fum_slabs *slabs) {
  const double usual = 10.0; /* optical depth of the smoke as a whole */
  const double share = 0.0625 * fmin(1.0, usual / slabs->depth), moved = 0.08;
  const double sigmas = (double)fum_footprint_sigmas(r->scene, (float)share * r->settings.tolerance);
  const double thin = sqrt(fmax(4.0, -2.0 * log(moved * (double)r->settings.tolerance)));
  /* A map may hold most of a particle where a Gaussian has little. */
  return fum_footprints_find(sigmas, fum_scene_map_traits(r->scene).has_maps ? sigmas : fmin(thin, sigmas));
}

/* A fum_draw_values_fn. */
static int32_t draw_values(void *user, const float *values, bool are_colors, float *out_rgba) {
  const fum_tile_job *shared = user;
  fum_tile_job job = *shared;
  fum_lattice nothing = {0};
  job.lattice = &nothing;
  job.values = values;
  job.ignores_map_colors = !are_colors;
  job.class_count = 0;
  job.is_uniform = false;
  job.glows = true;
  job.rgba = out_rgba;
  job.light_rgb = NULL;
  job.emission = NULL;
  return fum_tiles_draw(shared->scene->context, &job);
}

/* Passes that are drawn as Combined is. */
static int32_t draw_others(fum_rendering *r, const fum_lighting *lighting, const smoke_light *light,
                           fum_tile_job *job) {
  job->through[0] = job->through[1] = NULL; /* they are noted already */
  int32_t status = fum_attributes_make(r, draw_values, job);
  if (status == FUM_OK && light->by_light != NULL)
    status = fum_smeared_parts_make(r, light->by_light, job->thinnest, draw_values, job);
  if (status == FUM_OK && fum_solid_shadow_is_wanted(r)) status = fum_solid_shadow_find(r, job);
  if (status == FUM_OK && r->error != NULL) status = fum_light_error_find(r, lighting, &light->slabs, &light->lattice);
  return status;
}

/* Is more drawn with the splats than what comes out of one drawing? */
static bool draws_more(const fum_rendering *r, const fum_tile_job *job) {
  return job->deep != NULL || fum_attributes_are_wanted(r) || fum_solid_shadow_is_wanted(r) || r->error != NULL;
}

/* Draws the smoke; where it is smooth close particles as one, and on a coarser grid. */
static int32_t draw(fum_rendering *r, const fum_splats_options *options, fum_tile_job *job, fum_splats *splats) {
  const double start_s = fum_now_s();
  if (options->smears == NULL && !job->has_maps && !draws_more(r, job)) {
    fum_coarse_report report = {0};
    fum_octree *bunched = NULL;
    fum_tile_job drawn = *job;
    int32_t status = fum_drawn_bunch(r->context, job, r->settings.tolerance, &bunched);
    if (bunched != NULL) drawn.octree = bunched;
    if (status == FUM_OK) status = fum_coarse_draw(r->context, &drawn, options, r->settings.tolerance, splats, &report);
    fum_octree_destroy(r->context, bunched);
    r->stats.drawn_count = report.seen_count;
    r->stats.sort_s = fum_now_s() - start_s - report.draw_s;
    r->stats.draw_s = report.draw_s;
    return status;
  }
  int32_t status = fum_splats_find(r->context, job->octree, job->view, job->slabs, options, splats);
  if (status != FUM_OK) return status;
  fum_tiles_shade_dust(r->context, job, splats);
  r->stats.drawn_count = splats->seen_count;
  r->stats.sort_s = fum_now_s() - start_s;
  status = fum_tiles_draw(r->context, job);
  r->stats.draw_s = fum_now_s() - start_s - r->stats.sort_s;
  return status;
}

/* Drawing takes the most memory: what only lighting needs goes before it. */
static void settle(const fum_rendering *r, smoke_light *light) {
  const fum_media *media = &r->scene->caches->media;
  for (int32_t k = 0; k < media->count; k++)
    fum_medium_forget_bunches(r->context, &media->items[k]);
  fum_lattice_settle(r->context, &light->lattice);
}

int32_t fum_combine_with_tiles(fum_rendering *r) {
  const fum_octree *all = r->scene->caches->all;
  const float footprint = fum_footprint_sigmas(r->scene, r->settings.tolerance);
  const fum_viewpoint viewpoint = fum_find_viewpoint(&r->view);
  fum_tile_class classes[FUM_MAX_CLASSES];
  fum_lighting lighting = {0};
  fum_meter meter = {0};
  smoke_light light = {0};
  fum_splats splats = {0};
  fum_smeared blurred = {0};
  fum_tile_job job = {.scene = r->scene,
                      .octree = all,
                      .view = &r->view,
                      .slabs = &light.slabs,
                      .splats = &splats,
                      .smears = &blurred.smears,
                      .bokeh = &blurred.bokeh,
                      .lattice = &light.lattice,
                      .solids = r->scene->caches->solids,
                      .solid_shadow_intensity = r->settings.solid_shadow_intensity,
                      .solid_depths = r->solid.depths,
                      .solid_behind = r->solid.behind,
                      .solid_shares = r->solid.shares,
                      .through = {r->through[0], r->through[1]},
                      .straight = 0.5F * r->settings.tolerance,
                      .rgba = r->combined,
                      .light_rgb = r->lights,
                      .emission = r->emission,
                      .deep = r->deep,
                      /* pictures of single channels are divided once more when they are joined */
                      .deep_tolerance = (r->channel_share < 1.0F ? 0.5F : 1.0F) * r->settings.tolerance};
  const double start_s = fum_now_s();
  fum_solid_shadow_begin(r);
  int32_t status = fum_tiles_find_looks(r->scene, classes, &job);
  if (status == FUM_OK) status = fum_lighting_begin(r->scene, &r->settings, all, &lighting);
  lighting.gathering.viewpoint = &viewpoint;
  if (status == FUM_OK) status = fum_smeared_find(r, &blurred);
  const plan p = {r, &lighting, footprint, job.thinnest, &blurred.smears};
  if (status == FUM_OK) status = light_smoke(&p, &light, &meter);
  settle(r, &light);
  if (status != FUM_OK || light.slabs.count == 0) goto done;
  job.lamps = &lighting.lamps;
  use_centres(&light, &job);
  r->stats.light_points = light.centres != NULL ? all->count : light.lattice.lit_count;
  r->stats.slab_count = light.slabs.count;
  r->stats.meter_s += meter.seconds;
  fum_note_lighting(&lighting, r);
  r->stats.light_s = fum_now_s() - start_s - r->stats.meter_s;
  const fum_footprints footprints = drawn_footprints(r, &light.slabs);
  const fum_splats_options drawn = {.smears = blurred.smears.items != NULL ? &blurred.smears : NULL,
                                    .footprints = footprints,
                                    .thinnest = job.thinnest,
                                    .least_blur = fum_least_blur(&r->settings)};
  status = draw(r, &drawn, &job, &splats);
  job.deep = NULL; /* that was it */
  if (status == FUM_OK) status = draw_others(r, &lighting, &light, &job);
  memcpy(r->stats.device, "tiles", sizeof "tiles");
done:
  fum_free(r->context, &job.class_of);
  fum_splats_free(r->context, &splats);
  fum_smeared_free(r->context, &blurred);
  smoke_light_free(r->context, &light);
  fum_meter_end(&meter);
  fum_lighting_end(r->context, &lighting);
  return status;
}
