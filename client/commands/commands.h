#pragma once

#include "client/cli/command.h"

namespace tessera::client {

/// Each function adds one subcommand and lives in the file of that name. Options are members of a
/// struct owned by a shared_ptr; the CLI11 callback only stores `invocation.run`:
///
///     void add_status_command(CLI::App& app, Invocation& invocation) {
///       auto options = std::make_shared<StatusOptions>();
///       CLI::App* command = cli::add_command(app, "status", "Show a job's state and progress");
///       add_connection_options(*command, invocation.connection);
///       add_job_argument(*command, options->job);
///       command->add_flag("--json", options->json, "JSON output (tessera.job/1)");
///       command->callback([options, &invocation] {
///         invocation.run = [options, &invocation] { return run(*options, invocation); };
///       });
///     }
///
/// add_all_commands (commands.cpp) calls them in the order of --help.
void add_render_command(CLI::App& app, Invocation& invocation);
void add_submit_command(CLI::App& app, Invocation& invocation);
void add_watch_command(CLI::App& app, Invocation& invocation);

void add_list_command(CLI::App& app, Invocation& invocation);
void add_status_command(CLI::App& app, Invocation& invocation);
void add_report_command(CLI::App& app, Invocation& invocation);
void add_fetch_command(CLI::App& app, Invocation& invocation);
/// Adds pause, resume, cancel, retry and remove.
void add_job_control_commands(CLI::App& app, Invocation& invocation);
void add_extend_command(CLI::App& app, Invocation& invocation);
void add_set_command(CLI::App& app, Invocation& invocation);
/// Adds logs and events.
void add_events_commands(CLI::App& app, Invocation& invocation);
/// Adds workers with its subcommands: pool, set-aside, bring-back, block, unblock, drain, ban,
/// allow.
void add_workers_command(CLI::App& app, Invocation& invocation);
/// Adds limits with set and remove.
void add_limits_command(CLI::App& app, Invocation& invocation);
/// Adds budgets with set and remove.
void add_budgets_command(CLI::App& app, Invocation& invocation);
void add_usage_command(CLI::App& app, Invocation& invocation);
void add_quotas_command(CLI::App& app, Invocation& invocation);
/// Adds farm with up and down.
void add_farm_command(CLI::App& app, Invocation& invocation);
void add_inspect_command(CLI::App& app, Invocation& invocation);
void add_compare_command(CLI::App& app, Invocation& invocation);
void add_denoise_command(CLI::App& app, Invocation& invocation);
void add_bench_command(CLI::App& app, Invocation& invocation);
void add_completion_command(CLI::App& app, Invocation& invocation);

void add_all_commands(CLI::App& app, Invocation& invocation);

}  // namespace tessera::client
