#pragma once

#include "worker/accel/scene_accel.h"

namespace tessera::render {

/// ParallelFor on oneTBB's pool with at most `threads` threads (at least 1), used by the worker.
/// Calls may nest. The body must not throw.
ParallelFor parallel_tbb(int threads);

}  // namespace tessera::render
