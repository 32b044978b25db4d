#pragma once

#include "client/cli/command.h"

namespace tessera::client {

/// Adds all commands, in the order of --help.
///
/// Each command is added by a function in the file of its name. Options are members of a struct
/// owned by a shared_ptr; the CLI11 callback only stores `invocation.run`:
///
///     void add_status_command(CLI::App& app, Invocation& invocation) {
///       auto options = std::make_shared<StatusOptions>();
///       CLI::App* command = cli::add_command(app, "status", "Show a job's state and progress");
///       add_connection_options(*command, invocation.connection);
///       add_job_argument(*command, options->job);
///       command->add_flag("--json", options->json, "Print JSON (tessera.job/1)");
///       command->callback([options, &invocation] {
///         invocation.run = [options, &invocation] { return run(*options, invocation); };
///       });
///     }
void add_all_commands(CLI::App& app, Invocation& invocation);

}  // namespace tessera::client
