#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "contract/unit.h"
#include "server/store/farm/usage_store.h"
#include "server/store/sqlite/journal.h"

namespace tessera::server {

/// Accounts as rows of the journal.
class UsageRows final : public UsageStore {
 public:
  explicit UsageRows(const Journal& journal) : journal_(journal) {}

  absl::StatusOr<std::vector<UsageSum>> read(const UsageQuery& query,
                                             std::size_t limit) const override;
  absl::StatusOr<std::map<std::int64_t, Kept>> kept() const override;
  absl::StatusOr<double> cpu_seconds(const UsageQuery& query) const override;

  // Parts of the transactions that add and remove units. `job`: jobs.sequence.
  static absl::Status charge(Database& rows, std::int64_t job, std::int64_t hour,
                             std::int64_t units, double cpu_seconds);
  /// Takes back the charge of committed units. Before their rows are deleted.
  static absl::Status refund(Database& rows, std::int64_t job,
                             const std::vector<contract::Unit>& units);

 private:
  const Journal& journal_;
};

}  // namespace tessera::server
