/* SPDX-License-Identifier: GPL-3.0-or-later */
/* An OpenGL 3.3 core context without window or surface, through EGL. */
#ifndef FUM_BILLBOARD_EGL_H
#define FUM_BILLBOARD_EGL_H

#include "billboard/gl_error.h"

#include <EGL/egl.h>
#include <EGL/eglext.h>

#define FUM_EGL_FUNCTIONS(X)                                                                                           \
  X(PFNEGLBINDAPIPROC, BindAPI)                                                                                        \
  X(PFNEGLCREATECONTEXTPROC, CreateContext)                                                                            \
  X(PFNEGLDESTROYCONTEXTPROC, DestroyContext)                                                                          \
  X(PFNEGLGETERRORPROC, GetError)                                                                                      \
  X(PFNEGLGETPROCADDRESSPROC, GetProcAddress)                                                                          \
  X(PFNEGLINITIALIZEPROC, Initialize)                                                                                  \
  X(PFNEGLMAKECURRENTPROC, MakeCurrent)                                                                                \
  X(PFNEGLQUERYSTRINGPROC, QueryString)                                                                                \
  X(PFNEGLRELEASETHREADPROC, ReleaseThread)

typedef struct fum_egl {
#define FUM_EGL_MEMBER(type, name) type name;
  FUM_EGL_FUNCTIONS(FUM_EGL_MEMBER)
#undef FUM_EGL_MEMBER
  EGLDisplay display;
  EGLContext context;
} fum_egl;

/* Makes a context and makes it current on this thread. On failure nothing is left open. */
int32_t fum_egl_open(fum_egl *egl, fum_gl_error *error);

/* Destroys the context; on the thread that opened it. The display stays: other users of EGL in the process may share
 * it, and eglTerminate would take it away from them. */
void fum_egl_close(fum_egl *egl);

#endif
