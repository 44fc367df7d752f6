// SPDX-License-Identifier: BSD-3-Clause
// Only in sanitized builds: fontconfig, which Cairo looks up fonts by, keeps patterns for the whole process by pointers
// that LeakSanitizer cannot follow.
extern "C" const char* __lsan_default_suppressions();  // NOLINT(bugprone-reserved-identifier): the sanitizer's name
extern "C" const char* __lsan_default_suppressions() { return "leak:libfontconfig"; }
