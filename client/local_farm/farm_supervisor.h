#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

namespace tessera::client {

/// Configuration of a local farm: one server and its workers.
struct SupervisorPlan {
  std::string server_program, worker_program;
  std::string folder;  // private directory of socket, logs and lock; empty: temporary
  std::string store;   // empty: temporary
  int worker_count = 1, threads_per_worker = 1;
};

/// Supervises a local farm in the calling process, which was forked for that and has one thread.
/// Starts the server and the workers, restarts workers that die, and stops everything, removes the
/// private directory and exits when the other end of `socket` closes. The children die with this
/// process. Never returns.
///
/// The first datagram on `socket` is the private directory, which contains the server's socket
/// "server.sock" and the logs. Later datagrams are fatal errors.
///
/// With `plan.folder` the farm is persistent: it ends on SIGTERM or when all its processes have
/// failed, the server is restarted as well, and the directory, which allows one farm at a time, is
/// kept.
[[noreturn]] void run_supervisor(const SupervisorPlan& plan, int socket);

/// Returns the process ID of the supervisor of the persistent farm in `folder`; 0 if there is none.
pid_t supervisor_pid(const std::string& folder);

}  // namespace tessera::client
