/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Why drawing failed, as noted on the drawing thread and handed to the thread that called the library. */
#ifndef FUM_BILLBOARD_GL_ERROR_H
#define FUM_BILLBOARD_GL_ERROR_H

#include <stdint.h>

typedef struct fum_gl_error {
  int32_t code; /* FUM_ERROR_ */
  char text[768];
} fum_gl_error;

/* Notes the reason and returns `code`. */
int32_t fum_gl_error_set(fum_gl_error *error, int32_t code, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

#endif
