#pragma once

#include <sys/socket.h>
#include <sys/types.h>

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "server/sync/mutex.h"

namespace tessera::server {

/// The TCP connections of a server and the clients that use them.
///
/// gRPC tells neither when a connection is authenticated nor when it ends. So a connection counts
/// for a client from its first call on, and every count looks which sockets still exist. The
/// sockets belong to gRPC, which may close one at any time; its number may then name another file,
/// so every use compares the inode. Thread-safe.
class ClientConnections {
 public:
  using Time = std::chrono::steady_clock::time_point;
  /// Time between the refusal of a call and the end of its connection, for the answer to arrive.
  static constexpr std::chrono::milliseconds kGrace{500};
  /// Age from which a connection without a call may be cut.
  static constexpr std::chrono::milliseconds kSilence{2000};

  /// Adds an accepted connection, before gRPC gets it. `peer`: the address of its other end.
  void add(int socket, const sockaddr_storage& peer, Time now);

  /// Counts the connection of a call for its caller. `peer`: as of grpc::ServerContext::peer().
  /// Returns how many connections the client would have, including some that have ended unless the
  /// number is above `limit` (0: unlimited). Above it, this one is not counted, and cut_refused()
  /// will end it. Returns 0 for a connection that was counted before or is unknown.
  std::size_t use(const std::string& client, const std::string& peer, double limit, Time now);

  /// Returns the number of open connections of a client.
  std::size_t count(const std::string& client) const;

  /// Ends the connections that were refused kGrace ago. Returns their number.
  std::size_t cut_refused(Time now);

  /// Ends the oldest connection over which no client has made a call for kSilence. Returns whether
  /// there was one.
  bool cut_silent(Time now);

 private:
  struct Connection {
    ino_t inode = 0;
    std::string peer;
    std::string client;  // empty before its first call
    Time accepted;
    std::optional<Time> refused;
  };
  using Sockets = std::map<int, Connection>;

  void remove(Sockets::iterator connection) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Returns the sockets of the client's connections that have ended.
  std::vector<int> ended(const std::string& client) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);
  /// Returns the number of the client's connections, including those of ended().
  std::size_t count_known(const std::string& client) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  mutable Mutex mutex_ ABSL_ACQUIRED_AFTER(lock_order::kLeaf);
  Sockets sockets_
      ABSL_GUARDED_BY(mutex_);  // by descriptor; closed ones stay until it is used again
  std::map<std::string, int> by_peer_ ABSL_GUARDED_BY(mutex_);
  std::map<std::string, std::set<int>> by_client_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace tessera::server
