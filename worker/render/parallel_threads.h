#pragma once

#include "worker/accel/scene_accel.h"

namespace tessera::render {

/// A ParallelFor that starts `threads` std::threads for every call and joins them: for
/// ThreadSanitizer, which cannot see into libtbb, and for tests. The body must not throw.
ParallelFor parallel_threads(int threads);

}  // namespace tessera::render
