/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "support.h"

#include "base/radix.h"

static int compare_keys(const void *a, const void *b) {
  const uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
  return (x > y) - (x < y);
}

static void test_radix_sort_is_stable_for_any_number_of_threads(void **state) {
  (void)state;
  enum { COUNT = 50001 };
  fum_context *context = NULL;
  assert_int_equal(fum_context_create(&context), FUM_OK);
  static uint64_t keys[COUNT], expected[COUNT], first_keys[COUNT];
  static uint32_t values[COUNT], first_values[COUNT];
  for (int threads = 1; threads <= 5; threads++) {
    assert_int_equal(fum_context_set_threads(context, threads), FUM_OK);
    for (uint32_t i = 0; i < COUNT; i++) {
      keys[i] = expected[i] = i % 3 == 0 ? fum_hash64(i) : fum_hash64(i) % 100; /* many equal keys */
      values[i] = i;
    }
    qsort(expected, COUNT, sizeof *expected, compare_keys);
    assert_int_equal(fum_radix_sort(context, COUNT, 0, keys, values), FUM_OK);
    assert_memory_equal(keys, expected, sizeof keys);
    for (int i = 1; i < COUNT; i++)
      assert_true(keys[i - 1] < keys[i] || values[i - 1] < values[i]);
    if (threads == 1) {
      memcpy(first_keys, keys, sizeof keys);
      memcpy(first_values, values, sizeof values);
    }
    assert_memory_equal(values, first_values, sizeof values);
  }
  fum_context_destroy(context);
}

static void test_radix_sort_by_high_bits_keeps_low_bits_in_order(void **state) {
  (void)state;
  enum { COUNT = 1000 };
  fum_context *context = NULL;
  assert_int_equal(fum_context_create(&context), FUM_OK);
  uint64_t keys[COUNT];
  for (uint64_t i = 0; i < COUNT; i++)
    keys[i] = (fum_hash64(i) % 4) << 32 | (COUNT - i);
  assert_int_equal(fum_radix_sort(context, COUNT, 32, keys, NULL), FUM_OK);
  for (int i = 1; i < COUNT; i++) {
    assert_true(keys[i - 1] >> 32 <= keys[i] >> 32);
    if (keys[i - 1] >> 32 == keys[i] >> 32) assert_true((uint32_t)keys[i - 1] > (uint32_t)keys[i]);
  }
  fum_context_destroy(context);
}

/* Long runs that agree in their high bits, short ones, and bits that aren't to be sorted by. */
static void test_radix_sort_of_clustered_keys(void **state) {
  (void)state;
  enum { COUNT = 60000, FIRST_BIT = 5 };
  fum_context *context = NULL;
  assert_int_equal(fum_context_create(&context), FUM_OK);
  static uint64_t keys[COUNT];
  static uint32_t values[COUNT];
  for (uint32_t i = 0; i < COUNT; i++) {
    const uint64_t cluster = i % 4 == 0 ? fum_hash64(i) % 20000 : i % 4;
    keys[i] = cluster << 49 | fum_hash64(i + COUNT) % 5000 << FIRST_BIT | (COUNT - i) % 32;
    values[i] = i;
  }
  assert_int_equal(fum_radix_sort(context, COUNT, FIRST_BIT, keys, values), FUM_OK);
  for (int i = 1; i < COUNT; i++) {
    const uint64_t before = keys[i - 1] >> FIRST_BIT, here = keys[i] >> FIRST_BIT;
    assert_true(before < here || (before == here && values[i - 1] < values[i]));
    assert_int_equal(keys[i] % 32, (COUNT - values[i]) % 32);
  }
  fum_context_destroy(context);
}

static void test_allocation_failure_says_how_much(void **state) {
  (void)state;
  fum_context *context = NULL;
  assert_int_equal(fum_context_create(&context), FUM_OK);
  void *pointer = &pointer;
  assert_int_equal(fum_alloc(context, (int64_t)1 << 50, 64, "test", &pointer), FUM_ERROR_MEMORY);
  assert_null(pointer);
  assert_non_null(strstr(fum_last_error(context), "GiB"));
  assert_int_equal(fum_alloc(context, INT64_MAX, SIZE_MAX, "test", &pointer), FUM_ERROR_MEMORY);
  assert_int_equal(fum_alloc(context, -1, 1, "test", &pointer), FUM_ERROR_MEMORY);
  assert_int_equal(fum_alloc(context, 0, 8, "test", &pointer), FUM_OK);
  assert_int_equal((uintptr_t)pointer % 64, 0);
  fum_free(context, &pointer);
  assert_null(pointer);
  assert_int_equal(atomic_load(&context->memory_bytes), 0);
  fum_context_destroy(context);
}

static void test_warnings_come_once(void **state) {
  (void)state;
  fum_context *context = NULL;
  assert_int_equal(fum_context_create(&context), FUM_OK);
  for (int i = 0; i < 3; i++)
    fum_warn(context, "value %d", i / 2);
  assert_int_equal(fum_warning_count(context), 2);
  assert_string_equal(fum_warning(context, 1), "value 1");
  assert_null(fum_warning(context, 2));
  assert_null(fum_warning(context, -1));
  fum_warnings_clear(context);
  assert_int_equal(fum_warning_count(context), 0);
  assert_int_equal(fum_context_set_threads(context, -1), FUM_ERROR_ARGUMENT);
  assert_non_null(strstr(fum_last_error(context), "-1"));
  fum_context_destroy(context);
  fum_context_destroy(NULL);
  assert_int_equal(fum_context_create(NULL), FUM_ERROR_ARGUMENT);
  assert_true(strlen(fum_last_error(NULL)) > 0);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_radix_sort_is_stable_for_any_number_of_threads),
      cmocka_unit_test(test_radix_sort_by_high_bits_keeps_low_bits_in_order),
      cmocka_unit_test(test_radix_sort_of_clustered_keys),
      cmocka_unit_test(test_allocation_failure_says_how_much),
      cmocka_unit_test(test_warnings_come_once),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
