#pragma once

#include "worker/accel/scene_accel.h"

namespace tessera::render {

/// ParallelFor that starts and joins `threads` std::threads per call, for tests and
/// ThreadSanitizer, which cannot see into libtbb. The body must not throw.
ParallelFor parallel_threads(int threads);

}  // namespace tessera::render
