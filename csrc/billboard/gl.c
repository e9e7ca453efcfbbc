/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/gl.h"

#include "billboard/gl_painter.h"

#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

struct fum_gl {
  pthread_t thread;
  pthread_mutex_t mutex; /* guards what follows down to `error` */
  pthread_cond_t changed;
  bool busy; /* the thread opens the device or draws `job` */
  bool opened;
  bool quit;
  const fum_gl_job *job;
  int32_t status; /* of what the thread did last */
  fum_gl_error error;
  _Atomic float progress;
  fum_gl_painter painter; /* the thread's own */
};

/* ---- The drawing thread ------------------------------------------------------------------------------------------ */

static void finish(struct fum_gl *gl, int32_t status, const fum_gl_error *error) {
  gl->status = status;
  gl->error = *error;
  gl->job = NULL;
  gl->busy = false;
  pthread_cond_broadcast(&gl->changed);
}

static void *run_thread(void *user) {
  struct fum_gl *gl = user;
  fum_gl_error error = {.code = FUM_OK};
  int32_t status = fum_gl_painter_open(&gl->painter, &error);
  pthread_mutex_lock(&gl->mutex);
  const bool opened = gl->opened = status == FUM_OK;
  finish(gl, status, &error);
  while (!gl->quit) {
    if (gl->job == NULL) {
      pthread_cond_wait(&gl->changed, &gl->mutex);
      continue;
    }
    const fum_gl_job *job = gl->job;
    pthread_mutex_unlock(&gl->mutex);
    status = fum_gl_painter_draw(&gl->painter, job, &error);
    pthread_mutex_lock(&gl->mutex);
    finish(gl, status, &error);
  }
  pthread_mutex_unlock(&gl->mutex);
  if (opened) fum_gl_painter_close(&gl->painter);
  return NULL;
}

/* The thread takes no signals: a host's handlers, Python's among them, count on their own threads. */
static int start_thread(struct fum_gl *gl) {
  sigset_t all, before;
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &before);
  const int failed = pthread_create(&gl->thread, NULL, run_thread, gl);
  pthread_sigmask(SIG_SETMASK, &before, NULL);
  return failed;
}

static int32_t create(fum_context *context) {
  struct fum_gl *gl = calloc(1, sizeof *gl);
  if (gl == NULL) return fum_fail(context, FUM_ERROR_MEMORY, "no memory for the drawing thread");
  pthread_condattr_t attributes;
  pthread_condattr_init(&attributes);
  pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
  pthread_mutex_init(&gl->mutex, NULL);
  pthread_cond_init(&gl->changed, &attributes);
  pthread_condattr_destroy(&attributes);
  gl->busy = true;
  const int failed = start_thread(gl);
  if (failed) {
    pthread_cond_destroy(&gl->changed);
    pthread_mutex_destroy(&gl->mutex);
    free(gl);
    return fum_fail(context, FUM_ERROR_MEMORY, "the drawing thread can't be started: %s", strerror(failed));
  }
  context->gl = gl;
  return FUM_OK;
}

void fum_gl_destroy(struct fum_gl *gl) {
  if (gl == NULL) return;
  pthread_mutex_lock(&gl->mutex);
  gl->quit = true;
  pthread_cond_broadcast(&gl->changed);
  pthread_mutex_unlock(&gl->mutex);
  pthread_join(gl->thread, NULL);
  pthread_cond_destroy(&gl->changed);
  pthread_mutex_destroy(&gl->mutex);
  free(gl);
}

/* ---- The calling thread ------------------------------------------------------------------------------------------ */

/* Waits a moment for the drawing thread; returns whether it is still busy. */
static bool wait_step(struct fum_gl *gl) {
  const long step_ns = 20000000, second_ns = 1000000000;
  struct timespec until;
  clock_gettime(CLOCK_MONOTONIC, &until);
  until.tv_nsec += step_ns;
  until.tv_sec += until.tv_nsec / second_ns;
  until.tv_nsec %= second_ns;
  pthread_mutex_lock(&gl->mutex);
  if (gl->busy) pthread_cond_timedwait(&gl->changed, &gl->mutex, &until);
  const bool busy = gl->busy;
  pthread_mutex_unlock(&gl->mutex);
  return busy;
}

static int32_t report_thread_error(fum_context *context, const struct fum_gl *gl) {
  return fum_fail(context, gl->status, "%s", gl->error.text);
}

/* Starts the thread on the first call and waits until its device is open. A cancel doesn't wait: the device is ready
 * for the next call then. A device that doesn't open is tried again by the next call. */
static int32_t open_device(fum_context *context) {
  int32_t status = FUM_OK;
  if (context->gl == NULL && (status = create(context)) != FUM_OK) return status;
  while (wait_step(context->gl)) {
    status = fum_progress_report(context, FUM_STAGE_DRAWING, 0.0f, "Opening the drawing device");
    if (status != FUM_OK) return status;
  }
  if (context->gl->opened) return FUM_OK;
  status = report_thread_error(context, context->gl);
  fum_gl_destroy(context->gl);
  context->gl = NULL;
  return status;
}

/* Returns only when the thread is done with the job, which points to the caller's arrays. */
static int32_t run_job(fum_context *context, const fum_gl_job *job) {
  struct fum_gl *gl = context->gl;
  char message[64];
  snprintf(message, sizeof message, "Drawing %lld particles", (long long)job->count);
  pthread_mutex_lock(&gl->mutex);
  gl->job = job;
  gl->busy = true;
  pthread_cond_broadcast(&gl->changed);
  pthread_mutex_unlock(&gl->mutex);
  while (wait_step(gl))
    fum_progress_report(context, FUM_STAGE_DRAWING, atomic_load(&gl->progress), message);
  if (gl->status != FUM_OK) return report_thread_error(context, gl);
  return fum_progress_report(context, FUM_STAGE_DRAWING, 1.0f, message);
}

int32_t fum_gl_draw_tiled(fum_context *context, const fum_frame *frame, int64_t count, const fum_billboard *billboards,
                          int32_t tile_limit, float *out_rgba, char out_device[128]) {
  const int64_t pixel_count = (int64_t)frame->width * frame->height;
  float *pixels = NULL;
  if (count == 0) {
    memset(out_rgba, 0, (size_t)pixel_count * 4 * sizeof *out_rgba);
    out_device[0] = '\0';
    return FUM_OK;
  }
  int32_t status = open_device(context);
  if (status != FUM_OK) goto done;
  if ((status = fum_alloc(context, pixel_count, 4 * sizeof *pixels, "picture", &pixels)) != FUM_OK) goto done;
  atomic_store(&context->gl->progress, 0.0f);
  const fum_gl_job job = {.context = context,
                          .frame = frame,
                          .count = count,
                          .billboards = billboards,
                          .tile_limit = tile_limit,
                          .pixels = pixels,
                          .progress = &context->gl->progress};
  if ((status = run_job(context, &job)) != FUM_OK) goto done;
  memcpy(out_rgba, pixels, (size_t)pixel_count * 4 * sizeof *pixels);
  memcpy(out_device, context->gl->painter.device, sizeof context->gl->painter.device);
done:
  fum_free(context, &pixels);
  return status;
}

int32_t fum_gl_draw(fum_context *context, const fum_frame *frame, int64_t count, const fum_billboard *billboards,
                    float *out_rgba, char out_device[128]) {
  return fum_gl_draw_tiled(context, frame, count, billboards, INT32_MAX, out_rgba, out_device);
}
