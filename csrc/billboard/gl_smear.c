/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/gl_smear.h"

#include <stddef.h>

void fum_gl_attach_billboards(const fum_gl_functions *gl) {
  gl->VertexAttribPointer(0, 4, GL_FLOAT, GL_FALSE, sizeof(fum_billboard),
                          (const void *)offsetof(fum_billboard, center));
  gl->VertexAttribPointer(1, 4, GL_FLOAT, GL_FALSE, sizeof(fum_billboard),
                          (const void *)offsetof(fum_billboard, optical_depth));
  gl->EnableVertexAttribArray(0);
  gl->EnableVertexAttribArray(1);
}

static int32_t open_smear(fum_gl_smear *smear, const fum_gl_functions *gl, GLuint billboard_buffer,
                          int32_t most_billboards, fum_gl_error *error) {
  const int32_t status = fum_gl_program_create(&smear->program, gl, FUM_GL_SMEARED, error);
  if (status != FUM_OK) return status;
  gl->GenVertexArrays(1, &smear->vertex_array);
  gl->BindVertexArray(smear->vertex_array);
  gl->BindBuffer(GL_ARRAY_BUFFER, billboard_buffer);
  fum_gl_attach_billboards(gl);
  gl->GenBuffers(1, &smear->smear_buffer);
  gl->BindBuffer(GL_ARRAY_BUFFER, smear->smear_buffer);
  gl->BufferData(GL_ARRAY_BUFFER, most_billboards * (GLsizeiptr)sizeof(fum_billboard_smear), NULL, GL_STREAM_DRAW);
  gl->VertexAttribPointer(2, 4, GL_FLOAT, GL_FALSE, sizeof(fum_billboard_smear), NULL);
  gl->EnableVertexAttribArray(2);
  gl->GenTextures(1, &smear->bokeh_texture);
  gl->ActiveTexture(GL_TEXTURE0 + FUM_GL_BOKEH_UNIT);
  gl->BindTexture(GL_TEXTURE_2D, smear->bokeh_texture);
  gl->TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
  gl->TexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
  smear->is_open = true;
  return fum_gl_check(gl, "making buffers for motion", error);
}

static void set_blur(const fum_gl_smear *smear, const fum_gl_functions *gl, const fum_frame_blur *blur) {
  const fum_bokeh *bokeh = blur->bokeh;
  const GLuint program = smear->program.program;
  const float ratios[3] = {FUM_BOKEH_LEAST, FUM_BOKEH_STEP, FUM_BOKEH_MOST};
  float levels[3 * FUM_BOKEH_LEVELS];
  for (int32_t i = 0; i < FUM_BOKEH_LEVELS; i++) {
    levels[3 * i] = (float)bokeh->levels[i].first;
    levels[3 * i + 1] = (float)bokeh->levels[i].side;
    levels[3 * i + 2] = bokeh->levels[i].per_unit;
  }
  gl->Uniform1i(gl->GetUniformLocation(program, "bokeh_values"), FUM_GL_BOKEH_UNIT);
  gl->Uniform1f(gl->GetUniformLocation(program, "confusion_per_depth"), blur->confusion_per_depth);
  gl->Uniform2f(gl->GetUniformLocation(program, "aperture"), blur->extent, bokeh->variance);
  gl->Uniform3fv(gl->GetUniformLocation(program, "bokeh_levels"), FUM_BOKEH_LEVELS, levels);
  gl->Uniform3fv(gl->GetUniformLocation(program, "bokeh_ratios"), 1, ratios);
}

int32_t fum_gl_smear_begin(fum_gl_smear *smear, const fum_gl_functions *gl, const fum_frame_blur *blur,
                           GLuint billboard_buffer, int32_t most_billboards, fum_gl_error *error) {
  const fum_bokeh *bokeh = blur->bokeh;
  if (!smear->is_open) {
    const int32_t status = open_smear(smear, gl, billboard_buffer, most_billboards, error);
    if (status != FUM_OK) return status;
  }
  gl->UseProgram(smear->program.program);
  gl->BindVertexArray(smear->vertex_array);
  set_blur(smear, gl, blur);
  gl->ActiveTexture(GL_TEXTURE0 + FUM_GL_BOKEH_UNIT);
  gl->BindTexture(GL_TEXTURE_2D, smear->bokeh_texture);
  gl->PixelStorei(GL_UNPACK_ROW_LENGTH, 0);
  const float nothing = 0.0F;
  const bool has_bokeh = bokeh->values != NULL;
  gl->TexImage2D(GL_TEXTURE_2D, 0, GL_R32F, has_bokeh ? bokeh->width : 1, has_bokeh ? bokeh->height : 1, 0, GL_RED,
                 GL_FLOAT, has_bokeh ? bokeh->values : &nothing);
  gl->ActiveTexture(GL_TEXTURE0 + FUM_GL_SOLIDS_UNIT);
  return fum_gl_check(gl, "making room for images of the aperture", error);
}

void fum_gl_smear_upload(const fum_gl_smear *smear, const fum_gl_functions *gl, const fum_frame_blur *blur,
                         int64_t first, int64_t count) {
  gl->BindBuffer(GL_ARRAY_BUFFER, smear->smear_buffer);
  gl->BufferSubData(GL_ARRAY_BUFFER, 0, count * (GLsizeiptr)sizeof *blur->smears, blur->smears + first);
}
