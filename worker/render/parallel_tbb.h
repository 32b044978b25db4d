#pragma once

#include "worker/accel/scene_accel.h"

namespace tessera::render {

/// A ParallelFor over oneTBB's pool with at most `threads` threads (at least 1): the product's.
/// Calls may nest. The body must not throw.
ParallelFor parallel_tbb(int threads);

}  // namespace tessera::render
