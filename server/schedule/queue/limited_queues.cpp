#include "server/schedule/queue/limited_queues.h"

#include "absl/strings/str_cat.h"

namespace tessera::server {

std::string LimitedQueues::name(const std::string& requirement,
                                const std::vector<LimitUse>& limits) {
  std::string name = requirement;
  for (const LimitUse& use : limits) absl::StrAppend(&name, "\n", use.limit, "=", use.units);
  return name;
}

void LimitedQueues::count(const std::string& requirement, const std::vector<LimitUse>& limits,
                          int sign) {
  if (limits.empty()) return;
  const std::string key = name(requirement, limits);
  Part& part = parts_[key];
  part.requirement = requirement;
  part.limits = limits;
  part.jobs += sign;
  if (part.jobs == 0) parts_.erase(key);
}

std::set<std::string> LimitedQueues::open_parts(const std::set<std::string>& serves) const {
  std::set<std::string> open = serves;
  for (const auto& [key, part] : parts_) {
    if (serves.count(part.requirement) > 0 && limits_.room(part.limits) > 0) open.insert(key);
  }
  return open;
}

absl::Status LimitedQueues::verify(const std::map<std::string, std::int64_t>& jobs) const {
  std::map<std::string, std::int64_t> counted;
  for (const auto& [key, part] : parts_) counted[key] = part.jobs;
  return counted == jobs ? absl::OkStatus() : absl::InternalError("scheduler: limited jobs");
}

}  // namespace tessera::server
