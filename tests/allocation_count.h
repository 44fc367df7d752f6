// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace variform::testing {

/// How often this program allocated memory so far (malloc and operator new, and Eigen, which uses malloc), on all
/// threads.
long allocation_count();

}  // namespace variform::testing
