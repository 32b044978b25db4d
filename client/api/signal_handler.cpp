#include "client/api/signal_handler.h"

#include <pthread.h>
#include <unistd.h>

#include <csignal>
#include <utility>

#include "client/cli/command.h"

namespace tessera::client {
namespace {

sigset_t interrupting_signals() {
  sigset_t signals;
  sigemptyset(&signals);
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) sigaddset(&signals, signal);
  return signals;
}

}  // namespace

SignalHandler::SignalHandler() {
  const sigset_t signals = interrupting_signals();
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  thread_ = std::thread([this] { wait_for_signals(); });
}

SignalHandler::~SignalHandler() {
  {
    const std::lock_guard lock(mutex_);
    done_ = true;
  }
  pthread_kill(thread_.native_handle(),
               SIGHUP);  // ends the wait; the signal is blocked and has no other effect
  thread_.join();
  const sigset_t signals = interrupting_signals();
  pthread_sigmask(SIG_UNBLOCK, &signals, nullptr);
}

bool SignalHandler::interrupted() {
  const std::lock_guard lock(mutex_);
  return interrupted_;
}

void SignalHandler::set_action(std::function<void()> action) {
  const std::lock_guard lock(mutex_);
  action_ = std::move(action);
  if (interrupted_ && action_) action_();
}

void SignalHandler::wait_for_signals() {
  const sigset_t signals = interrupting_signals();
  while (true) {
    if (sigwaitinfo(&signals, nullptr) < 0) continue;
    const std::lock_guard lock(mutex_);
    if (done_) return;
    if (interrupted_) _exit(kExitInterrupted);
    interrupted_ = true;
    if (action_) action_();
  }
}

}  // namespace tessera::client
