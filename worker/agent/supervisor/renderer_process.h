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
/// The child is this program started again (posix_spawn: nothing of gRPC's threads is inherited;
/// or, before there are any, a fork) in a process group of its own, with three descriptors: none,
/// our pipe as stderr, and the socket. It dies with the thread that started it (PR_SET_PDEATHSIG)
/// and when the socket closes.
class RendererProcess {
 public:
  struct Death {
    std::string reason;    // "killed by SIGSEGV (Segmentation fault)", "exited with status 3"
    std::string log_tail;  // the last 8 KiB it wrote to stderr
  };
  /// Called on a thread of this object.
  struct Listener {
    std::function<void(v1::RendererEvent)> on_event;
    std::function<void(Death)> on_death;  // last of all
  };

  /// A child that runs and is not listened to yet. It ends when this goes.
  struct Child {
    pid_t pid = -1;
    Descriptor socket, log;
  };

  /// Starts `program` with `arguments` (argv[1] on); the socket is its descriptor 3. Call from a
  /// thread that outlives the child. Errors: Internal, it cannot be started.
  static absl::StatusOr<Child> start(const std::string& program,
                                     const std::vector<std::string>& arguments);
  /// The same by a plain fork that runs `child_main`: saves the fifth of a second that loading the
  /// program's libraries takes. Requires that this process has one thread.
  static absl::StatusOr<Child> fork_off(const std::function<int()>& child_main);

  /// Listens to a child from now on.
  RendererProcess(Child child, Listener listener);
  /// Kills the child and waits for it; on_death has been called when this returns.
  ~RendererProcess();
  RendererProcess(const RendererProcess&) = delete;
  RendererProcess& operator=(const RendererProcess&) = delete;

  /// Errors: Unavailable, it is dead (on_death says more).
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

/// Resident memory of a process, bytes; 0 if it is gone.
std::int64_t resident_bytes(pid_t pid);

}  // namespace tessera::agent
