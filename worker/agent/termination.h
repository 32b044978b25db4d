#pragma once

#include <functional>
#include <thread>

namespace tessera::agent {

/// Calls `on_signal` (on a thread of its own) at the first SIGTERM or SIGINT while it lives; the
/// second ends the process. Make it before any other thread: threads inherit the blocked signals.
class Termination {
 public:
  explicit Termination(std::function<void()> on_signal);
  ~Termination();
  Termination(const Termination&) = delete;
  Termination& operator=(const Termination&) = delete;

 private:
  std::thread thread_;
};

}  // namespace tessera::agent
