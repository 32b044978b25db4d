#pragma once

#include "client/cli/command.h"

namespace tessera::client {

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

}  // namespace tessera::client
