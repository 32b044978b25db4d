#include "client/commands/commands.h"

#include "client/commands/completion.h"
#include "client/commands/farm/farm_commands.h"
#include "client/commands/jobs/job_commands.h"
#include "client/commands/local/local_commands.h"

namespace tessera::client {

void add_all_commands(CLI::App& app, Invocation& invocation) {
  add_render_command(app, invocation);
  add_submit_command(app, invocation);
  add_watch_command(app, invocation);
  add_list_command(app, invocation);
  add_status_command(app, invocation);
  add_report_command(app, invocation);
  add_fetch_command(app, invocation);
  add_job_control_commands(app, invocation);
  add_extend_command(app, invocation);
  add_set_command(app, invocation);
  add_events_commands(app, invocation);
  add_workers_command(app, invocation);
  add_limits_command(app, invocation);
  add_shares_command(app, invocation);
  add_budgets_command(app, invocation);
  add_usage_command(app, invocation);
  add_quotas_command(app, invocation);
  add_farm_command(app, invocation);
  add_inspect_command(app, invocation);
  add_compare_command(app, invocation);
  add_denoise_command(app, invocation);
  add_bench_command(app, invocation);
  add_completion_command(app, invocation);
}

}  // namespace tessera::client
