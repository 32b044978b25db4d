#include "rpc/connection_driver.h"

#include <grpc/support/time.h>
#include <grpcpp/support/time.h>

#include <chrono>
#include <utility>

namespace tessera::contract {
namespace {

constexpr std::chrono::milliseconds kLook{200};  // between looks at an established connection
// Of waiting for one: limits the destructor. 100 ms.
constexpr gpr_timespec kSlice{0, 100'000'000, GPR_TIMESPAN};

}  // namespace

ConnectionDriver::ConnectionDriver(std::shared_ptr<grpc::Channel> channel)
    : channel_(std::move(channel)), thread_([this] { run(); }) {}

ConnectionDriver::~ConnectionDriver() {
  {
    const std::lock_guard lock(mutex_);
    is_stopping_ = true;
  }
  wake_.notify_all();
  thread_.join();
}

void ConnectionDriver::run() {
  while (true) {
    const grpc_connectivity_state state = channel_->GetState(/*try_to_connect=*/true);
    if (state == GRPC_CHANNEL_SHUTDOWN) return;
    if (state == GRPC_CHANNEL_READY) {
      if (wait_a_moment()) return;
      continue;
    }
    // By the monotonic clock: a jump of the wall clock must not stretch the wait.
    channel_->WaitForStateChange(state, gpr_time_add(gpr_now(GPR_CLOCK_MONOTONIC), kSlice));
    const std::lock_guard lock(mutex_);
    if (is_stopping_) return;
  }
}

/// Returns whether the object is being destroyed.
bool ConnectionDriver::wait_a_moment() {
  std::unique_lock lock(mutex_);
  return wake_.wait_for(lock, kLook, [this] { return is_stopping_; });
}

}  // namespace tessera::contract
