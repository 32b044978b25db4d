#include "server/schedule/tables/stopped_accounts.h"

#include <algorithm>
#include <utility>

namespace tessera::server {

bool StoppedAccounts::set(Reasons reasons) {
  std::swap(reasons_, reasons);
  return !std::equal(reasons_.begin(), reasons_.end(), reasons.begin(), reasons.end(),
                     [](const auto& a, const auto& b) { return a.first == b.first; });
}

const std::string* StoppedAccounts::reason_for(const Job& job) const {
  if (reasons_.empty()) return nullptr;
  auto found = reasons_.find({AccountScope::owner, job.spec->owner});
  if (found == reasons_.end() && !job.spec->project.empty()) {
    found = reasons_.find({AccountScope::project, job.spec->project});
  }
  return found == reasons_.end() ? nullptr : &found->second;
}

}  // namespace tessera::server
