#include "worker/agent/signal_handler.h"

#include <pthread.h>
#include <unistd.h>

#include <csignal>
#include <utility>

namespace tessera::agent {
namespace {

constexpr int kInterruptedExit = 130;

sigset_t terminating_signals() {
  sigset_t signals;
  sigemptyset(&signals);
  // The destructor ends the waiting thread with SIGUSR2.
  for (const int signal : {SIGTERM, SIGINT, SIGUSR2}) sigaddset(&signals, signal);
  return signals;
}

}  // namespace

void SignalHandler::block_signals() {
  const sigset_t signals = terminating_signals();
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
}

SignalHandler::SignalHandler(std::function<void()> on_signal) {
  thread_ = std::thread([on_signal = std::move(on_signal), signals = terminating_signals()] {
    bool is_first = true;
    while (true) {
      const int signal = sigwaitinfo(&signals, nullptr);
      if (signal == SIGUSR2) return;
      if (signal < 0) continue;
      if (!std::exchange(is_first, false)) _exit(kInterruptedExit);
      on_signal();
    }
  });
}

SignalHandler::~SignalHandler() {
  pthread_kill(thread_.native_handle(), SIGUSR2);
  thread_.join();
}

}  // namespace tessera::agent
