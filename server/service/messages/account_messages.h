#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "server/settings/budget_ledger.h"
#include "server/store/farm/usage_store.h"
#include "tessera/v1/farm_service.pb.h"

namespace tessera::server {

// Converts and checks messages about shares, budgets and accounts. Errors: InvalidArgument, as in
// messages.h.

absl::StatusOr<Account> to_account(v1::Budget::Scope scope, const std::string& name);
absl::StatusOr<Budget> from_message(const v1::Budget& message);
/// Checks a weight in fair share.
absl::Status check_weight(double weight);
v1::Budget to_message(const Account& account, const BudgetState& state);
/// Converts a request, with its page token.
absl::StatusOr<UsageQuery> from_message(const v1::ListUsageRequest& message);
v1::Usage to_message(const UsageSum& sum);
std::string page_token_after(const UsageSum& sum);

}  // namespace tessera::server
