#include "rpc/connection_driver.h"

#include <grpc/support/time.h>
#include <grpcpp/completion_queue.h>
#include <grpcpp/support/time.h>

#include <chrono>
#include <memory>
#include <utility>

namespace tessera::contract {
namespace {

constexpr std::chrono::milliseconds kLook{200};  // between looks at an established connection
constexpr std::chrono::milliseconds kStep{10};   // between steps of one that is being established
// Of a watch for a change of state: 100 ms, by the monotonic clock.
constexpr gpr_timespec kSlice{0, 100'000'000, GPR_TIMESPAN};
constexpr int kStepsToDrain = 100;
// More than gRPC's longest pause between two attempts (open_channel()).
constexpr std::chrono::seconds kStuck{3};

/// Watches the state of a channel, during which gRPC looks at its connection, without ever blocking
/// in gRPC: gRPC's waits end by the wall clock, so after it has jumped backwards a wait that had
/// begun before would last as long as the jump.
class Watch {
 public:
  explicit Watch(grpc::Channel& channel) : channel_(channel) {}

  /// Lets gRPC look at the connection once.
  void step(grpc_connectivity_state state) {
    if (!is_pending_) {
      channel_.NotifyOnStateChange(state, gpr_time_add(gpr_now(GPR_CLOCK_MONOTONIC), kSlice),
                                   queue_.get(), nullptr);
      is_pending_ = true;
    }
    poll();
  }

  ~Watch() {
    for (int i = 0; is_pending_ && i < kStepsToDrain; ++i) {
      poll();
      if (is_pending_) std::this_thread::sleep_for(kStep);
    }
    queue_->Shutdown();
    // A queue with a watch that does not end cannot be destroyed.
    if (is_pending_) static_cast<void>(queue_.release());
  }
  Watch(const Watch&) = delete;
  Watch& operator=(const Watch&) = delete;

 private:
  void poll() {
    void* tag = nullptr;
    bool is_ok = false;
    const auto now = gpr_now(GPR_CLOCK_MONOTONIC);
    if (queue_->AsyncNext(&tag, &is_ok, now) == grpc::CompletionQueue::GOT_EVENT) {
      is_pending_ = false;
    }
  }

  grpc::Channel& channel_;
  std::unique_ptr<grpc::CompletionQueue> queue_ = std::make_unique<grpc::CompletionQueue>();
  bool is_pending_ = false;
};

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
  using Clock = std::chrono::steady_clock;
  Watch watch(*channel_);
  Clock::time_point attempted = Clock::now();
  while (true) {
    const grpc_connectivity_state state = channel_->GetState(/*try_to_connect=*/true);
    if (state == GRPC_CHANNEL_SHUTDOWN) return;
    const bool is_ready = state == GRPC_CHANNEL_READY;
    if (!is_ready) watch.step(state);
    if (state != GRPC_CHANNEL_TRANSIENT_FAILURE) attempted = Clock::now();
    // The pause before the next attempt ends by one of gRPC's timers, which stand still after the
    // wall clock has jumped backwards.
    if (Clock::now() - attempted > kStuck) {
      grpc::experimental::ChannelResetConnectionBackoff(channel_.get());
      attempted = Clock::now();
    }
    if (wait(is_ready ? kLook : kStep)) return;
  }
}

/// Returns whether the object is being destroyed.
bool ConnectionDriver::wait(std::chrono::milliseconds span) {
  std::unique_lock lock(mutex_);
  return wake_.wait_for(lock, span, [this] { return is_stopping_; });
}

}  // namespace tessera::contract
