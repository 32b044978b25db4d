#include "server/sync/lock_order.h"

#include <gtest/gtest.h>

#include <chrono>
#include <thread>

#include "server/sync/mutex.h"

namespace tessera::server {
namespace {

/// Locks two mutexes of these levels.
void lock_both(const LockLevel& first, const LockLevel& second) {
  Mutex outer(first), inner(second);
  const MutexLock outer_lock(outer);
  const MutexLock inner_lock(inner);
}

TEST(LockOrder, LaterLevelsMayBeLocked) {
  lock_both(lock_order::kAnswers, lock_order::kFarm);
  lock_both(lock_order::kFarm, lock_order::kLeaf);
}

TEST(LockOrder, ReleasedLevelDoesNotCount) {
  Mutex leaf, farm(lock_order::kFarm);
  { const MutexLock lock(leaf); }
  farm.lock();
  leaf.lock();
  farm.unlock();  // not in reverse order
  leaf.unlock();
  lock_both(lock_order::kStream, lock_order::kFarm);
}

TEST(LockOrder, OtherThreadsDoNotCount) {
  Mutex leaf;
  const MutexLock lock(leaf);
  std::thread([] { lock_both(lock_order::kStream, lock_order::kFarm); }).join();
}

TEST(LockOrder, WaitKeepsTheLevel) {
  Mutex leaf;
  ConditionVariable condition;
  {
    const MutexLock lock(leaf);
    condition.wait_for(leaf, std::chrono::milliseconds(0));
  }
  lock_both(lock_order::kFarm, lock_order::kLeaf);
}

TEST(LockOrderDeathTest, EarlierLevelEndsTheProcess) {
  EXPECT_DEBUG_DEATH(lock_both(lock_order::kFarm, lock_order::kStream), "level \"stream\" taken");
  EXPECT_DEBUG_DEATH(lock_both(lock_order::kLeaf, lock_order::kAnswers), "level \"answers\" taken");
}

TEST(LockOrderDeathTest, SameLevelEndsTheProcess) {
  EXPECT_DEBUG_DEATH(lock_both(lock_order::kLeaf, lock_order::kLeaf), "level \"leaf\" taken");
}

}  // namespace
}  // namespace tessera::server
