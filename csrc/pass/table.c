/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "pass/table.h"

static const fum_pass_info TABLE[] = {
    {FUM_PASS_COMBINED, 4, "Combined", "RGBA", "COLOR", "Premultiplied radiance, W/(m^2 sr), and opacity"},
    {FUM_PASS_DEPTH, 1, "Depth", "Z", "VALUE",
     "Depth along the camera's axis, m, at which half of the light gets through to the camera; of the solid there "
     "where "
     "the smoke in front is thinner; the end of the clip range where there is neither"},
};

enum { PASS_COUNT = sizeof TABLE / sizeof TABLE[0] };

const fum_pass_info *fum_pass_find(int32_t pass) {
  for (int i = 0; i < PASS_COUNT; i++) {
    if (TABLE[i].pass == pass) return &TABLE[i];
  }
  return NULL;
}

int32_t fum_pass_get(int32_t index, fum_pass_info *out_info) {
  if (index < 0 || index >= PASS_COUNT || out_info == NULL) return FUM_ERROR_ARGUMENT;
  *out_info = TABLE[index];
  return FUM_OK;
}
