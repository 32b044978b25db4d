#pragma once

#include <sys/types.h>

#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "absl/status/statusor.h"

namespace tessera::client {

struct LocalFarmOptions {
  std::string folder;  // directory of socket and logs of a persistent farm; empty: temporary
  std::string store;   // directory of the store; empty: temporary
  int worker_count = 1, threads_per_worker = 1;
};

/// A server and workers on this machine, reachable only by this user, with the lifetime of this
/// object: a supervisor process (farm_supervisor.h) stops them and removes their files when this
/// process ends for any reason.
class LocalFarm {
 public:
  /// Starts the programs installed beside this one. Call before any other thread is started: the
  /// supervisor is forked. Errors: Internal or Unavailable, naming what could not be started.
  static absl::StatusOr<std::unique_ptr<LocalFarm>> start(const LocalFarmOptions& options);
  /// Stops the farm and waits for its end, unless leave_running() was called.
  ~LocalFarm();
  LocalFarm(const LocalFarm&) = delete;
  LocalFarm& operator=(const LocalFarm&) = delete;

  /// Waits until the server listens. Errors: Unavailable, it does not start in time.
  absl::Status wait_until_up();
  /// Lets a farm with `folder` outlive this object.
  void leave_running() { outlives_this_ = true; }
  /// Address of the server, unix:PATH.
  std::string address() const { return "unix:" + folder_ + "/server.sock"; }
  /// Sets `action` to be called once, on another thread, when the farm has died.
  void on_death(std::function<void()> action);
  /// Reason why the farm has died; OK while it runs.
  absl::Status health();

 private:
  LocalFarm(pid_t pid, int socket, std::string folder, bool has_own_folder);
  void listen();

  const pid_t supervisor_pid_;
  const int socket_;
  const bool has_own_folder_;
  bool outlives_this_ = false;
  const std::string folder_;
  std::mutex mutex_;  // guards what follows
  std::function<void()> action_;
  absl::Status health_;
  bool stopping_ = false;
  std::thread listener_;
};

/// Returns the path of a program installed beside this one. Errors: NotFound.
absl::StatusOr<std::string> sibling_program(const std::string& name);

}  // namespace tessera::client
