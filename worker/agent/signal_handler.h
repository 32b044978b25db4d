#pragma once

#include <functional>
#include <thread>

namespace tessera::agent {

/// Calls `on_signal`, on its own thread, at the first SIGTERM or SIGINT of its lifetime. The second
/// signal ends the process with status 130.
class SignalHandler {
 public:
  /// Blocks these signals in this thread and the threads it starts. Call before any other thread is
  /// started, including gRPC's: a signal is delivered to any thread that does not block it.
  static void block_signals();

  /// Requires that the signals are blocked.
  explicit SignalHandler(std::function<void()> on_signal);
  ~SignalHandler();
  SignalHandler(const SignalHandler&) = delete;
  SignalHandler& operator=(const SignalHandler&) = delete;

 private:
  std::thread thread_;
};

}  // namespace tessera::agent
