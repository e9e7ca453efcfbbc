/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/gl_error.h"

#include <stdarg.h>
#include <stdio.h>

int32_t fum_gl_error_set(fum_gl_error *error, int32_t code, const char *format, ...) {
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(error->text, sizeof error->text, format, arguments);
  va_end(arguments);
  error->code = code;
  return code;
}
