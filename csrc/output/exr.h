/* SPDX-License-Identifier: GPL-3.0-or-later */
/* fum_exr_write of the public header is implemented in exr.c; this says whether the OpenEXRCore that it reaches will
 * do. */
#ifndef FUM_OUTPUT_EXR_H
#define FUM_OUTPUT_EXR_H

#include "base/context.h"

/* FUM_ERROR_LIBRARY unless the OpenEXRCore in this process has the major and minor version that we were built with:
 * a host may bring its own, whose structs differ. */
int32_t fum_exr_check_library(fum_context *context);

/* "major.minor.patch" of the OpenEXRCore that the process reaches. */
void fum_exr_version(char out_version[32]);

#endif
