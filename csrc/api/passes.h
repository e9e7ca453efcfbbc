/* SPDX-License-Identifier: GPL-3.0-or-later */
/* The passes of a rendering: which can be asked for, where each is kept, and what is made from which. */
#ifndef FUM_API_PASSES_H
#define FUM_API_PASSES_H

#include "api/combine.h"

/* Has the pass red, green and blue? */
bool fum_pass_is_color(const fum_pass_info *info);

/* Is it made anew for each channel of colour? */
bool fum_pass_is_by_channel(const fum_pass_info *info);

/* How many there are of the pass. */
int32_t fum_pass_count(const fum_rendering *r, const fum_pass_info *info);

/* Where a pass is kept. */
float **fum_pass_place(fum_rendering *r, int32_t pass, int32_t number);

/* Can all that is asked for be made? With deep pixels no pass need be. */
int32_t fum_passes_check(const fum_rendering *r, bool is_deep, int32_t pass_count, const fum_pass_buffer *passes);

/* Room for what is asked for, and for what that is made from. */
int32_t fum_passes_allocate(fum_rendering *r, int32_t pass_count, const fum_pass_buffer *passes);
/* For none yet; then for single ones. */
int32_t fum_passes_allocate_lists(fum_rendering *r);
int32_t fum_pass_allocate(fum_rendering *r, int32_t pass, int32_t number);
void fum_passes_free(fum_rendering *r);

void fum_passes_hand_over(fum_rendering *r, int32_t pass_count, const fum_pass_buffer *passes);

#endif
