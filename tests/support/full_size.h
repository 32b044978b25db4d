#pragma once

#include <cstdlib>

namespace tessera::testing {

/// Returns `full` if the environment sets TESSERA_FULL_SIZE, as the target full_size does, and
/// `reduced` otherwise: for tests whose full size costs more CPU time than CI has.
template <typename T>
T full_size(T full, T reduced) {
  return std::getenv("TESSERA_FULL_SIZE") != nullptr ? full
                                                     : reduced;  // NOLINT(concurrency-mt-unsafe)
}

}  // namespace tessera::testing
