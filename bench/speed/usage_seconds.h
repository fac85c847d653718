// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/resource.h>

namespace plenocal::bench {

/// CPU time of this process so far, all threads, user and system, s.
inline double CpuSeconds() {
  rusage usage;
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

}  // namespace plenocal::bench
