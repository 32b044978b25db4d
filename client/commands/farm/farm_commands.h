#pragma once

#include "client/cli/command.h"

namespace tessera::client {

/// Adds workers with its subcommands: pool, set-aside, bring-back, block, unblock, drain, ban,
/// allow.
void add_workers_command(CLI::App& app, Invocation& invocation);
/// Adds limits with set and remove.
void add_limits_command(CLI::App& app, Invocation& invocation);
/// Adds shares with set and reset.
void add_shares_command(CLI::App& app, Invocation& invocation);
/// Adds budgets with set and remove.
void add_budgets_command(CLI::App& app, Invocation& invocation);
void add_usage_command(CLI::App& app, Invocation& invocation);
void add_quotas_command(CLI::App& app, Invocation& invocation);
/// Adds farm with up and down.
void add_farm_command(CLI::App& app, Invocation& invocation);

}  // namespace tessera::client
