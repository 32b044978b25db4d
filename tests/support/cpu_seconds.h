#pragma once

#include <ctime>

namespace tessera::testing {

/// Returns the CPU seconds that this process has used so far, over all its threads.
inline double cpu_seconds() {
  std::timespec time{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

}  // namespace tessera::testing
