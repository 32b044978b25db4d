#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "server/schedule/queue/limits.h"

namespace tessera::server {

/// Limits, and the parts of the queue whose jobs count against them. Jobs with the same requirement
/// and the same limits share a part, so that none of them is looked at while a limit is reached.
/// Pure.
class LimitedQueues {
 public:
  /// Returns the name of the part of the queue for jobs with this requirement and these limits.
  static std::string name(const std::string& requirement, const std::vector<LimitUse>& limits);

  Limits& limits() { return limits_; }
  const Limits& limits() const { return limits_; }
  /// Call with 1 when a job with limits enters the queue, with -1 when it leaves.
  void count(const std::string& requirement, const std::vector<LimitUse>& limits, int sign);
  bool empty() const { return parts_.empty(); }
  /// Returns `serves` and the parts for these requirements whose limits have room.
  std::set<std::string> open_parts(const std::set<std::string>& serves) const;
  /// Returns whether a job could be leased to a worker that meets one of these requirements.
  template <typename ByRequirement>
  bool has_work(const ByRequirement& requirements) const;
  /// Compares with a recount: jobs in each part. Errors: Internal.
  absl::Status verify(const std::map<std::string, std::int64_t>& jobs) const;

 private:
  struct Part {
    std::string requirement;
    std::vector<LimitUse> limits;
    std::int64_t jobs = 0;
  };
  Limits limits_;
  std::map<std::string, Part> parts_;  // by name()
};

template <typename ByRequirement>
bool LimitedQueues::has_work(const ByRequirement& requirements) const {
  return std::any_of(parts_.begin(), parts_.end(), [&](const auto& entry) {
    const Part& part = entry.second;
    return requirements.count(part.requirement) > 0 && limits_.room(part.limits) > 0;
  });
}

}  // namespace tessera::server
