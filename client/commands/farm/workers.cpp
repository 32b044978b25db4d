#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "cli/command.h"
#include "client/api/farm_client.h"
#include "client/cli/progress.h"
#include "client/cli/table.h"
#include "client/commands/farm/farm_commands.h"

namespace tessera::client {
namespace {

struct WorkersOptions {
  bool json = false;
};

std::string state_name(v1::Worker::State state) {
  switch (state) {
    case v1::Worker::STATE_IDLE:
      return "idle";
    case v1::Worker::STATE_BUSY:
      return "busy";
    case v1::Worker::STATE_DRAINING:
      return "draining";
    case v1::Worker::STATE_LOST:
      return "lost";
    case v1::Worker::STATE_LEFT:
      return "left";
    case v1::Worker::STATE_QUARANTINED:
      return "quarantined";
    case v1::Worker::STATE_SET_ASIDE:
      return "set aside";
    default:
      return "unknown";
  }
}

nlohmann::ordered_json document_of(const v1::Worker& worker) {
  nlohmann::ordered_json tags = nlohmann::ordered_json::array();
  for (const std::string& tag : worker.tags()) tags.push_back(tag);
  return {{"id", worker.id()},
          {"name", worker.name()},
          {"host", worker.host()},
          {"state", state_name(worker.state())},
          {"isa", worker.isa()},
          {"threads", worker.thread_count()},
          {"tags", tags},
          {"pool", worker.pool()},
          {"note", worker.note()},
          {"certificate", worker.certificate()},
          {"units_leased", worker.leased_unit_count()},
          {"units_committed", worker.committed_unit_count()},
          {"cpu_seconds", worker.cpu_seconds()},
          {"rss_bytes", worker.rss_bytes()},
          {"silence_seconds", worker.has_silence()
                                  ? nlohmann::ordered_json(to_seconds(worker.silence()))
                                  : nlohmann::ordered_json()},
          {"connected", worker.connected()}};
}

/// Returns the IDs of the connected workers with each certificate.
std::map<std::string, std::vector<std::string>> by_certificate(
    const std::vector<v1::Worker>& workers) {
  std::map<std::string, std::vector<std::string>> found;
  for (const v1::Worker& worker : workers) {
    if (worker.certificate().empty() || !worker.connected()) continue;
    found[worker.certificate()].push_back(worker.id());
  }
  return found;
}

int run(const WorkersOptions& options, const Connection& connection) {
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  const auto workers = (*client)->list_workers();
  if (!workers.ok()) return fail(workers.status());
  if (options.json) {
    nlohmann::ordered_json document = {{"schema", "tessera.workers/2"},
                                       {"workers", nlohmann::ordered_json::array()}};
    for (const v1::Worker& worker : *workers) document["workers"].push_back(document_of(worker));
    std::printf("%s\n", document.dump(2).c_str());
    return kExitDone;
  }
  Table table({"WORKER", "STATE", "POOL", "THREADS", "ISA", "LEASED", "COMMITTED", "CPU S",
               "MEMORY", "HOST", "NAME", "TAGS", "NOTE"});
  for (const v1::Worker& worker : *workers) {
    table.add({worker.id(), state_name(worker.state()), worker.pool(),
               std::to_string(worker.thread_count()), worker.isa(),
               std::to_string(worker.leased_unit_count()),
               std::to_string(worker.committed_unit_count()),
               absl::StrFormat("%.1f", worker.cpu_seconds()),
               format_bytes(static_cast<double>(worker.rss_bytes())), worker.host(), worker.name(),
               worker.tags().empty() ? "-" : absl::StrJoin(worker.tags(), ","),
               worker.note().empty() ? "-" : worker.note()});
  }
  std::fputs(table.text().c_str(), stdout);
  for (const auto& [certificate, ids] : by_certificate(*workers)) {
    if (ids.size() < 2) continue;
    std::fprintf(stderr,
                 "warning: %zu workers share the certificate %s: they do not audit each other, and "
                 "a ban of one bans all\n",
                 ids.size(), certificate.c_str());
  }
  return kExitDone;
}

/// A command for one worker.
struct Order {
  const char* name;
  const char* description;
  const char* result;  // printed after the worker ID
  absl::Status (FarmClient::*call)(const std::string& worker_id);
};

constexpr Order kOrders[] = {
    {"drain", "Drain a worker: finish started units, return the rest, exit", "is draining",
     &FarmClient::drain_worker},
    {"allow", "Lift a worker's ban or quarantine", "is allowed", &FarmClient::allow_worker},
    {"bring-back", "Return a set-aside worker to service", "is back in service",
     &FarmClient::bring_back_worker},
};

/// Returns the ID of the worker whose ID, ID prefix or name is `text`. If several match, it is the
/// one that is connected: after a restart the earlier process is listed for a while. Errors:
/// NotFound; InvalidArgument, several match.
absl::StatusOr<std::string> find_listed_worker(FarmClient& client, const std::string& text) {
  const auto workers = client.list_workers();
  if (!workers.ok()) return workers.status();
  std::vector<std::string> matches, connected;
  for (const v1::Worker& worker : *workers) {
    if (worker.id() == text) return text;
    if (worker.name() != text && !absl::StartsWith(worker.id(), text)) continue;
    matches.push_back(worker.id());
    if (worker.connected()) connected.push_back(worker.id());
  }
  if (connected.size() == 1) return connected.front();
  if (matches.size() == 1) return matches.front();
  if (matches.empty()) return absl::NotFoundError(absl::StrCat("no worker \"", text, "\""));
  return absl::InvalidArgumentError(
      absl::StrCat("\"", text, "\" matches several workers: ", absl::StrJoin(matches, " ")));
}

/// Returns the same, or `text` if no listed worker matches: the server decides about it.
absl::StatusOr<std::string> find_worker(FarmClient& client, const std::string& text) {
  auto found = find_listed_worker(client, text);
  return absl::IsNotFound(found.status()) ? text : found;
}

int run_order(const Order& order, const std::string& text, const Connection& connection) {
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  const auto id = find_worker(**client, text);
  if (!id.ok()) return fail(id.status());
  if (const absl::Status status = ((**client).*order.call)(*id); !status.ok()) return fail(status);
  std::printf("%s %s\n", id->c_str(), order.result);
  return kExitDone;
}

/// Says which workers the ban will affect before it bans them.
int run_ban(const std::string& text, const Connection& connection) {
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  const auto id = find_worker(**client, text);
  if (!id.ok()) return fail(id.status());
  const auto workers = (*client)->list_workers();
  if (!workers.ok()) return fail(workers.status());
  for (const auto& [certificate, ids] : by_certificate(*workers)) {
    if (ids.size() < 2 || std::find(ids.begin(), ids.end(), *id) == ids.end()) continue;
    std::fprintf(stderr, "%zu connected workers have the certificate %s; the ban is for all: %s\n",
                 ids.size(), certificate.c_str(), absl::StrJoin(ids, " ").c_str());
  }
  const auto banned = (*client)->ban_worker(*id);
  if (!banned.ok()) return fail(banned.status());
  // A server of an earlier version does not list them.
  const std::vector<std::string> listed = banned->empty() ? std::vector{*id} : *banned;
  for (const std::string& worker : listed) std::printf("%s is banned\n", worker.c_str());
  return kExitDone;
}

void add_ban(CLI::App& command, Invocation& invocation) {
  auto worker = std::make_shared<std::string>();
  CLI::App* sub = cli::add_command(
      command, "ban",
      "Ban a worker: lease it nothing and reject its results; lasts across server restarts");
  add_connection_options(*sub, invocation.connection);
  sub->add_option("worker", *worker, "Worker ID, unique prefix, or name")->required();
  sub->footer(
      "All workers with the same certificate are banned; the command lists them.\n"
      "Example:\n  tessera workers ban w-0f3a");
  sub->callback([worker, &invocation] {
    invocation.run = [worker, &invocation] { return run_ban(*worker, invocation.connection); };
  });
}

struct MoveOptions {
  std::string worker, pool;
};

int run_move(const MoveOptions& options, const Connection& connection) {
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  const auto id = find_worker(**client, options.worker);
  if (!id.ok()) return fail(id.status());
  if (const absl::Status status = (*client)->move_worker(*id, options.pool); !status.ok()) {
    return fail(status);
  }
  std::printf("%s is in %s\n", id->c_str(),
              options.pool.empty() ? "its own pool" : ("pool " + options.pool).c_str());
  return kExitDone;
}

void add_move(CLI::App& command, Invocation& invocation) {
  auto options = std::make_shared<MoveOptions>();
  CLI::App* sub = cli::add_command(
      command, "pool",
      "Move a worker to a pool; lasts across restarts of the server and the worker");
  add_connection_options(*sub, invocation.connection);
  sub->add_option("worker", options->worker, "Worker ID, unique prefix, or name")->required();
  sub->add_option("pool", options->pool,
                  "Name of the pool; \"\": the pool that the worker was started with")
      ->required();
  sub->footer(
      "The worker returns units that it has not started.\n"
      "Example:\n  tessera workers pool w-0f3a night");
  sub->callback([options, &invocation] {
    invocation.run = [options, &invocation] { return run_move(*options, invocation.connection); };
  });
}

struct AsideOptions {
  std::string worker, reason;
};

int run_set_aside(const AsideOptions& options, const Connection& connection) {
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  const auto id = find_worker(**client, options.worker);
  if (!id.ok()) return fail(id.status());
  const absl::Status status = (*client)->set_aside_worker(*id, options.reason);
  if (!status.ok()) return fail(status);
  std::printf("%s is set aside\n", id->c_str());
  return kExitDone;
}

void add_set_aside(CLI::App& command, Invocation& invocation) {
  auto options = std::make_shared<AsideOptions>();
  CLI::App* sub = cli::add_command(
      command, "set-aside", "Take a worker out of service, across restarts; it stays connected");
  add_connection_options(*sub, invocation.connection);
  sub->add_option("worker", options->worker, "Worker ID, unique prefix, or name")->required();
  sub->add_option("--reason", options->reason, "Note for other operators")->type_name("TEXT");
  sub->footer(
      "The worker finishes the units that it has started and returns the others.\n"
      "Example:\n  tessera workers set-aside w-0f3a --reason \"new memory on Monday\"");
  sub->callback([options, &invocation] {
    invocation.run = [options, &invocation] {
      return run_set_aside(*options, invocation.connection);
    };
  });
}

/// A command that blocks or unblocks a worker for one job.
struct Block {
  const char* name;
  const char* description;
  const char* result;
  bool is_blocked;
};

constexpr Block kBlocks[] = {
    {"block", "Block a worker for one job: lease it none of the job's units", "is blocked", true},
    {"unblock", "Unblock a worker for a job", "is no longer blocked", false},
};

struct BlockOptions {
  std::string worker, job;
};

int run_block(const Block& block, const BlockOptions& options, const Connection& connection) {
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return fail(client.status());
  // The server accepts any ID, so that a worker can be blocked before it connects.
  const auto id = block.is_blocked ? find_listed_worker(**client, options.worker)
                                   : find_worker(**client, options.worker);
  if (!id.ok()) return fail(id.status());
  const auto job = (*client)->get_job(options.job);
  if (!job.ok()) return fail(job.status());
  v1::UpdateJobRequest request;
  request.set_job_id(job->id());
  (block.is_blocked ? request.mutable_block_worker_ids() : request.mutable_unblock_worker_ids())
      ->Add(std::string(*id));
  const auto changed = (*client)->update_job(request);
  if (!changed.ok()) return fail(changed.status());
  std::printf("%s %s for job %s\n", id->c_str(), block.result, job->id().c_str());
  return kExitDone;
}

void add_blocks(CLI::App& command, Invocation& invocation) {
  for (const Block& block : kBlocks) {
    auto options = std::make_shared<BlockOptions>();
    CLI::App* sub = cli::add_command(command, block.name, block.description);
    add_connection_options(*sub, invocation.connection);
    sub->add_option("worker", options->worker, "Worker ID, unique prefix, or name")->required();
    sub->add_option("--job", options->job, "Job ID, unique prefix, name, or last")
        ->type_name("JOB")
        ->required();
    sub->footer(
        absl::StrCat("The owner of a job may block and unblock workers for it.\n"
                     "Example:\n  tessera workers ",
                     block.name, " w-0f3a --job last"));
    sub->callback([&block, options, &invocation] {
      invocation.run = [&block, options, &invocation] {
        return run_block(block, *options, invocation.connection);
      };
    });
  }
}

void add_orders(CLI::App& command, Invocation& invocation) {
  add_ban(command, invocation);
  add_move(command, invocation);
  add_set_aside(command, invocation);
  add_blocks(command, invocation);
  for (const Order& order : kOrders) {
    auto worker = std::make_shared<std::string>();
    CLI::App* sub = cli::add_command(command, order.name, order.description);
    add_connection_options(*sub, invocation.connection);
    sub->add_option("worker", *worker, "Worker ID, unique prefix, or name")->required();
    sub->footer(absl::StrCat("Example:\n  tessera workers ", order.name, " w-0f3a"));
    sub->callback([&order, worker, &invocation] {
      invocation.run = [&order, worker, &invocation] {
        return run_order(order, *worker, invocation.connection);
      };
    });
  }
  command.require_subcommand(0, 1);
}

}  // namespace

void add_workers_command(CLI::App& app, Invocation& invocation) {
  auto options = std::make_shared<WorkersOptions>();
  CLI::App* command =
      cli::add_command(app, "workers",
                       "List workers connected now or within the last hour, and banned or "
                       "set-aside ones");
  add_connection_options(*command, invocation.connection);
  command->add_flag("--json", options->json, "Print JSON (tessera.workers/2)");
  add_orders(*command, invocation);
  command->footer(
      "On farms with certificates, pool, set-aside, bring-back, drain, ban and allow require an\n"
      "admin certificate.\n"
      "Examples:\n  tessera workers\n  tessera workers drain w-0f3a");
  command->callback([command, options, &invocation] {
    if (!command->get_subcommands().empty()) return;  // the subcommand has its own callback
    invocation.run = [options, &invocation] { return run(*options, invocation.connection); };
  });
}

}  // namespace tessera::client
