#pragma once

#include <sys/types.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "absl/status/statusor.h"
#include "tessera/v1/renderer.pb.h"
#include "worker/ipc/message_socket.h"

namespace tessera::agent {

/// A renderer running as a child process, seen from the agent.
///
/// The child is this program, started again with posix_spawn so that it inherits nothing of gRPC's
/// threads, or forked before there are any. It runs in its own process group with /dev/null as
/// stdin and stdout, a pipe to the agent as stderr, and the socket. It dies with the thread that
/// started it (PR_SET_PDEATHSIG) and when the socket closes.
class RendererProcess {
 public:
  struct Death {
    std::string reason;    // "killed by SIGSEGV (Segmentation fault)", "exited with status 3"
    std::string log_tail;  // last 8 KiB of its stderr
  };
  /// Callbacks run on a thread of the RendererProcess.
  struct Listener {
    std::function<void(v1::RendererEvent)> on_event;
    std::function<void(Death)> on_death;  // the last call
  };

  /// A running child without a listener. It ends when this is destroyed.
  struct Child {
    pid_t pid = -1;
    Descriptor socket, log;
  };

  /// Starts `program` with `arguments` (from argv[1]); the socket is its descriptor 3. Call from a
  /// thread that outlives the child. Errors: Internal, the program cannot be started.
  static absl::StatusOr<Child> start(const std::string& program,
                                     const std::vector<std::string>& arguments);
  /// Forks a child that runs `child_main`, which saves the 0.2 s that loading the program's
  /// libraries takes. Requires that this process has one thread. Errors: as start().
  static absl::StatusOr<Child> fork_off(const std::function<int()>& child_main);

  /// Starts listening to a child.
  RendererProcess(Child child, Listener listener);
  /// Kills the child and waits for it. on_death has been called when this returns.
  ~RendererProcess();
  RendererProcess(const RendererProcess&) = delete;
  RendererProcess& operator=(const RendererProcess&) = delete;

  /// Sends a command. Errors: Unavailable, the child is dead (on_death has the reason).
  absl::Status send(const v1::RendererCommand& command, std::span<const int> descriptors = {});
  void kill();
  pid_t pid() const { return pid_; }

 private:
  void listen();
  void copy_log();
  std::string wait_for_end();

  const pid_t pid_;
  MessageSocket socket_;
  Descriptor log_;
  const Listener listener_;
  std::mutex mutex_;  // guards what follows
  std::string log_tail_;
  bool reaped_ = false;
  std::thread log_thread_, event_thread_;
};

/// Returns the resident memory of a process in bytes; 0 if the process does not exist.
std::int64_t resident_bytes(pid_t pid);

}  // namespace tessera::agent
