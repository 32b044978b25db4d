#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "server/schedule/plan/job_spec.h"

namespace tessera::server {

/// Named limits, such as licences: how many units of each exist, and how many leases use. A limit
/// that is not set limits nothing, but its use is counted. Pure.
class Limits {
 public:
  struct Limit {
    std::optional<std::int64_t> units;  // absent: not set
    std::int64_t used = 0;              // more than `units` after the limit was lowered
  };

  void set(const std::string& name, std::int64_t units) { limits_[name].units = units; }
  /// Returns whether the limit was set.
  bool remove(const std::string& name);
  bool has(const std::string& name) const;
  const std::map<std::string, Limit>& all() const { return limits_; }

  /// Returns how many further leases with these uses are allowed; the maximum of int64 without
  /// limits.
  std::int64_t room(const std::vector<LimitUse>& uses) const;
  /// Counts `leases` leases with these uses; negative: no longer.
  void take(const std::vector<LimitUse>& uses, std::int64_t leases);

 private:
  std::map<std::string, Limit> limits_;
};

}  // namespace tessera::server
