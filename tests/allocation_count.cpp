// SPDX-License-Identifier: BSD-3-Clause
#include "tests/allocation_count.h"

#include <atomic>
#include <cstddef>
#include <new>

namespace {
std::atomic<long> allocations{0};
}

// Replacements for the whole test program, so that "allocates nothing" is a fact: operator new, and what the linker has
// instead of malloc for everything that is linked statically (--wrap, see tests/CMakeLists.txt), Eigen's matrices among
// it. What shared libraries allocate for themselves does not count.
extern "C" {
void* __real_malloc(std::size_t size);
void __real_free(void* memory);
void* __real_realloc(void* memory, std::size_t size);

void* __wrap_malloc(std::size_t size) {
  ++allocations;
  return __real_malloc(size);
}
void* __wrap_realloc(void* memory, std::size_t size) {
  ++allocations;
  return __real_realloc(memory, size);
}
void __wrap_free(void* memory) { __real_free(memory); }
}

void* operator new(std::size_t size) {
  ++allocations;
  if (void* memory = __real_malloc(size)) return memory;
  throw std::bad_alloc();
}
void operator delete(void* memory) noexcept { __real_free(memory); }
void operator delete(void* memory, std::size_t) noexcept { __real_free(memory); }

namespace variform::testing {

long allocation_count() { return allocations; }

}  // namespace variform::testing
