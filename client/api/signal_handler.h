#pragma once

#include <functional>
#include <mutex>
#include <thread>

namespace tessera::client {

/// Catches SIGINT, SIGTERM and SIGHUP during its lifetime; the second signal ends the process with
/// status 130. Create it before any other thread is started: threads inherit the blocked signals.
class SignalHandler {
 public:
  SignalHandler();
  ~SignalHandler();
  SignalHandler(const SignalHandler&) = delete;
  SignalHandler& operator=(const SignalHandler&) = delete;

  /// Returns whether a signal has been received.
  bool interrupted();

 private:
  friend class InterruptAction;
  void wait_for_signals();
  void set_action(std::function<void()> action);

  std::mutex mutex_;  // guards what follows
  std::function<void()> action_;
  bool interrupted_ = false, done_ = false;
  std::thread thread_;
};

/// Calls `action` on another thread at the first signal during its lifetime, or immediately if one
/// has been received. At most one instance at a time.
class InterruptAction {
 public:
  InterruptAction(SignalHandler& signals, std::function<void()> action) : signals_(signals) {
    signals_.set_action(std::move(action));
  }
  ~InterruptAction() { signals_.set_action({}); }
  InterruptAction(const InterruptAction&) = delete;
  InterruptAction& operator=(const InterruptAction&) = delete;

 private:
  SignalHandler& signals_;
};

}  // namespace tessera::client
