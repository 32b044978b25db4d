#pragma once

#include <grpcpp/server_context.h>

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "server/identity/identity.h"

namespace tessera::server {

/// The streams that callers with certificates have open, so that they can be ended when the
/// certificate is revoked or expires. Thread-safe.
class OpenStreams {
 public:
  using Time = std::chrono::steady_clock::time_point;
  /// Time for a stream that checks its caller itself to end with a status that says why, before it
  /// is cut.
  static constexpr std::chrono::milliseconds kGrace{1500};

  /// Adds a stream until the result is destroyed, which must be in OnDone at the latest: the
  /// context does not outlive it.
  std::shared_ptr<const void> add(grpc::CallbackServerContext& context, const Identity& identity);

  /// Cuts the streams whose callers `is_allowed` has refused for kGrace; their callers see
  /// CANCELLED. Returns the number of streams cut. Call about twice a second.
  std::size_t cut_refused(const std::function<bool(const Identity&)>& is_allowed, Time now);

  /// Returns the number of open streams.
  std::size_t size() const;

 private:
  struct Stream {
    explicit Stream(Identity holder) : identity(std::move(holder)) {}
    const Identity identity;
    std::optional<Time> refused_since;  // guarded by the table's mutex
    /// Held while the stream is cut, which may run OnDone on the same thread.
    std::recursive_mutex mutex;
    grpc::CallbackServerContext* context = nullptr;  // null when the stream has ended
  };
  struct Table {
    std::mutex mutex;
    std::int64_t last_key = 0;
    std::map<std::int64_t, std::shared_ptr<Stream>> streams;
  };

  const std::shared_ptr<Table> table_ = std::make_shared<Table>();  // owners: this and the results
};

}  // namespace tessera::server
