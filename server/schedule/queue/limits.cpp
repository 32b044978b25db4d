#include "server/schedule/queue/limits.h"

#include <algorithm>
#include <limits>

namespace tessera::server {

bool Limits::remove(const std::string& name) {
  const auto found = limits_.find(name);
  if (found == limits_.end() || !found->second.units) return false;
  found->second.units.reset();
  if (found->second.used == 0) limits_.erase(found);
  return true;
}

bool Limits::has(const std::string& name) const {
  const auto found = limits_.find(name);
  return found != limits_.end() && found->second.units.has_value();
}

std::int64_t Limits::room(const std::vector<LimitUse>& uses) const {
  std::int64_t room = std::numeric_limits<std::int64_t>::max();
  for (const LimitUse& use : uses) {
    const auto found = limits_.find(use.limit);
    if (found == limits_.end() || !found->second.units) continue;
    const std::int64_t left = std::max<std::int64_t>(*found->second.units - found->second.used, 0);
    room = std::min(room, left / use.units);
  }
  return room;
}

void Limits::take(const std::vector<LimitUse>& uses, std::int64_t leases) {
  for (const LimitUse& use : uses) {
    Limit& limit = limits_[use.limit];
    limit.used += leases * use.units;
    if (limit.used == 0 && !limit.units) limits_.erase(use.limit);
  }
}

}  // namespace tessera::server
