#pragma once

#include <grpcpp/server_context.h>

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "server/identity/identity.h"
#include "server/sync/mutex.h"

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
    Stream(Identity holder, grpc::CallbackServerContext& its_context)
        : identity(std::move(holder)), context(&its_context) {}
    const Identity identity;
    /// Held while the stream is cut, which may run OnDone on the same thread.
    RecursiveMutex mutex ABSL_ACQUIRED_AFTER(lock_order::kCall)
        ABSL_ACQUIRED_BEFORE(lock_order::kConnection);
    /// Null when the stream has ended.
    grpc::CallbackServerContext* context ABSL_GUARDED_BY(mutex);
  };
  struct Entry {
    std::shared_ptr<Stream> stream;  // owners: the table, the result of add() and cut_refused()
    std::optional<Time> refused_since = {};
  };
  struct Table {
    Mutex mutex ABSL_ACQUIRED_AFTER(lock_order::kPart)
        ABSL_ACQUIRED_BEFORE(lock_order::kPipeline){lock_order::kPart};
    std::int64_t last_key ABSL_GUARDED_BY(mutex) = 0;
    std::map<std::int64_t, Entry> streams ABSL_GUARDED_BY(mutex);
  };

  const std::shared_ptr<Table> table_ = std::make_shared<Table>();  // owners: this and the results
};

}  // namespace tessera::server
