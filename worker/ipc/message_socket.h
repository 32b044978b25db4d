#pragma once

#include <cstddef>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "worker/ipc/descriptor.h"

namespace tessera::agent {

/// One end of the socket pair between agent and renderer: messages of a 4-byte little-endian length
/// and that many bytes, and open descriptors between messages where both ends expect them.
///
/// Any thread may send; one thread receives.
class MessageSocket {
 public:
  /// No message is longer.
  static constexpr std::size_t kMaxMessageBytes = 256u << 20;

  /// Takes a connected Unix stream socket.
  explicit MessageSocket(Descriptor socket) : socket_(std::move(socket)) {}

  /// Sends a message, then `descriptors` in batches of at most 200. Blocks while the other end does
  /// not read. Errors: Unavailable, the other end is gone; InvalidArgument, over kMaxMessageBytes.
  absl::Status send(const std::string& message, std::span<const int> descriptors = {});

  /// The next message; nullopt when the other end has closed. Errors: DataLoss, it closed in the
  /// middle of a message, or the length is over kMaxMessageBytes.
  absl::StatusOr<std::optional<std::string>> receive();

  /// The `count` descriptors sent after the message received last, in order, close-on-exec.
  /// Errors: DataLoss, fewer came.
  absl::StatusOr<std::vector<Descriptor>> receive_descriptors(std::size_t count);

  /// Makes both ends' receive() return; for another thread that wants to end this one.
  void shut_down();

 private:
  absl::Status write_all(const char* bytes, std::size_t count);
  absl::StatusOr<std::size_t> read_all(char* bytes, std::size_t count);
  absl::Status send_batch(std::span<const int> descriptors);
  absl::Status receive_batch(std::vector<Descriptor>& out);

  Descriptor socket_;
  std::mutex send_mutex_;  // keeps messages whole
};

/// Two connected sockets, both close-on-exec. Errors: Internal.
absl::StatusOr<std::pair<Descriptor, Descriptor>> socket_pair();

}  // namespace tessera::agent
