/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/gl_functions.h"

#include "fumarole.h"

int32_t fum_gl_functions_load(fum_gl_functions *gl, const fum_egl *egl, fum_gl_error *error) {
#define LOAD(type, name)                                                                                               \
  gl->name = (type)egl->GetProcAddress("gl" #name);                                                                    \
  if (gl->name == NULL)                                                                                                \
    return fum_gl_error_set(error, FUM_ERROR_DEVICE, "the OpenGL driver has no gl" #name "; a newer one is needed");
  FUM_GL_FUNCTIONS(LOAD)
#undef LOAD
  return FUM_OK;
}

int32_t fum_gl_check(const fum_gl_functions *gl, const char *what, fum_gl_error *error) {
  /* A lost context may report the same error for ever. */
  enum { MOST_ERRORS = 16 };
  GLenum first = GL_NO_ERROR;
  for (int i = 0; i < MOST_ERRORS; i++) {
    const GLenum code = gl->GetError();
    if (code == GL_NO_ERROR) break;
    if (first == GL_NO_ERROR || code == GL_OUT_OF_MEMORY) first = code;
  }
  if (first == GL_NO_ERROR) return FUM_OK;
  if (first == GL_OUT_OF_MEMORY) {
    return fum_gl_error_set(error, FUM_ERROR_MEMORY, "the drawing device ran out of memory while %s", what);
  }
  return fum_gl_error_set(error, FUM_ERROR_DEVICE, "OpenGL failed with error 0x%04x while %s", (unsigned)first, what);
}
