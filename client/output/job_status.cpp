#include "client/output/job_status.h"

#include <chrono>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "absl/time/time.h"
#include "client/cli/progress.h"
#include "client/output/render_result.h"

namespace tessera::client {
namespace {

constexpr std::chrono::milliseconds kWatchInterval{500};

std::string rfc3339(const google::protobuf::Timestamp& moment) {
  return absl::FormatTime(
      "%Y-%m-%dT%H:%M:%E3SZ",
      absl::FromUnixSeconds(moment.seconds()) + absl::Nanoseconds(moment.nanos()),
      absl::UTCTimeZone());
}

nlohmann::ordered_json progress_document(const v1::JobProgress& progress) {
  nlohmann::ordered_json document = {{"units", progress.unit_count()},
                                     {"units_committed", progress.committed_unit_count()},
                                     {"units_leased", progress.leased_unit_count()},
                                     {"frames", progress.frame_count()},
                                     {"frames_finished", progress.finished_frame_count()},
                                     {"samples", progress.sample_count()},
                                     {"samples_committed", progress.committed_sample_count()},
                                     {"workers", progress.worker_count()},
                                     {"cpu_seconds", progress.cpu_seconds()},
                                     {"elapsed_seconds", to_seconds(progress.elapsed())},
                                     {"remaining_seconds", nullptr},
                                     {"estimated_error", nullptr}};
  if (progress.has_remaining()) document["remaining_seconds"] = to_seconds(progress.remaining());
  if (progress.has_estimated_error()) document["estimated_error"] = progress.estimated_error();
  return document;
}

nlohmann::ordered_json limits_document(const v1::Job& job) {
  nlohmann::ordered_json document = nlohmann::ordered_json::array();
  for (const v1::LimitUse& use : job.limits()) {
    document.push_back({{"limit", use.limit()}, {"units", use.unit_count()}});
  }
  return document;
}

nlohmann::ordered_json blocked_workers_document(const v1::Job& job) {
  nlohmann::ordered_json document = nlohmann::ordered_json::array();
  for (const std::string& worker : job.blocked_worker_ids()) document.push_back(worker);
  return document;
}

nlohmann::ordered_json attempts_document(const v1::Job& job) {
  nlohmann::ordered_json document = nlohmann::ordered_json::array();
  for (const v1::FailedAttempt& attempt : job.failed_attempts()) {
    document.push_back({{"frame", attempt.frame()},
                        {"tile", attempt.tile()},
                        {"pass", attempt.pass()},
                        {"worker", attempt.worker_id()},
                        {"message", attempt.message()}});
  }
  return document;
}

nlohmann::ordered_json dependencies_document(const v1::Job& job) {
  nlohmann::ordered_json document = nlohmann::ordered_json::array();
  for (const v1::JobDependency& dependency : job.dependencies()) {
    document.push_back(
        {{"job", dependency.job_id()}, {"kind", dependency_name(dependency.kind())}});
  }
  return document;
}

/// Prints the warnings in the report of a finished job to stderr.
void print_warnings(FarmClient& client, const std::string& job_id,
                    std::span<const std::string> already_printed) {
  const auto text = client.get_report(job_id);
  const auto report = nlohmann::ordered_json::parse(text.value_or(""), nullptr, false);
  if (report.is_object()) std::fputs(warning_lines(report, already_printed).c_str(), stderr);
}

}  // namespace

std::string state_name(v1::Job::State state) {
  switch (state) {
    case v1::Job::STATE_QUEUED:
      return "queued";
    case v1::Job::STATE_RUNNING:
      return "running";
    case v1::Job::STATE_PAUSED:
      return "paused";
    case v1::Job::STATE_DONE:
      return "done";
    case v1::Job::STATE_FAILED:
      return "failed";
    case v1::Job::STATE_CANCELLED:
      return "cancelled";
    default:
      return "unknown";
  }
}

std::string dependency_name(v1::JobDependency::Kind kind) {
  switch (kind) {
    case v1::JobDependency::KIND_SUCCESS:
      return "after";
    case v1::JobDependency::KIND_END:
      return "after-any";
    case v1::JobDependency::KIND_FRAMES:
      return "after-frames";
    default:
      return "unknown";
  }
}

std::string certainty_name(const v1::Job& job) {
  switch (job.certainty()) {
    case v1::Job::CERTAINTY_CONVERGED:
      return "converged";
    case v1::Job::CERTAINTY_CAPPED:
      return "capped";
    case v1::Job::CERTAINTY_UNCERTAIN:
      return "uncertain";
    default:
      return "";
  }
}

std::string pause_cause_name(const v1::Job& job) {
  switch (job.pause_cause()) {
    case v1::Job::PAUSE_CAUSE_USER:
      return "user";
    case v1::Job::PAUSE_CAUSE_STORE_FULL:
      return "store full";
    case v1::Job::PAUSE_CAUSE_FAILURES:
      return "failures";
    default:
      return "";
  }
}

bool is_paused_by_failures(const v1::Job& job) {
  return job.pause_cause() == v1::Job::PAUSE_CAUSE_FAILURES;
}

bool has_ended(const v1::Job& job) {
  return job.state() == v1::Job::STATE_DONE || job.state() == v1::Job::STATE_FAILED ||
         job.state() == v1::Job::STATE_CANCELLED;
}

int exit_code_of(const v1::Job& job) {
  if (job.state() == v1::Job::STATE_DONE) {
    const bool is_uncertified = job.certainty() == v1::Job::CERTAINTY_CAPPED ||
                                job.certainty() == v1::Job::CERTAINTY_UNCERTAIN;
    return is_uncertified ? kExitUncertain : kExitDone;
  }
  if (job.state() != v1::Job::STATE_FAILED && !is_paused_by_failures(job)) return kExitJobFailed;
  return failed_job_exit_code(static_cast<absl::StatusCode>(job.failure_code()));
}

nlohmann::ordered_json job_document(const v1::Job& job) {
  nlohmann::ordered_json document = {{"schema", "tessera.job/1"},
                                     {"id", job.id()},
                                     {"name", job.name()},
                                     {"owner", job.owner()},
                                     {"state", state_name(job.state())},
                                     {"reason", job.reason()},
                                     {"paused_by", nullptr},
                                     {"failed_attempts", attempts_document(job)},
                                     {"priority", job.priority()},
                                     {"max_workers", job.max_worker_count()},
                                     {"required_tag", job.required_tag()},
                                     {"pool", job.pool()},
                                     {"project", job.project()},
                                     {"blocked_workers", blocked_workers_document(job)},
                                     {"limits", limits_document(job)},
                                     {"dependencies", dependencies_document(job)},
                                     {"created", rfc3339(job.create_time())},
                                     {"ended", nullptr},
                                     {"progress", progress_document(job.progress())}};
  if (job.settings().has_error_target()) {
    document["error_target"] = job.settings().error_target();
    document["certainty"] = nullptr;
    if (const std::string name = certainty_name(job); !name.empty()) document["certainty"] = name;
  }
  if (const std::string cause = pause_cause_name(job); !cause.empty()) {
    document["paused_by"] = cause;
  }
  if (job.has_end_time()) document["ended"] = rfc3339(job.end_time());
  return document;
}

int watch_until_finished(FarmClient& client, SignalHandler& signals, const std::string& job_id,
                         bool json, std::span<const std::string> already_printed) {
  const InterruptAction action(signals, [&client] { client.cancel(); });
  ProgressBar bar;
  std::string waits_for;
  const auto job = client.watch_job(job_id, kWatchInterval, [&](const v1::Job& now) {
    if (json) {
      std::printf("%s\n", job_document(now).dump().c_str());
      std::fflush(stdout);
      return !is_paused_by_failures(now);
    }
    if (is_paused_by_failures(now)) return false;  // until somebody has looked at it
    // Print the reason why a job waits once, also without a progress bar.
    if (now.reason() != waits_for && !now.reason().empty() && !has_ended(now)) {
      bar.clear();
      std::fprintf(stderr, "job %s is waiting: %s\n", job_id.c_str(), now.reason().c_str());
    }
    waits_for = now.reason();
    bar.show(now);
    return true;
  });
  bar.clear();
  if (absl::IsCancelled(job.status())) {
    std::fprintf(stderr, "tessera: job %s keeps running; `tessera watch %s` resumes watching\n",
                 job_id.c_str(), job_id.c_str());
    return kExitInterrupted;
  }
  if (!job.ok()) return fail(job.status());
  if (!json) {
    const std::string certainty = certainty_name(*job);
    std::fprintf(stderr, "job %s %s%s%s%s%s\n", job_id.c_str(), state_name(job->state()).c_str(),
                 certainty.empty() ? "" : ", ", certainty.c_str(),
                 job->reason().empty() ? "" : ": ", job->reason().c_str());
    if (is_paused_by_failures(*job)) {
      std::fprintf(stderr, "tessera: `tessera retry %s` resumes the job\n", job_id.c_str());
    }
    if (job->state() == v1::Job::STATE_DONE) print_warnings(client, job_id, already_printed);
  }
  return exit_code_of(*job);
}

}  // namespace tessera::client
