/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The OpenEXRCore that files are written with. fum_exr_write of the public header is implemented in exr.c,
 * fum_deep_write in exr_deep.c. */
#ifndef FUM_OUTPUT_EXR_H
#define FUM_OUTPUT_EXR_H

/* "major.minor.patch" of the OpenEXRCore that the process reaches. */
void fum_exr_version(char out_version[32]);

#endif
