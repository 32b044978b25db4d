#pragma once

#include "contract/traversal_counts.h"

namespace tessera::render {

/// Returns the work so far of the calling thread's queries in accelerators that count it. Callers
/// take differences, as with a clock.
contract::TraversalCounts& thread_traversal_counts();

}  // namespace tessera::render
