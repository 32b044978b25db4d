#pragma once

#include <functional>
#include <thread>

namespace tessera::agent {

/// Calls `on_signal` (on a thread of its own) at the first SIGTERM or SIGINT while it lives; the
/// second ends the process.
class SignalHandler {
 public:
  /// Blocks these signals in this thread and those it starts. Call before any other thread is
  /// started, gRPC's too: whichever thread does not block a signal may be ended by it.
  static void block_signals();

  /// Requires blocked signals.
  explicit SignalHandler(std::function<void()> on_signal);
  ~SignalHandler();
  SignalHandler(const SignalHandler&) = delete;
  SignalHandler& operator=(const SignalHandler&) = delete;

 private:
  std::thread thread_;
};

}  // namespace tessera::agent
