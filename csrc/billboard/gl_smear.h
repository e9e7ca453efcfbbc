/* SPDX-License-Identifier: GPL-3.0-or-later */
/* What OpenGL needs to draw smeared billboards, made when the first of them come. */
#ifndef FUM_BILLBOARD_GL_SMEAR_H
#define FUM_BILLBOARD_GL_SMEAR_H

#include "billboard/gl_program.h"

typedef struct fum_gl_smear {
  bool is_open;
  fum_gl_program program;
  GLuint vertex_array, smear_buffer, bokeh_texture;
} fum_gl_smear;

/* Tells the current vertex array what the current buffer of billboards holds. */
void fum_gl_attach_billboards(const fum_gl_functions *gl);

/* Makes shaders and buffers of a picture that is blurred current; `billboard_buffer` holds its billboards, and
 * `most_billboards` at once. */
int32_t fum_gl_smear_begin(fum_gl_smear *smear, const fum_gl_functions *gl, const fum_frame_blur *blur,
                           GLuint billboard_buffer, int32_t most_billboards, fum_gl_error *error);

/* The smears of the billboards `first` to `first + count`. */
void fum_gl_smear_upload(const fum_gl_smear *smear, const fum_gl_functions *gl, const fum_frame_blur *blur,
                         int64_t first, int64_t count);

#endif
