// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace variform::testing {

/// How often this program called operator new so far, on all threads.
long allocation_count();

}  // namespace variform::testing
