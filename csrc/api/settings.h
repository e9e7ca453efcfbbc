/* SPDX-License-Identifier: GPL-3.0-or-later */
#ifndef FUM_API_SETTINGS_H
#define FUM_API_SETTINGS_H

#include "base/context.h"

/* Settings checked, or the defaults for NULL. */
int32_t fum_settings_check(fum_context *context, const fum_settings *settings, fum_settings *out_settings);

#endif
