#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "server/state/client_quota.h"

namespace tessera::server {

/// Quotas of clients as the operator gives them.
struct QuotaOptions {
  ClientQuota defaults;
  std::vector<std::string> by_client;  // NAME:QUOTA=VALUE,...
};

/// Adds --client-jobs and the other quotas, and --client-quota.
void add_quota_options(CLI::App& app, QuotaOptions& options);

/// Fills in the defaults that depend on other options and were not given: with certificates a
/// client may have 10,000 unfinished jobs, and half of the store.
void complete_quotas(const CLI::App& app, double store_gb, ClientQuota& defaults);

/// Reads overrides such as "ann:jobs=200,stored-gb=500", one for each client.
///
/// Errors: InvalidArgument, not of this form, a client twice, or an unknown quota.
absl::StatusOr<ClientQuotas> parse_quotas(const QuotaOptions& options);

}  // namespace tessera::server
