// Not linked into a program: clang reads this file with -verify, which fails unless it gives
// exactly the warnings that the comments expect.

#include "absl/base/thread_annotations.h"
#include "server/state/farm_state.h"
#include "server/sync/mutex.h"

namespace tessera::server {

struct Stream {
  Mutex mutex ABSL_ACQUIRED_AFTER(lock_order::kStream)
      ABSL_ACQUIRED_BEFORE(lock_order::kFarm){lock_order::kStream};
};

struct Part {
  Mutex mutex ABSL_ACQUIRED_AFTER(lock_order::kPart)
      ABSL_ACQUIRED_BEFORE(lock_order::kPipeline){lock_order::kPart};
  void locked(FarmState& farm) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex);
};

struct Queue {
  Mutex mutex ABSL_ACQUIRED_AFTER(lock_order::kLeaf);
  int size ABSL_GUARDED_BY(mutex) = 0;
};

void takes_all_in_order(Stream& stream, FarmState& farm, Part& part, Queue& queue) {
  const MutexLock stream_lock(stream.mutex);
  FarmChange change(farm);
  const MutexLock part_lock(part.mutex);
  const MutexLock queue_lock(queue.mutex);
  ++queue.size;
}

void takes_neighbours_in_wrong_order(Stream& stream, FarmState& farm) {
  const FarmView view(farm);
  const MutexLock lock(stream.mutex);  // expected-warning {{must be acquired before}}
}

void takes_first_after_last(Stream& stream, Queue& queue) {
  const MutexLock queue_lock(queue.mutex);
  const MutexLock lock(stream.mutex);  // expected-warning {{must be acquired before}}
}

void changes_farm_under_leaf(FarmState& farm, Queue& queue) {
  const MutexLock lock(queue.mutex);
  FarmChange change(farm);  // expected-warning {{must be acquired before}}
}

void Part::locked(FarmState& farm) {
  FarmChange change(farm);  // expected-warning {{must be acquired before}}
}

void does_not_lock(Queue& queue) {
  ++queue.size;  // expected-warning {{requires holding mutex}}
}

}  // namespace tessera::server
