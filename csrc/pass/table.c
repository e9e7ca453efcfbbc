/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "pass/table.h"

static const fum_pass_info TABLE[] = {
    {FUM_PASS_COMBINED, 4, "Combined", "RGBA", "COLOR",
     "Premultiplied radiance, W/(m^2 sr), and opacity, of smoke and of shaded solids", FUM_PER_PICTURE},
    {FUM_PASS_DEPTH, 1, "Depth", "Z", "VALUE",
     "Depth along the camera's axis, m, at which half of the light gets through to the camera; of the solid there "
     "where "
     "the smoke in front is thinner; the end of the clip range where there is neither",
     FUM_PER_PICTURE},
    {FUM_PASS_POSITION, 3, "Position", "XYZ", "VECTOR",
     "Place in the world, m, at the depth of the pass Depth; 0 where there is neither smoke nor solid",
     FUM_PER_PICTURE},
    {FUM_PASS_EMISSION, 3, "Emit", "RGB", "COLOR",
     "What smoke and shaded solids emit by themselves, as it arrives at the camera, W/(m^2 sr): a part of Combined",
     FUM_PER_PICTURE},
    {FUM_PASS_SHADOW, 3, "Shadow", "RGB", "COLOR",
     "Of the light that reaches the solid seen in a pixel, the share that smoke lets through, 0 to 1; 1 where there is "
     "no solid or no light. Shadows of solids and the angle to the light count with smoke and without",
     FUM_PER_PICTURE},
    {FUM_PASS_LIGHT, 3, "Light", "RGB", "COLOR",
     "What smoke and shaded solids scatter of one light, as it arrives at the camera, W/(m^2 sr): with those of the "
     "other lights and Emit it adds up to Combined",
     FUM_PER_LIGHT},
    {FUM_PASS_LIGHT_SHADOW, 3, "Light Shadow", "RGB", "COLOR", "The pass Shadow, of one light alone", FUM_PER_LIGHT},
    {FUM_PASS_OPACITY, 1, "Opacity", "A", "VALUE",
     "The channel A of Combined, 0 to 1, whatever background is put behind it", FUM_PER_PICTURE},
    {FUM_PASS_DEPTH_FRONT, 1, "Depth Front", "Z", "VALUE",
     "Depth along the camera's axis, m, in front of which a twentieth of the pixel's opacity lies; of the solid, or "
     "the end of "
     "the clip range, where there is no smoke",
     FUM_PER_PICTURE},
    {FUM_PASS_DEPTH_BACK, 1, "Depth Back", "Z", "VALUE",
     "Depth along the camera's axis, m, behind which a twentieth of the pixel's opacity lies; else as Depth Front",
     FUM_PER_PICTURE},
    {FUM_PASS_ALBEDO, 3, "Albedo", "RGB", "COLOR",
     "Share of the light that meets smoke which it scatters, 0 to 1, times opacity: what Combined would be if light of "
     "1 "
     "came through unhindered and were scattered evenly",
     FUM_PER_PICTURE},
    {FUM_PASS_VECTOR, 4, "Vector", "XYZW", "VECTOR",
     "Motion of the smoke in pixels, right and up: X and Y from this frame to the one before, Z and W from the one "
     "after "
     "to this; the mean over what adds to the pixel's opacity, 0 without smoke",
     FUM_PER_PICTURE},
    {FUM_PASS_SOLID_SHADOW, 3, "Solid Shadow", "RGB", "COLOR",
     "Of the light that smoke would scatter to the camera if solids let all light through, the share that it does, 0 "
     "to "
     "1; 1 where there is no smoke or no light",
     FUM_PER_PICTURE},
    {FUM_PASS_LIGHT_SOLID_SHADOW, 3, "Light Solid Shadow", "RGB", "COLOR", "The pass Solid Shadow, of one light alone",
     FUM_PER_LIGHT},
    {FUM_PASS_ERROR, 1, "Error", "V", "VALUE",
     "Transmittance to the lights that the picture was made with, less that found exactly, -1 to 1: at the place in "
     "front "
     "of which half of the pixel's opacity lies, the mean over the lights weighted with what they send there; 0 "
     "without "
     "smoke",
     FUM_PER_PICTURE},
    {FUM_PASS_CRYPTO_OBJECT, 4, "CryptoObject", "RGBA", "COLOR",
     "Cryptomatte: of two ranks the id of some particles, as the bits of a float, and the share of the pixel that they "
     "cover",
     FUM_PER_RANKS},
    {FUM_PASS_HOLDOUT, 3, "Holdout", "RGB", "COLOR",
     "Share of the light from behind the smoke that holdouts keep out, 0 to 1; a background shows through what neither "
     "this nor Combined's A takes",
     FUM_PER_PICTURE},
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
