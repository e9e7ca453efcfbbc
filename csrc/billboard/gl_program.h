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
  GLint solid_depths, maps; /* samplers */
} fum_gl_program;

/* Texture units. */
enum { FUM_GL_SOLIDS_UNIT = 0, FUM_GL_MAPS_UNIT = 1, FUM_GL_BOKEH_UNIT = 2 };

/* Billboards as they are, with maps, or smeared. */
typedef enum fum_gl_kind { FUM_GL_PLAIN, FUM_GL_MAPPED, FUM_GL_SMEARED } fum_gl_kind;

/* Compiles and links the shaders built into the library. */
int32_t fum_gl_program_create(fum_gl_program *program, const fum_gl_functions *gl, fum_gl_kind kind,
                              fum_gl_error *error);

/* Makes the program current and tells it what it needs to know about a tile of a frame. */
void fum_gl_program_set_tile(const fum_gl_program *program, const fum_gl_functions *gl, const fum_frame *frame,
                             const fum_gl_tile *tile);

#endif
