#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

namespace tessera::client {

/// What a keeper runs: one server and its workers.
struct KeeperPlan {
  std::string server_program, worker_program;
  std::string folder;  // of socket, logs and lock, private; empty: a temporary one
  std::string store;   // empty: a temporary one
  int worker_count = 1, threads_per_worker = 1;
  std::string accelerator;  // of the workers; empty: production's
};

/// First message of a keeper on its socket: the private folder it made, with the server's socket
/// "server.sock" and the logs in it. Later messages say what has gone wrong for good. One datagram
/// each.
///
/// Runs a local farm in the calling process, which was forked for that and has one thread: starts
/// everything, starts workers again when they die, and when the other end of `socket` closes,
/// however that came about, stops everything, removes the private folder and ends. The children die
/// with this process. Never returns.
///
/// With a folder of its own the farm stays: it ends on SIGTERM or when nothing of it is left, its
/// server is started again too, and the folder, of which there is one farm at a time, is kept.
[[noreturn]] void run_supervisor(const KeeperPlan& plan, int socket);

/// Process id of the keeper whose farm stays in `folder`; 0: there is none.
pid_t supervisor_pid(const std::string& folder);

}  // namespace tessera::client
