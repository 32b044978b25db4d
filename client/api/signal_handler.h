#pragma once

#include <functional>
#include <mutex>
#include <thread>

namespace tessera::client {

/// Catches SIGINT, SIGTERM and SIGHUP while it lives; a second one ends the process at once. Make
/// it before any other thread is started: threads inherit the blocked signals.
class SignalHandler {
 public:
  SignalHandler();
  ~SignalHandler();
  SignalHandler(const SignalHandler&) = delete;
  SignalHandler& operator=(const SignalHandler&) = delete;

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

/// While it lives, the first interrupt calls `action` on another thread (at once, if it has come
/// already). One at a time.
class InterruptAction {
 public:
  InterruptAction(SignalHandler& interrupts, std::function<void()> action) : interrupts_(interrupts) {
    interrupts_.set_action(std::move(action));
  }
  ~InterruptAction() { interrupts_.set_action({}); }
  InterruptAction(const InterruptAction&) = delete;
  InterruptAction& operator=(const InterruptAction&) = delete;

 private:
  SignalHandler& interrupts_;
};

}  // namespace tessera::client
