/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/gl_program.h"

/* The files in shaders/, see CMakeLists.txt. */
extern const char fum_shader_billboard_vert[], fum_shader_billboard_geom[], fum_shader_billboard_frag[];
extern const char fum_shader_smear_vert[], fum_shader_smear_geom[], fum_shader_smear_frag[];
extern const char fum_shader_outline_glsl[], fum_shader_normal_glsl[];

/* A shader: what it shares with others, and its own. */
typedef struct shader {
  GLenum stage;
  const char *name, *shared, *source;
} shader;

static int32_t attach_shader(GLuint program, const fum_gl_functions *gl, const shader *from, bool has_maps,
                             fum_gl_error *error) {
  GLint compiled = GL_FALSE;
  const GLuint id = gl->CreateShader(from->stage);
  const char *sources[] = {"#version 330 core\n", has_maps ? "#define MAPS\n" : "", from->shared, from->source};
  gl->ShaderSource(id, sizeof sources / sizeof *sources, sources, NULL);
  gl->CompileShader(id);
  gl->GetShaderiv(id, GL_COMPILE_STATUS, &compiled);
  if (!compiled) {
    char log[512] = "";
    gl->GetShaderInfoLog(id, sizeof log, NULL, log);
    return fum_gl_error_set(error, FUM_ERROR_DEVICE, "the OpenGL driver refuses the shader %s: %s", from->name, log);
  }
  gl->AttachShader(program, id);
  gl->DeleteShader(id);
  return FUM_OK;
}

static void find_uniforms(fum_gl_program *program, const fum_gl_functions *gl) {
  program->orthographic = gl->GetUniformLocation(program->program, "orthographic");
  program->window = gl->GetUniformLocation(program->program, "window");
  program->frame_size = gl->GetUniformLocation(program->program, "frame_size");
  program->tile_origin = gl->GetUniformLocation(program->program, "tile_origin");
  program->tile_size = gl->GetUniformLocation(program->program, "tile_size");
  program->clip_depths = gl->GetUniformLocation(program->program, "clip_depths");
  program->footprint_sigmas = gl->GetUniformLocation(program->program, "footprint_sigmas");
  program->has_solids = gl->GetUniformLocation(program->program, "has_solids");
  program->solid_depths = gl->GetUniformLocation(program->program, "solid_depths");
  program->maps = gl->GetUniformLocation(program->program, "maps");
}

int32_t fum_gl_program_create(fum_gl_program *program, const fum_gl_functions *gl, fum_gl_kind kind,
                              fum_gl_error *error) {
  const shader plain[] = {{GL_VERTEX_SHADER, "billboard.vert", "", fum_shader_billboard_vert},
                          {GL_GEOMETRY_SHADER, "billboard.geom", fum_shader_outline_glsl, fum_shader_billboard_geom},
                          {GL_FRAGMENT_SHADER, "billboard.frag", fum_shader_normal_glsl, fum_shader_billboard_frag}};
  const shader smeared[] = {{GL_VERTEX_SHADER, "smear.vert", "", fum_shader_smear_vert},
                            {GL_GEOMETRY_SHADER, "smear.geom", fum_shader_outline_glsl, fum_shader_smear_geom},
                            {GL_FRAGMENT_SHADER, "smear.frag", fum_shader_normal_glsl, fum_shader_smear_frag}};
  program->program = gl->CreateProgram();
  for (int i = 0; i < 3; i++) {
    const int32_t status = attach_shader(program->program, gl, kind == FUM_GL_SMEARED ? &smeared[i] : &plain[i],
                                         kind == FUM_GL_MAPPED, error);
    if (status != FUM_OK) return status;
  }
  GLint linked = GL_FALSE;
  gl->LinkProgram(program->program);
  gl->GetProgramiv(program->program, GL_LINK_STATUS, &linked);
  if (!linked) {
    char log[512] = "";
    gl->GetProgramInfoLog(program->program, sizeof log, NULL, log);
    return fum_gl_error_set(error, FUM_ERROR_DEVICE, "the OpenGL driver can't link the billboard shaders: %s", log);
  }
  find_uniforms(program, gl);
  return fum_gl_check(gl, "building the shaders", error);
}

void fum_gl_program_set_tile(const fum_gl_program *program, const fum_gl_functions *gl, const fum_frame *frame,
                             const fum_gl_tile *tile) {
  gl->UseProgram(program->program);
  gl->Uniform1i(program->orthographic, frame->type == FUM_CAMERA_ORTHOGRAPHIC);
  gl->Uniform4fv(program->window, 1, frame->window);
  gl->Uniform2f(program->frame_size, (float)frame->width, (float)frame->height);
  gl->Uniform2f(program->tile_origin, (float)tile->x, (float)tile->y);
  gl->Uniform2f(program->tile_size, (float)tile->width, (float)tile->height);
  gl->Uniform2f(program->clip_depths, frame->clip_start, frame->clip_end);
  gl->Uniform1f(program->footprint_sigmas, frame->footprint_sigmas);
  gl->Uniform1i(program->has_solids, frame->solid_depths != NULL);
  gl->Uniform1i(program->solid_depths, FUM_GL_SOLIDS_UNIT);
  gl->Uniform1i(program->maps, FUM_GL_MAPS_UNIT); /* -1, which is no matter, without maps */
}
