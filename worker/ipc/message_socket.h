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

/// One end of the socket pair between agent and renderer. A message is a 4-byte little-endian
/// length and its bytes; open descriptors follow a message where both ends expect them.
///
/// send() is thread-safe; only one thread may receive.
class MessageSocket {
 public:
  /// Maximum length of a message.
  static constexpr std::size_t kMaxMessageBytes = 256u << 20;

  /// Takes a connected Unix stream socket.
  explicit MessageSocket(Descriptor socket) : socket_(std::move(socket)) {}

  /// Sends a message, then `descriptors` in batches of at most 200. Blocks while the other end does
  /// not read. Errors: Unavailable, the other end is closed; InvalidArgument, the message is longer
  /// than kMaxMessageBytes.
  absl::Status send(const std::string& message, std::span<const int> descriptors = {});

  /// Returns the next message; nullopt when the other end has closed. Errors: DataLoss, it closed
  /// within a message, or the length exceeds kMaxMessageBytes.
  absl::StatusOr<std::optional<std::string>> receive();

  /// Returns the `count` descriptors sent after the last received message, in order, close-on-exec.
  /// Errors: DataLoss, fewer arrived.
  absl::StatusOr<std::vector<Descriptor>> receive_descriptors(std::size_t count);

  /// Makes receive() return at both ends. Thread-safe.
  void shut_down();

 private:
  absl::Status write_all(const char* bytes, std::size_t count);
  absl::StatusOr<std::size_t> read_all(char* bytes, std::size_t count);
  absl::Status send_batch(std::span<const int> descriptors);
  absl::Status receive_batch(std::vector<Descriptor>& out);

  Descriptor socket_;
  std::mutex send_mutex_;  // one message at a time
};

/// Returns two connected sockets, both close-on-exec. Errors: Internal.
absl::StatusOr<std::pair<Descriptor, Descriptor>> socket_pair();

}  // namespace tessera::agent
