#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "server/commit/commit_pipeline.h"
#include "server/state/farm_state.h"
#include "server/store/store.h"

namespace tessera::server {

/// Where a client's weight comes from; numbers as in v1.ClientShare.Source.
enum class ShareSource { by_default = 1, option, set };

/// A client's weight in fair share, and its usage: decayed CPU seconds per weight, with units in
/// flight.
struct ShareView {
  std::string client;
  double weight = 1;
  ShareSource source = ShareSource::by_default;
  double usage = 0;
};

/// Weights of clients in fair share, and their past use, over restarts. A weight that an operator
/// has set replaces that of the server's options (SharePolicy::weights). Thread-safe.
class ClientShares {
 public:
  static constexpr std::size_t kMaxSet = 10'000;

  ClientShares(FarmState& farm, Store& store, CommitPipeline& pipeline)
      : farm_(farm), store_(store), pipeline_(pipeline) {}

  /// Loads weights and use of the store into the farm, before any thread runs. Errors: those of the
  /// store.
  absl::Status load(FarmChange& change);

  using Answer = std::function<void(absl::StatusOr<ShareView>)>;
  /// Sets a client's weight durably, for later leases, then calls `done`. Requires a weight in
  /// [kMinWeight, kMaxWeight]. Errors: ResourceExhausted, there are kMaxSet others; those of the
  /// store.
  void set(const std::string& client, double weight, Answer done);
  /// Returns a client to the weight of the options, else 1, durably, then calls `done`. Errors:
  /// NotFound, its weight is not set; those of the store.
  void reset(const std::string& client, Answer done);
  /// Returns the clients whose weight is set or in the options, by name; with a client only that
  /// one.
  std::vector<ShareView> list(const std::string& client) const;

  /// Writes the use of clients. Call every few seconds: a crash loses what was used since.
  void write_use(FarmChange& change);

 private:
  using Weights = std::map<std::string, double>;

  absl::StatusOr<ShareView> set_now(const std::string& client, double weight);
  absl::StatusOr<ShareView> reset_now(const std::string& client);
  absl::StatusOr<ShareView> change_now(const std::string& client, Weights weights);
  ShareView view_of(const FarmView& farm, const std::string& client) const;
  const Weights& options() const { return farm_.options().policy.share.weights; }

  FarmState& farm_;
  Store& store_;
  CommitPipeline& pipeline_;
  Weights set_;  // guarded by the farm's lock
};

}  // namespace tessera::server
