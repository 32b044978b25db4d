#pragma once

#include <map>
#include <string>
#include <utility>

#include "server/schedule/plan/job.h"

namespace tessera::server {

/// Accounts whose jobs are leased nothing, for example because their budgets are used up. Pure.
class StoppedAccounts {
 public:
  using Reasons = std::map<Account, std::string>;

  /// Returns whether other accounts are stopped now.
  bool set(Reasons reasons);
  /// Returns why units of the job's account are not leased; nullptr if they are.
  const std::string* reason_for(const Job& job) const;

 private:
  Reasons reasons_;
};

}  // namespace tessera::server
