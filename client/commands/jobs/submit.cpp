#include <CLI/CLI.hpp>
#include <cstdio>
#include <future>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "cli/command.h"
#include "client/commands/jobs/job_commands.h"
#include "client/output/job_status.h"
#include "client/request/job_request.h"
#include "client/request/limit_uses.h"

namespace tessera::client {
namespace {

struct SubmitOptions {
  RenderOptions render;
  std::string name, required_tag, pool, project;
  std::vector<std::string> limits, after, after_any, after_frames;
  int priority = 0, max_workers = 0;
  bool wait = false, json = false;
};

void print_submitted(const v1::CreateJobResponse& made, bool json) {
  if (json) {
    nlohmann::ordered_json document = job_document(made.job());
    document["store_bytes"] = made.store_bytes();
    std::printf("%s\n", document.dump().c_str());
  } else {
    std::printf("%s\n", made.job().id().c_str());
    std::fprintf(stderr, "the job needs up to %.1f MB in the store\n",
                 1e-6 * static_cast<double>(made.store_bytes()));
  }
  std::fflush(stdout);
}

/// Finds the jobs that the new one waits for.
absl::Status add_dependencies(FarmClient& client, const SubmitOptions& options,
                              v1::CreateJobRequest& request) {
  const auto add = [&](const std::vector<std::string>& jobs, v1::JobDependency::Kind kind) {
    for (const std::string& text : jobs) {
      const auto job = client.get_job(text);
      if (!job.ok()) return job.status();
      v1::JobDependency* dependency = request.add_dependencies();
      dependency->set_job_id(job->id());
      dependency->set_kind(kind);
    }
    return absl::OkStatus();
  };
  absl::Status status = add(options.after, v1::JobDependency::KIND_SUCCESS);
  if (status.ok()) status = add(options.after_any, v1::JobDependency::KIND_END);
  if (status.ok()) status = add(options.after_frames, v1::JobDependency::KIND_FRAMES);
  return status;
}

void add_dependency_options(CLI::App& command, SubmitOptions& options) {
  const auto add = [&command](const char* name, std::vector<std::string>& jobs, const char* text) {
    command.add_option(name, jobs, text)->type_name("JOB")->allow_extra_args(false);
  };
  add("--after", options.after, "Job that must be done before this one starts; repeatable");
  add("--after-any", options.after_any,
      "Job that must have ended before this one starts: done, failed, cancelled or removed; "
      "repeatable");
  add("--after-frames", options.after_frames,
      "Job that must have finished a frame before this one starts the same frame; repeatable");
}

int run(const SubmitOptions& options, const Connection& connection) {
  SignalHandler signals;
  auto connecting = std::async(std::launch::async, [&] {  // while the scene is inspected
    auto connected = FarmClient::connect(connection);
    if (connected.ok()) (*connected)->start_connecting();
    return connected;
  });
  auto prepared = prepare_job(options.render, options.name);
  if (!prepared.ok()) return fail(prepared.status());
  for (const std::string& remark : prepared->remarks) {
    std::fprintf(stderr, "%s\n", remark.c_str());
  }
  const auto limits = parse_limit_uses(options.limits);
  if (!limits.ok()) return fail(limits.status());
  const auto client = connecting.get();
  if (!client.ok()) return fail(client.status());
  v1::CreateJobRequest& request = prepared->request;
  request.set_request_id(random_request_id());
  request.set_priority(options.priority);
  request.set_max_worker_count(options.max_workers);
  request.set_required_tag(options.required_tag);
  request.set_pool(options.pool);
  request.set_project(options.project);
  *request.mutable_limits() = limits->limits();
  absl::StatusOr<v1::CreateJobResponse> made = absl::UnknownError("");
  {
    const InterruptAction action(signals, [&] { (*client)->cancel(); });
    const absl::Status found = add_dependencies(**client, options, request);
    if (!found.ok()) return fail(found);
    const absl::Status uploaded = upload_missing(**client, *prepared);
    if (!uploaded.ok()) return fail(uploaded);
    made = (*client)->create_job(request);
  }
  if (!made.ok()) return fail(made.status());
  print_submitted(*made, options.json);
  if (!options.wait) {
    prepared->folder.reset();  // deletes it
    exit_at_once(kExitDone);
    return kExitDone;
  }
  return watch_until_finished(**client, signals, made->job().id(), options.json, prepared->remarks);
}

}  // namespace

void add_submit_command(CLI::App& app, Invocation& invocation) {
  auto options = std::make_shared<SubmitOptions>();
  CLI::App* command =
      cli::add_command(app, "submit", "Submit a scene to a server; prints the job ID");
  add_render_options(*command, options->render);
  add_connection_options(*command, invocation.connection);
  command->add_option("--name", options->name, "Name of the job (default: that of the scene file)");
  command->add_option("--priority", options->priority, "Priority; higher runs first")
      ->check(CLI::Range(-100, 100))
      ->type_name("P")
      ->capture_default_str();
  command
      ->add_option("--max-workers", options->max_workers, "Maximum workers at once; 0: unlimited")
      ->check(CLI::Range(0, 1'000'000))
      ->type_name("N");
  command->add_option("--require-tag", options->required_tag, "Tag that workers must have")
      ->type_name("TAG");
  command
      ->add_option("--pool", options->pool,
                   "Worker pool that renders the job (default: the pool named default)")
      ->type_name("POOL");
  command
      ->add_option(
          "--limit", options->limits,
          "Limit that each leased unit counts against, and by how much (default: 1); repeatable")
      ->type_name("NAME[=AMOUNT]")
      ->allow_extra_args(false);
  command
      ->add_option("--project", options->project,
                   "Project to which the CPU time is accounted (see usage, budgets)")
      ->type_name("PROJECT");
  add_dependency_options(*command, *options);
  command->add_flag("--wait", options->wait, "Wait for the job and return its exit code");
  command->add_flag("--json", options->json, "Print JSON");
  command->footer(
      "Examples:\n  tessera submit scene.glb --frames 0-99 --spp 256\n"
      "  tessera submit scene.glb --wait --require-tag big-memory\n"
      "  tessera submit final.glb --after preview --pool night --limit licence");
  command->callback([options, &invocation] {
    invocation.run = [options, &invocation] { return run(*options, invocation.connection); };
  });
}

}  // namespace tessera::client
