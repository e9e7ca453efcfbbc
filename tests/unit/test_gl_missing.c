/* SPDX-License-Identifier: GPL-3.0-or-later */
/* A machine without any OpenGL driver: EGL's dispatcher is told to look for drivers where there are none. A program of
 * its own, as it looks once a process. */
#include "gl_fixture.h"

static void missing_driver_is_an_error_that_says_what_to_install(void **state) {
  (void)state;
  const fum_frame frame = make_frame(4, 4);
  const fum_billboard billboard = make_billboard(0, 0, -4, 1.0f, 1.0f);
  for (int i = 0; i < 2; i++) {
    float pixels[64] = {7};
    char device[128] = "untouched";
    assert_int_equal(fum_gl_draw(context, &frame, 1, &billboard, pixels, device), FUM_ERROR_DEVICE);
    assert_non_null(strstr(fum_last_error(context), "libegl-mesa0"));
    assert_string_equal(device, "untouched");
    assert_true(pixels[0] == 7.0f);
    assert_null(context->gl);
  }
}

static void nothing_to_draw_still_works(void **state) {
  (void)state;
  const fum_frame frame = make_frame(4, 4);
  float *pixels = draw(&frame, 0, NULL);
  assert_true(pixels[0] == 0.0f);
  free(pixels);
}

int main(void) {
  setenv("__EGL_VENDOR_LIBRARY_DIRS", "/nonexistent", 1);
  const struct CMUnitTest tests[] = {cmocka_unit_test(missing_driver_is_an_error_that_says_what_to_install),
                                     cmocka_unit_test(nothing_to_draw_still_works)};
  return cmocka_run_group_tests(tests, open_context, close_context);
}
