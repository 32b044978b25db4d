#include "server/schedule/tables/stopped_accounts.h"

namespace tessera::server {

const std::string* StoppedAccounts::reason_for(const Job& job) const {
  if (reasons_.empty()) return nullptr;
  auto found = reasons_.find({AccountScope::owner, job.spec->owner});
  if (found == reasons_.end() && !job.spec->project.empty()) {
    found = reasons_.find({AccountScope::project, job.spec->project});
  }
  return found == reasons_.end() ? nullptr : &found->second;
}

}  // namespace tessera::server
