// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace variform::testing {

/// How often this program called operator new, malloc (Eigen does) or realloc so far, on all threads, but for calls
/// within shared libraries.
long allocation_count();

}  // namespace variform::testing
