// SPDX-License-Identifier: BSD-3-Clause
// Only in sanitized builds: fontconfig, by which Cairo looks up fonts, keeps patterns for the whole process by pointers
// that LeakSanitizer cannot follow.
extern "C" {
const char* __lsan_default_suppressions();  // NOLINT(bugprone-reserved-identifier): the sanitizer's name
const char* __lsan_default_options();       // NOLINT(bugprone-reserved-identifier): the sanitizer's name

const char* __lsan_default_suppressions() { return "leak:libfontconfig\nleak:libsuperlu"; }
// Scripts read standard error.
const char* __lsan_default_options() { return "print_suppressions=0"; }
}
