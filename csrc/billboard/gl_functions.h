/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The OpenGL 3.3 core functions in use, looked up by name so that nothing needs linking to a GL library. */
#ifndef FUM_BILLBOARD_GL_FUNCTIONS_H
#define FUM_BILLBOARD_GL_FUNCTIONS_H

#include "billboard/egl.h"

#include <GL/glcorearb.h>

#define FUM_GL_FUNCTIONS(X)                                                                                            \
  X(PFNGLACTIVETEXTUREPROC, ActiveTexture)                                                                             \
  X(PFNGLATTACHSHADERPROC, AttachShader)                                                                               \
  X(PFNGLBINDBUFFERPROC, BindBuffer)                                                                                   \
  X(PFNGLBINDFRAMEBUFFERPROC, BindFramebuffer)                                                                         \
  X(PFNGLBINDRENDERBUFFERPROC, BindRenderbuffer)                                                                       \
  X(PFNGLBINDTEXTUREPROC, BindTexture)                                                                                 \
  X(PFNGLBINDVERTEXARRAYPROC, BindVertexArray)                                                                         \
  X(PFNGLBLENDFUNCPROC, BlendFunc)                                                                                     \
  X(PFNGLBUFFERDATAPROC, BufferData)                                                                                   \
  X(PFNGLBUFFERSUBDATAPROC, BufferSubData)                                                                             \
  X(PFNGLCHECKFRAMEBUFFERSTATUSPROC, CheckFramebufferStatus)                                                           \
  X(PFNGLCLEARPROC, Clear)                                                                                             \
  X(PFNGLCLEARCOLORPROC, ClearColor)                                                                                   \
  X(PFNGLCOMPILESHADERPROC, CompileShader)                                                                             \
  X(PFNGLCREATEPROGRAMPROC, CreateProgram)                                                                             \
  X(PFNGLCREATESHADERPROC, CreateShader)                                                                               \
  X(PFNGLDELETESHADERPROC, DeleteShader)                                                                               \
  X(PFNGLDISABLEPROC, Disable)                                                                                         \
  X(PFNGLDRAWARRAYSPROC, DrawArrays)                                                                                   \
  X(PFNGLDISABLEVERTEXATTRIBARRAYPROC, DisableVertexAttribArray)                                                       \
  X(PFNGLENABLEPROC, Enable)                                                                                           \
  X(PFNGLENABLEVERTEXATTRIBARRAYPROC, EnableVertexAttribArray)                                                         \
  X(PFNGLFINISHPROC, Finish)                                                                                           \
  X(PFNGLFRAMEBUFFERRENDERBUFFERPROC, FramebufferRenderbuffer)                                                         \
  X(PFNGLGENBUFFERSPROC, GenBuffers)                                                                                   \
  X(PFNGLGENFRAMEBUFFERSPROC, GenFramebuffers)                                                                         \
  X(PFNGLGENRENDERBUFFERSPROC, GenRenderbuffers)                                                                       \
  X(PFNGLGENTEXTURESPROC, GenTextures)                                                                                 \
  X(PFNGLGENVERTEXARRAYSPROC, GenVertexArrays)                                                                         \
  X(PFNGLGETERRORPROC, GetError)                                                                                       \
  X(PFNGLGETINTEGERVPROC, GetIntegerv)                                                                                 \
  X(PFNGLGETPROGRAMINFOLOGPROC, GetProgramInfoLog)                                                                     \
  X(PFNGLGETPROGRAMIVPROC, GetProgramiv)                                                                               \
  X(PFNGLGETSHADERINFOLOGPROC, GetShaderInfoLog)                                                                       \
  X(PFNGLGETSHADERIVPROC, GetShaderiv)                                                                                 \
  X(PFNGLGETSTRINGPROC, GetString)                                                                                     \
  X(PFNGLGETUNIFORMLOCATIONPROC, GetUniformLocation)                                                                   \
  X(PFNGLLINKPROGRAMPROC, LinkProgram)                                                                                 \
  X(PFNGLPIXELSTOREIPROC, PixelStorei)                                                                                 \
  X(PFNGLREADPIXELSPROC, ReadPixels)                                                                                   \
  X(PFNGLRENDERBUFFERSTORAGEPROC, RenderbufferStorage)                                                                 \
  X(PFNGLSCISSORPROC, Scissor)                                                                                         \
  X(PFNGLSHADERSOURCEPROC, ShaderSource)                                                                               \
  X(PFNGLTEXIMAGE2DPROC, TexImage2D)                                                                                   \
  X(PFNGLTEXPARAMETERIPROC, TexParameteri)                                                                             \
  X(PFNGLTEXSUBIMAGE2DPROC, TexSubImage2D)                                                                             \
  X(PFNGLUNIFORM1FPROC, Uniform1f)                                                                                     \
  X(PFNGLUNIFORM1IPROC, Uniform1i)                                                                                     \
  X(PFNGLUNIFORM2FPROC, Uniform2f)                                                                                     \
  X(PFNGLUNIFORM3FVPROC, Uniform3fv)                                                                                   \
  X(PFNGLUNIFORM4FVPROC, Uniform4fv)                                                                                   \
  X(PFNGLUSEPROGRAMPROC, UseProgram)                                                                                   \
  X(PFNGLVERTEXATTRIBIPOINTERPROC, VertexAttribIPointer)                                                               \
  X(PFNGLVERTEXATTRIBPOINTERPROC, VertexAttribPointer)                                                                 \
  X(PFNGLVIEWPORTPROC, Viewport)

typedef struct fum_gl_functions {
#define FUM_GL_MEMBER(type, name) type name;
  FUM_GL_FUNCTIONS(FUM_GL_MEMBER)
#undef FUM_GL_MEMBER
} fum_gl_functions;

/* Needs a current context. */
int32_t fum_gl_functions_load(fum_gl_functions *gl, const fum_egl *egl, fum_gl_error *error);

/* FUM_OK, or what went wrong since the last check while doing `what`. */
int32_t fum_gl_check(const fum_gl_functions *gl, const char *what, fum_gl_error *error);

#endif
