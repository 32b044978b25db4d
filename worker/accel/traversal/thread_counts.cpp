#include "worker/accel/traversal/thread_counts.h"

namespace tessera::render {

contract::TraversalCounts& thread_traversal_counts() {
  thread_local contract::TraversalCounts counts;
  return counts;
}

}  // namespace tessera::render
