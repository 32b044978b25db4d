#pragma once

#include "client/cli/command.h"

namespace tessera::client {

/// Each adds one subcommand; its file is named after it. Pattern: options live in a struct held by
/// a shared_ptr, the CLI11 callback only stores `invocation.run`:
///
///     void add_status_command(CLI::App& app, Invocation& invocation) {
///       auto options = std::make_shared<StatusOptions>();
///       CLI::App* command = app.add_subcommand("status", "Say how a job is doing");
///       add_connection_options(*command, invocation.connection);
///       command->add_option("job", options->job, "Id, prefix, name, or last")->required();
///       command->add_flag("--json", options->json, "Print a JSON document");
///       command->callback([options, &invocation] {
///         invocation.run = [options, &invocation] { return run(*options, invocation); };
///       });
///     }
///
/// add_all_commands (commands.cpp) calls them in the order of --help. Commands over jobs, workers
/// and files list their sources in management.cmake.
void add_render_command(CLI::App& app, Invocation& invocation);
void add_submit_command(CLI::App& app, Invocation& invocation);
void add_watch_command(CLI::App& app, Invocation& invocation);

void add_list_command(CLI::App& app, Invocation& invocation);
void add_status_command(CLI::App& app, Invocation& invocation);
void add_report_command(CLI::App& app, Invocation& invocation);
void add_fetch_command(CLI::App& app, Invocation& invocation);
/// pause, resume, cancel, retry and remove.
void add_job_control_commands(CLI::App& app, Invocation& invocation);
void add_extend_command(CLI::App& app, Invocation& invocation);
/// logs and events.
void add_events_commands(CLI::App& app, Invocation& invocation);
/// workers, and workers drain, ban and allow.
void add_workers_command(CLI::App& app, Invocation& invocation);
/// farm up and farm down.
void add_farm_command(CLI::App& app, Invocation& invocation);
void add_inspect_command(CLI::App& app, Invocation& invocation);
void add_compare_command(CLI::App& app, Invocation& invocation);
void add_bench_command(CLI::App& app, Invocation& invocation);
void add_completion_command(CLI::App& app, Invocation& invocation);

void add_all_commands(CLI::App& app, Invocation& invocation);

}  // namespace tessera::client
