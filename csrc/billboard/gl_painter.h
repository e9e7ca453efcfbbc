/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Draws billboards with OpenGL, tile by tile, on the thread that opened it. */
#ifndef FUM_BILLBOARD_GL_PAINTER_H
#define FUM_BILLBOARD_GL_PAINTER_H

#include "base/context.h"
#include "billboard/gl_smear.h"

typedef struct fum_gl_painter {
  fum_egl egl;
  fum_gl_functions gl;
  fum_gl_program program, mapped_program; /* the second is made when first needed: program 0 before */
  fum_gl_smear smear;
  GLuint vertex_array, vertex_buffer, look_buffer, framebuffer, color_buffer, solid_texture, map_texture;
  int32_t target_width, target_height, solid_width, solid_height; /* as allocated; 0: not yet */
  int32_t largest_side, largest_texture;                          /* of a target and of a texture, pixels */
  double fragments_per_s;                                         /* of the last batch */
  char device[128];
} fum_gl_painter;

/* A picture to draw. */
typedef struct fum_gl_job {
  const fum_context *context; /* only asked whether the user has cancelled */
  const fum_frame *frame;
  int64_t count;
  const fum_billboard *billboards;
  int32_t tile_limit;      /* longest side of a tile, pixels; the device's own limit holds as well */
  float *pixels;           /* [height][width][4] */
  _Atomic float *progress; /* 0..1 */
} fum_gl_job;

/* On failure nothing is left open. */
int32_t fum_gl_painter_open(fum_gl_painter *painter, fum_gl_error *error);
void fum_gl_painter_close(fum_gl_painter *painter);

int32_t fum_gl_painter_draw(fum_gl_painter *painter, const fum_gl_job *job, fum_gl_error *error);

#endif
