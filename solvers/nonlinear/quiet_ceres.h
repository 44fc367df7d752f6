// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <glog/logging.h>

namespace variform {

/// Keeps Ceres from writing to the terminal during a scope: what it has to say is in its summary.
class QuietCeres {
 public:
  QuietCeres() : before_(FLAGS_minloglevel) { FLAGS_minloglevel = google::GLOG_FATAL; }
  ~QuietCeres() { FLAGS_minloglevel = before_; }
  QuietCeres(const QuietCeres&) = delete;
  QuietCeres& operator=(const QuietCeres&) = delete;

 private:
  int before_;
};

}  // namespace variform
