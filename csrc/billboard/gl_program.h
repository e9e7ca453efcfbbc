/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The shaders that draw billboards, and the frame they draw in. */
#ifndef FUM_BILLBOARD_GL_PROGRAM_H
#define FUM_BILLBOARD_GL_PROGRAM_H

#include "billboard/billboard.h"
#include "billboard/gl_functions.h"

/* Part of the picture, pixels. */
typedef struct fum_gl_tile {
  int32_t x, y, width, height;
} fum_gl_tile;

typedef struct fum_gl_program {
  GLuint program;
  GLint orthographic, window, frame_size, tile_origin, tile_size, clip_depths, footprint_sigmas, has_solids;
} fum_gl_program;

/* Compiles and links the shaders built into the library, and makes them current. */
int32_t fum_gl_program_create(fum_gl_program *program, const fum_gl_functions *gl, fum_gl_error *error);

/* What the shaders need to know about a tile of a frame. */
void fum_gl_program_set_tile(const fum_gl_program *program, const fum_gl_functions *gl, const fum_frame *frame,
                             const fum_gl_tile *tile);

#endif
