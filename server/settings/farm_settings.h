#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/commit/commit_pipeline.h"
#include "server/state/farm_state.h"
#include "server/store/store.h"

namespace tessera::server {

/// A limit, and the units of it that leases use.
struct LimitView {
  std::string name;
  std::int64_t units = 0, used = 0;
};

/// Limits, pools of workers, and workers that are set aside: settings of operators. A change is
/// durable before it takes effect. Thread-safe.
class FarmSettings {
 public:
  static constexpr std::size_t kMaxLimits = 10'000;

  FarmSettings(FarmState& farm, Store& store, CommitPipeline& pipeline)
      : farm_(farm), store_(store), pipeline_(pipeline) {}

  /// Loads the settings of the store into the farm, before any thread runs. Errors: those of the
  /// store.
  absl::Status load(FarmChange& change);

  /// Sets how many units of a limit exist, then calls `done`. Errors: ResourceExhausted, there are
  /// kMaxLimits others; those of the store.
  void set_limit(const std::string& name, std::int64_t units,
                 std::function<void(absl::StatusOr<LimitView>)> done);
  /// Removes a limit, then calls `done`. Errors: NotFound; those of the store.
  void remove_limit(const std::string& name, std::function<void(absl::Status)> done);
  /// Returns all limits by name.
  std::vector<LimitView> limits() const;

  /// Moves a worker to a pool (empty: the one that it names itself), then calls `done`. Errors:
  /// NotFound, it was not connected within the last hour; those of the store.
  void move_worker(const std::string& worker_id, const std::string& pool,
                   std::function<void(absl::Status)> done);

  /// Sets a worker aside durably, then calls `done`. Errors: NotFound, it was not connected within
  /// the last hour; those of the store.
  void set_aside(const std::string& worker_id, const std::string& reason,
                 std::function<void(absl::Status)> done);
  /// Brings a worker back durably, then calls `done`. Errors: NotFound, it is neither set aside nor
  /// was it connected within the last hour; those of the store.
  void bring_back(const std::string& worker_id, std::function<void(absl::Status)> done);

 private:
  absl::StatusOr<LimitView> set_limit_now(const std::string& name, std::int64_t units);
  absl::Status remove_limit_now(const std::string& name);
  absl::Status move_now(const std::string& worker_id, const std::string& pool);
  absl::Status set_aside_now(const std::string& worker_id, const std::string& reason);
  absl::Status bring_back_now(const std::string& worker_id);

  FarmState& farm_;
  Store& store_;
  CommitPipeline& pipeline_;
};

}  // namespace tessera::server
