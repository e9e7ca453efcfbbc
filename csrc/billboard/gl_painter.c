/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/gl_painter.h"

#include "billboard/gl_batch.h"

#include <stddef.h>
#include <stdio.h>

static int32_t check_cancelled(const fum_gl_job *job, fum_gl_error *error) {
  if (!fum_is_cancelled(job->context)) return FUM_OK;
  return fum_gl_error_set(error, FUM_ERROR_CANCELLED, "the render was cancelled");
}

static int32_t min_side(int32_t a, int32_t b) {
  return a < b ? a : b;
}

/* ---- Set-up ------------------------------------------------------------------------------------------------------ */

static void query_device(fum_gl_painter *painter) {
  const fum_gl_functions *gl = &painter->gl;
  GLint renderbuffer = 0, texture = 0, viewport[2] = {0, 0};
  gl->GetIntegerv(GL_MAX_RENDERBUFFER_SIZE, &renderbuffer);
  gl->GetIntegerv(GL_MAX_TEXTURE_SIZE, &texture);
  gl->GetIntegerv(GL_MAX_VIEWPORT_DIMS, viewport);
  painter->largest_texture = texture;
  painter->largest_side = min_side(min_side(renderbuffer, texture), min_side(viewport[0], viewport[1]));
  const GLubyte *name = gl->GetString(GL_RENDERER);
  snprintf(painter->device, sizeof painter->device, "%s", name != NULL ? (const char *)name : "OpenGL");
}

static void create_vertex_array(fum_gl_painter *painter) {
  const fum_gl_functions *gl = &painter->gl;
  gl->GenVertexArrays(1, &painter->vertex_array);
  gl->BindVertexArray(painter->vertex_array);
  gl->GenBuffers(1, &painter->vertex_buffer);
  gl->BindBuffer(GL_ARRAY_BUFFER, painter->vertex_buffer);
  gl->BufferData(GL_ARRAY_BUFFER, FUM_GL_MOST_BILLBOARDS * (GLsizeiptr)sizeof(fum_billboard), NULL, GL_STREAM_DRAW);
  fum_gl_attach_billboards(gl);
}

/* What billboards with maps need beside: the program, and room for how maps are seen. */
static int32_t prepare_maps(fum_gl_painter *painter, fum_gl_error *error) {
  const fum_gl_functions *gl = &painter->gl;
  fum_gl_program program = {0};
  if (painter->mapped_program.program != 0) return FUM_OK;
  const int32_t status = fum_gl_program_create(&program, gl, FUM_GL_MAPPED, error);
  if (status != FUM_OK) return status;
  gl->GenBuffers(1, &painter->look_buffer);
  gl->BindBuffer(GL_ARRAY_BUFFER, painter->look_buffer);
  gl->BufferData(GL_ARRAY_BUFFER, FUM_GL_MOST_BILLBOARDS * (GLsizeiptr)sizeof(fum_map_look), NULL, GL_STREAM_DRAW);
  gl->VertexAttribPointer(2, 4, GL_FLOAT, GL_FALSE, sizeof(fum_map_look), (const void *)offsetof(fum_map_look, across));
  gl->VertexAttribPointer(3, 3, GL_FLOAT, GL_FALSE, sizeof(fum_map_look), (const void *)offsetof(fum_map_look, up));
  gl->VertexAttribIPointer(4, 4, GL_INT, sizeof(fum_map_look), (const void *)offsetof(fum_map_look, begin));
  gl->BindBuffer(GL_ARRAY_BUFFER, painter->vertex_buffer);
  gl->ActiveTexture(GL_TEXTURE0 + FUM_GL_MAPS_UNIT);
  gl->GenTextures(1, &painter->map_texture);
  gl->BindTexture(GL_TEXTURE_2D, painter->map_texture);
  gl->TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
  gl->TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
  gl->ActiveTexture(GL_TEXTURE0 + FUM_GL_SOLIDS_UNIT);
  painter->mapped_program = program;
  return fum_gl_check(gl, "making room for maps", error);
}

/* All maps' texels one after the other, each from the beginning of a row on. */
static int32_t upload_maps(fum_gl_painter *painter, const fum_billboard_maps *maps, fum_gl_error *error) {
  const fum_gl_functions *gl = &painter->gl;
  int64_t rows = 0;
  for (int32_t m = 0; m < maps->count; m++)
    rows += fum_billboard_rows(maps->maps[m]);
  if (rows > painter->largest_texture) {
    return fum_gl_error_set(error, FUM_ERROR_DEVICE, "the OpenGL device \"%s\" has no room for maps of %lld texels",
                            painter->device, (long long)(rows * FUM_MAP_ROW));
  }
  gl->ActiveTexture(GL_TEXTURE0 + FUM_GL_MAPS_UNIT);
  gl->PixelStorei(GL_UNPACK_ROW_LENGTH, 0);
  gl->TexImage2D(GL_TEXTURE_2D, 0, GL_RGBA32F, FUM_MAP_ROW, (GLsizei)rows, 0, GL_RGBA, GL_FLOAT, NULL);
  int32_t status = fum_gl_check(gl, "making room for maps", error);
  GLint row = 0;
  for (int32_t m = 0; m < maps->count && status == FUM_OK; m++) {
    const fum_map *map = maps->maps[m];
    const GLsizei whole = (GLsizei)(map->texel_count / FUM_MAP_ROW), rest = (GLsizei)(map->texel_count % FUM_MAP_ROW);
    const float *last = map->texels + 4 * (int64_t)whole * FUM_MAP_ROW;
    if (whole > 0) gl->TexSubImage2D(GL_TEXTURE_2D, 0, 0, row, FUM_MAP_ROW, whole, GL_RGBA, GL_FLOAT, map->texels);
    if (rest > 0) gl->TexSubImage2D(GL_TEXTURE_2D, 0, 0, row + whole, rest, 1, GL_RGBA, GL_FLOAT, last);
    row += (GLint)fum_billboard_rows(map);
    status = fum_gl_check(gl, "uploading maps", error);
  }
  gl->ActiveTexture(GL_TEXTURE0 + FUM_GL_SOLIDS_UNIT);
  return status;
}

/* Turns what is drawn with maps on or off. */
static int32_t use_maps(fum_gl_painter *painter, const fum_billboard_maps *maps, fum_gl_error *error) {
  const fum_gl_functions *gl = &painter->gl;
  int32_t status = maps != NULL ? prepare_maps(painter, error) : FUM_OK;
  for (GLuint attribute = 2; attribute <= 4 && status == FUM_OK; attribute++)
    (maps != NULL ? gl->EnableVertexAttribArray : gl->DisableVertexAttribArray)(attribute);
  return status == FUM_OK && maps != NULL ? upload_maps(painter, maps, error) : status;
}

static void create_target(fum_gl_painter *painter) {
  const fum_gl_functions *gl = &painter->gl;
  gl->GenRenderbuffers(1, &painter->color_buffer);
  gl->BindRenderbuffer(GL_RENDERBUFFER, painter->color_buffer);
  gl->GenFramebuffers(1, &painter->framebuffer);
  gl->BindFramebuffer(GL_FRAMEBUFFER, painter->framebuffer);
  gl->GenTextures(1, &painter->solid_texture);
  gl->ActiveTexture(GL_TEXTURE0 + FUM_GL_SOLIDS_UNIT);
  gl->BindTexture(GL_TEXTURE_2D, painter->solid_texture);
  gl->TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
  gl->TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
  gl->Enable(GL_BLEND);
  gl->BlendFunc(GL_ONE, GL_ONE_MINUS_SRC_ALPHA);
  gl->ClearColor(0.0f, 0.0f, 0.0f, 0.0f);
}

static int32_t resize_target(fum_gl_painter *painter, int32_t width, int32_t height, fum_gl_error *error) {
  const fum_gl_functions *gl = &painter->gl;
  if (painter->target_width == width && painter->target_height == height) return FUM_OK;
  painter->target_width = painter->target_height = 0;
  gl->RenderbufferStorage(GL_RENDERBUFFER, GL_RGBA32F, width, height);
  int32_t status = fum_gl_check(gl, "making room for the picture", error);
  if (status != FUM_OK) return status;
  gl->FramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, painter->color_buffer);
  if (gl->CheckFramebufferStatus(GL_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE) {
    return fum_gl_error_set(error, FUM_ERROR_DEVICE,
                            "the OpenGL device \"%s\" can't draw into a picture of 32-bit floats", painter->device);
  }
  painter->target_width = width;
  painter->target_height = height;
  return FUM_OK;
}

/* Drivers compile parts of the program when something is drawn for the first time; this moves it out of the first
 * picture. */
static int32_t warm_up(fum_gl_painter *painter, fum_gl_error *error) {
  const fum_gl_functions *gl = &painter->gl;
  const int32_t status = resize_target(painter, 1, 1, error);
  if (status != FUM_OK) return status;
  const fum_billboard billboard = {.center = {0, 0, -1}, .sigma = 1, .optical_depth = 1};
  const fum_frame frame = {.width = 1, .height = 1, .window = {-1, 1, -1, 1}, .clip_end = 2, .footprint_sigmas = 3};
  gl->Viewport(0, 0, 1, 1);
  gl->BufferSubData(GL_ARRAY_BUFFER, 0, sizeof billboard, &billboard);
  fum_gl_program_set_tile(&painter->program, gl, &frame, &(fum_gl_tile){.width = 1, .height = 1});
  gl->DrawArrays(GL_POINTS, 0, 1);
  gl->Finish();
  return fum_gl_check(gl, "drawing for the first time", error);
}

int32_t fum_gl_painter_open(fum_gl_painter *painter, fum_gl_error *error) {
  int32_t status = fum_egl_open(&painter->egl, error);
  if (status != FUM_OK) return status;
  if ((status = fum_gl_functions_load(&painter->gl, &painter->egl, error)) != FUM_OK) goto done;
  query_device(painter);
  if ((status = fum_gl_program_create(&painter->program, &painter->gl, FUM_GL_PLAIN, error)) != FUM_OK) goto done;
  create_vertex_array(painter);
  create_target(painter);
  if ((status = fum_gl_check(&painter->gl, "making buffers", error)) != FUM_OK) goto done;
  painter->fragments_per_s = 2e7; /* a slow start: the first batches measure it */
  status = warm_up(painter, error);
done:
  if (status != FUM_OK) fum_egl_close(&painter->egl);
  return status;
}

void fum_gl_painter_close(fum_gl_painter *painter) {
  fum_egl_close(&painter->egl);
}

/* ---- Drawing ----------------------------------------------------------------------------------------------------- */

static int32_t upload_solids(fum_gl_painter *painter, const fum_frame *frame, const fum_gl_tile *tile,
                             fum_gl_error *error) {
  const fum_gl_functions *gl = &painter->gl;
  if (frame->solid_depths == NULL) return FUM_OK;
  if (painter->solid_width != painter->target_width || painter->solid_height != painter->target_height) {
    painter->solid_width = painter->solid_height = 0;
    gl->TexImage2D(GL_TEXTURE_2D, 0, GL_R32F, painter->target_width, painter->target_height, 0, GL_RED, GL_FLOAT, NULL);
    const int32_t status = fum_gl_check(gl, "making room for the depth of solids", error);
    if (status != FUM_OK) return status;
    painter->solid_width = painter->target_width;
    painter->solid_height = painter->target_height;
  }
  gl->PixelStorei(GL_UNPACK_ROW_LENGTH, frame->width);
  gl->TexSubImage2D(GL_TEXTURE_2D, 0, 0, 0, tile->width, tile->height, GL_RED, GL_FLOAT,
                    frame->solid_depths + (int64_t)tile->y * frame->width + tile->x);
  return fum_gl_check(gl, "uploading the depth of solids", error);
}

/* The speed decides how much the next batch holds. It may change by a factor of four at a time, so that one odd
 * measurement makes no batch of a second. */
static void note_speed(fum_gl_painter *painter, double fragments, double seconds) {
  const double last = painter->fragments_per_s, measured = fragments / (seconds + 1e-6);
  painter->fragments_per_s = measured > 4 * last ? 4 * last : measured < last / 4 ? last / 4 : measured;
  const double slowest = 1e5;
  if (painter->fragments_per_s < slowest) painter->fragments_per_s = slowest;
}

static int32_t draw_batch(fum_gl_painter *painter, const fum_gl_job *job, const fum_gl_tile *tile,
                          const fum_gl_batch *batch, fum_gl_error *error) {
  const fum_gl_functions *gl = &painter->gl;
  if (job->frame->blur != NULL) fum_gl_smear_upload(&painter->smear, gl, job->frame->blur, batch->first, batch->count);
  gl->BindBuffer(GL_ARRAY_BUFFER, painter->vertex_buffer);
  gl->BufferSubData(GL_ARRAY_BUFFER, 0, batch->count * (GLsizeiptr)sizeof(fum_billboard),
                    job->billboards + batch->first);
  if (job->frame->maps != NULL) {
    gl->BindBuffer(GL_ARRAY_BUFFER, painter->look_buffer);
    gl->BufferSubData(GL_ARRAY_BUFFER, 0, batch->count * (GLsizeiptr)sizeof(fum_map_look),
                      job->frame->maps->looks + batch->first);
    gl->BindBuffer(GL_ARRAY_BUFFER, painter->vertex_buffer);
  }
  for (int32_t band = 0; band < batch->bands; band++) {
    const int32_t bottom = (int32_t)((int64_t)tile->height * band / batch->bands);
    const int32_t top = (int32_t)((int64_t)tile->height * (band + 1) / batch->bands);
    const int32_t status = check_cancelled(job, error);
    if (status != FUM_OK) return status;
    const double start_s = fum_now_s();
    gl->Scissor(0, bottom, tile->width, top - bottom);
    gl->DrawArrays(GL_POINTS, 0, (GLsizei)batch->count);
    gl->Finish();
    note_speed(painter, batch->cost / batch->bands, fum_now_s() - start_s);
  }
  return fum_gl_check(gl, "drawing billboards", error);
}

/* In strips, because reading a large tile takes longer than a cancel may. */
static int32_t read_tile(fum_gl_painter *painter, const fum_gl_job *job, const fum_gl_tile *tile, fum_gl_error *error) {
  enum { STRIP_PIXELS = 1 << 22 };
  const fum_gl_functions *gl = &painter->gl;
  const int32_t rows = STRIP_PIXELS / tile->width > 0 ? STRIP_PIXELS / tile->width : 1;
  gl->PixelStorei(GL_PACK_ROW_LENGTH, job->frame->width);
  for (int32_t row = 0; row < tile->height; row += rows) {
    const int32_t status = check_cancelled(job, error);
    if (status != FUM_OK) return status;
    gl->ReadPixels(0, row, tile->width, min_side(rows, tile->height - row), GL_RGBA, GL_FLOAT,
                   job->pixels + 4 * ((int64_t)(tile->y + row) * job->frame->width + tile->x));
  }
  return fum_gl_check(gl, "reading the picture back", error);
}

static int32_t draw_tile(fum_gl_painter *painter, const fum_gl_job *job, const fum_gl_tile *tile, double done_share,
                         double tile_share, fum_gl_error *error) {
  const double batch_s = 0.05;
  const fum_gl_functions *gl = &painter->gl;
  int32_t status = upload_solids(painter, job->frame, tile, error);
  if (status != FUM_OK) return status;
  const bool is_blurred = job->frame->blur != NULL, has_maps = job->frame->maps != NULL;
  fum_gl_program_set_tile(is_blurred ? &painter->smear.program
                          : has_maps ? &painter->mapped_program
                                     : &painter->program,
                          gl, job->frame, tile);
  gl->Viewport(0, 0, tile->width, tile->height);
  gl->Disable(GL_SCISSOR_TEST);
  gl->Clear(GL_COLOR_BUFFER_BIT);
  gl->Enable(GL_SCISSOR_TEST);
  for (int64_t first = 0; first < job->count;) {
    const fum_gl_batch batch =
        fum_gl_batch_next(job->frame, tile, job->billboards, first, job->count, batch_s * painter->fragments_per_s);
    if ((status = draw_batch(painter, job, tile, &batch, error)) != FUM_OK) return status;
    first += batch.count;
    atomic_store(job->progress, (float)(done_share + tile_share * (double)first / (double)job->count));
  }
  return read_tile(painter, job, tile, error);
}

/* Makes the shaders and buffers current that the picture is drawn with. */
static int32_t begin(fum_gl_painter *painter, const fum_frame *frame, fum_gl_error *error) {
  if (frame->blur != NULL) {
    return fum_gl_smear_begin(&painter->smear, &painter->gl, frame->blur, painter->vertex_buffer,
                              FUM_GL_MOST_BILLBOARDS, error);
  }
  painter->gl.BindVertexArray(painter->vertex_array);
  painter->gl.BindBuffer(GL_ARRAY_BUFFER, painter->vertex_buffer);
  return use_maps(painter, frame->maps, error);
}

int32_t fum_gl_painter_draw(fum_gl_painter *painter, const fum_gl_job *job, fum_gl_error *error) {
  enum { TILE_PIXELS = 1 << 24 }; /* 256 MiB on the device */
  const fum_frame *frame = job->frame;
  const int32_t side = min_side(painter->largest_side, job->tile_limit);
  const int32_t tile_width = min_side(frame->width, side);
  const int32_t tile_height = min_side(frame->height, min_side(side, TILE_PIXELS / tile_width));
  const int32_t columns = (frame->width + tile_width - 1) / tile_width;
  const int32_t rows = (frame->height + tile_height - 1) / tile_height;
  const double tile_share = 1.0 / ((double)columns * rows);
  int32_t status = resize_target(painter, tile_width, tile_height, error);
  if (status == FUM_OK) status = begin(painter, frame, error);
  for (int32_t i = 0; i < columns * rows && status == FUM_OK; i++) {
    const int32_t x = i % columns * tile_width, y = i / columns * tile_height;
    const fum_gl_tile tile = {.x = x,
                              .y = y,
                              .width = min_side(tile_width, frame->width - x),
                              .height = min_side(tile_height, frame->height - y)};
    status = draw_tile(painter, job, &tile, i * tile_share, tile_share, error);
  }
  return status;
}
