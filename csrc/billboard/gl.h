/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Draws billboards with OpenGL. The context lives on a thread of its own: a host's threads may hold contexts of their
 * own, which ours must not replace. */
#ifndef FUM_BILLBOARD_GL_H
#define FUM_BILLBOARD_GL_H

#include "base/context.h"
#include "billboard/billboard.h"

struct fum_gl;

/* Draws billboards, sorted back to front, over a transparent picture. `out_rgba` [height][width][4] is premultiplied,
 * first row at the bottom. `out_device` names what drew, "" when there was nothing to draw. */
int32_t fum_gl_draw(fum_context *context, const fum_frame *frame, int64_t count, const fum_billboard *billboards,
                    float *out_rgba, char out_device[128]);

/* The same with tiles of at most `tile_limit` pixels a side; fum_gl_draw leaves that to the device. */
int32_t fum_gl_draw_tiled(fum_context *context, const fum_frame *frame, int64_t count, const fum_billboard *billboards,
                          int32_t tile_limit, float *out_rgba, char out_device[128]);

/* Ends the drawing thread. NULL is allowed. */
void fum_gl_destroy(struct fum_gl *gl);

#endif
