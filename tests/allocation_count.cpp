// SPDX-License-Identifier: BSD-3-Clause
#include "tests/allocation_count.h"

#include <atomic>
#include <cstddef>

namespace {
std::atomic<long> allocations{0};
}

// Replacements for the whole test program, so that "allocates nothing" is a fact. operator new calls malloc.
#ifdef __SANITIZE_ADDRESS__
// Of the sanitizer's run-time library; GCC does not install its header.
extern "C" int __sanitizer_install_malloc_and_free_hooks(  // NOLINT(bugprone-reserved-identifier)
    void (*allocated)(const volatile void*, std::size_t), void (*freed)(const volatile void*));
namespace {
const int hooked = __sanitizer_install_malloc_and_free_hooks([](const volatile void*, std::size_t) { ++allocations; },
                                                             [](const volatile void*) {});
}
#else
extern "C" void* __libc_malloc(std::size_t size);  // NOLINT(bugprone-reserved-identifier): of the C library
extern "C" void* malloc(std::size_t size) {
  allocations.fetch_add(1, std::memory_order_relaxed);
  return __libc_malloc(size);
}
#endif

namespace variform::testing {

long allocation_count() { return allocations; }

}  // namespace variform::testing
