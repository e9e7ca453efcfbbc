/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "tools/cloud.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { X, Y, Z, RADIUS, DENSITY, RED, GREEN, BLUE, FIELDS };

static const char *const NAMES[FIELDS] = {"x", "y", "z", "radius", "density", "red", "green", "blue"};
static const float DEFAULTS[FIELDS] = {0.0F, 0.0F, 0.0F, 0.1F, 1.0F, 0.8F, 0.8F, 0.8F};

/* A property of the file's vertices. */
typedef struct property {
  int field; /* FIELDS: passed over */
  char type; /* f float, d double, u uchar; other: a size to pass over */
  int size;  /* bytes */
} property;

typedef struct header {
  int64_t count;
  int property_count;
  property properties[64];
} header;

static int fail(char out_error[256], const char *path, const char *what) {
  snprintf(out_error, 256, "%s: %s", path, what);
  return 1;
}

static int read_property(const char *line, property *out) {
  char type[32], name[64];
  if (sscanf(line, "property %31s %63s", type, name) != 2) return 1;
  static const struct {
    const char *name;
    char type;
    int size;
  } types[] = {{"float", 'f', 4}, {"float32", 'f', 4}, {"double", 'd', 8}, {"float64", 'd', 8},
               {"uchar", 'u', 1}, {"uint8", 'u', 1},   {"char", 's', 1},   {"int8", 's', 1},
               {"short", 's', 2}, {"ushort", 's', 2},  {"int16", 's', 2},  {"uint16", 's', 2},
               {"int", 's', 4},   {"uint", 's', 4},    {"int32", 's', 4},  {"uint32", 's', 4}};
  *out = (property){.field = FIELDS};
  for (size_t i = 0; i < sizeof types / sizeof types[0]; i++) {
    if (strcmp(types[i].name, type) == 0) *out = (property){FIELDS, types[i].type, types[i].size};
  }
  if (out->size == 0) return 1;
  for (int field = 0; field < FIELDS; field++) {
    if (strcmp(NAMES[field], name) == 0) out->field = field;
  }
  return out->field < FIELDS && out->type == 's'; /* a field that we use must be a float or a colour byte */
}

/* Reads up to and including end_header. */
static int read_header(FILE *file, const char *path, header *out, char out_error[256]) {
  char line[256];
  int in_vertices = 0, is_binary = 0;
  *out = (header){.count = -1};
  if (fgets(line, sizeof line, file) == NULL || strncmp(line, "ply", 3) != 0) {
    return fail(out_error, path, "not a PLY file");
  }
  while (fgets(line, sizeof line, file) != NULL) {
    if (strncmp(line, "end_header", 10) == 0) {
      if (!is_binary) return fail(out_error, path, "only binary_little_endian PLY is read");
      return out->count < 0 ? fail(out_error, path, "no element vertex") : 0;
    }
    long long count;
    if (strncmp(line, "format binary_little_endian", 27) == 0) is_binary = 1;
    if (strncmp(line, "element ", 8) == 0) {
      in_vertices = sscanf(line, "element vertex %lld", &count) == 1;
      if (in_vertices) out->count = count;
      if (!in_vertices && out->count < 0) return fail(out_error, path, "element vertex must come first");
    }
    if (in_vertices && strncmp(line, "property ", 9) == 0) {
      if (out->property_count == 64 || read_property(line, &out->properties[out->property_count]) != 0) {
        line[strcspn(line, "\r\n")] = '\0';
        snprintf(out_error, 256, "%.100s: can't use \"%.100s\"", path, line);
        return 1;
      }
      out->property_count++;
    }
  }
  return fail(out_error, path, "the header doesn't end");
}

static float decode(const property *p, const unsigned char *bytes) {
  float single;
  double wide;
  switch (p->type) {
  case 'f':
    memcpy(&single, bytes, sizeof single);
    return single;
  case 'd':
    memcpy(&wide, bytes, sizeof wide);
    return (float)wide;
  default:
    return (float)bytes[0] / 255.0F;
  }
}

static void store(cloud *c, int64_t i, const float values[FIELDS]) {
  for (int axis = 0; axis < 3; axis++) {
    c->positions[3 * i + axis] = values[X + axis];
    c->albedos[3 * i + axis] = values[RED + axis];
  }
  c->radii[i] = values[RADIUS];
  c->densities[i] = values[DENSITY];
}

int cloud_read_ply(const char *path, cloud *out_cloud, char out_error[256]) {
  FILE *file = fopen(path, "rb");
  if (file == NULL) return fail(out_error, path, "can't be opened");
  header h;
  cloud c = {0};
  int status = read_header(file, path, &h, out_error);
  if (status != 0) goto done;
  const size_t albedos = 3 * (size_t)(h.count > 0 ? h.count : 1);
  status = cloud_allocate(h.count, &c);
  if (status == 0) c.albedos = calloc(albedos, sizeof *c.albedos);
  if (status != 0 || c.albedos == NULL) {
    status = fail(out_error, path, "no memory for its particles");
    goto done;
  }
  for (int64_t i = 0; i < h.count; i++) {
    float values[FIELDS];
    memcpy(values, DEFAULTS, sizeof values);
    for (int p = 0; p < h.property_count; p++) {
      unsigned char bytes[8];
      const property *property = &h.properties[p];
      if (fread(bytes, (size_t)property->size, 1, file) != 1) {
        status = fail(out_error, path, "the file ends before its last vertex");
        goto done;
      }
      if (property->field < FIELDS) values[property->field] = decode(property, bytes);
    }
    store(&c, i, values);
  }
  cloud_frame(&c);
  *out_cloud = c;
  c = (cloud){0};
done:
  cloud_free(&c);
  fclose(file);
  return status;
}
