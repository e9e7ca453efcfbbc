/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "pass/table.h"

static const fum_pass_info TABLE[] = {
    {FUM_PASS_COMBINED, 4, "Combined", "RGBA", "COLOR", "Premultiplied radiance, W/(m^2 sr), and opacity", 0},
    {FUM_PASS_DEPTH, 1, "Depth", "Z", "VALUE",
     "Depth along the camera's axis, m, at which half of the light gets through to the camera; of the solid there "
     "where "
     "the smoke in front is thinner; the end of the clip range where there is neither",
     0},
    {FUM_PASS_POSITION, 3, "Position", "XYZ", "VECTOR",
     "Place in the world, m, at the depth of the pass Depth; 0 where there is neither smoke nor solid", 0},
    {FUM_PASS_EMISSION, 3, "Emit", "RGB", "COLOR",
     "What smoke emits by itself, as it arrives at the camera, W/(m^2 sr): a part of Combined", 0},
    {FUM_PASS_SHADOW, 3, "Shadow", "RGB", "COLOR",
     "Of the light that reaches the solid seen in a pixel, the share that smoke lets through, 0 to 1; 1 where there is "
     "no solid or no light. Shadows of solids and the angle to the light count with smoke and without",
     0},
    {FUM_PASS_LIGHT, 3, "Light", "RGB", "COLOR",
     "What smoke scatters of one light, as it arrives at the camera, W/(m^2 sr): with those of the other lights and "
     "Emit it adds up to Combined",
     1},
    {FUM_PASS_LIGHT_SHADOW, 3, "Light Shadow", "RGB", "COLOR", "The pass Shadow, of one light alone", 1},
    {FUM_PASS_OPACITY, 1, "Opacity", "A", "VALUE",
     "The channel A of Combined, 0 to 1, whatever is put behind the smoke", 0},
    {FUM_PASS_DEPTH_FRONT, 1, "Depth Front", "Z", "VALUE",
     "Depth along the camera's axis, m, in front of which a twentieth of the pixel's opacity lies; of the solid, or "
     "the end of "
     "the clip range, where there is no smoke",
     0},
    {FUM_PASS_DEPTH_BACK, 1, "Depth Back", "Z", "VALUE",
     "Depth along the camera's axis, m, behind which a twentieth of the pixel's opacity lies; else as Depth Front", 0},
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
