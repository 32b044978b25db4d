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
  std::string folder;  // where a farm that may stay has socket and logs; empty: a temporary one
  std::string store;   // folder of the store; empty: a temporary one
  int worker_count = 1, threads_per_worker = 1;
  std::string accelerator;  // a reference structure for the workers to use; empty: production's
};

/// A server and workers of this machine, reachable only by this user, that live as long as this
/// object: a keeper process (farm_keeper.h) stops them and removes every trace when this process
/// ends, whatever the reason.
class LocalFarm {
 public:
  /// Call before any other thread is started: the keeper is a fork. The programs are those beside
  /// this one. Errors: Internal or Unavailable, saying what could not be started.
  static absl::StatusOr<std::unique_ptr<LocalFarm>> start(const LocalFarmOptions& options);
  /// Stops everything, unless it stays; returns when it is gone.
  ~LocalFarm();
  LocalFarm(const LocalFarm&) = delete;
  LocalFarm& operator=(const LocalFarm&) = delete;

  /// Waits until the server listens. Errors: Unavailable, it does not come up.
  absl::Status wait_until_up();
  /// From now on a farm with a folder of its own does not end with this object.
  void leave_running() { stays_ = true; }
  /// unix:PATH.
  std::string address() const { return "unix:" + folder_ + "/server.sock"; }
  /// `action` is called once, on another thread, when the farm has died.
  void on_death(std::function<void()> action);
  /// Why the farm has died; OK while it lives.
  absl::Status health();

 private:
  LocalFarm(pid_t keeper_pid, int socket, std::string folder, bool has_own_folder);
  void listen();

  const pid_t keeper_pid_;
  const int socket_;
  const bool has_own_folder_;
  bool stays_ = false;
  const std::string folder_;
  std::mutex mutex_;  // guards what follows
  std::function<void()> action_;
  absl::Status health_;
  bool stopping_ = false;
  std::thread listener_;
};

/// Path of a program that is installed beside this one. Errors: NotFound.
absl::StatusOr<std::string> sibling_program(const std::string& name);

}  // namespace tessera::client
