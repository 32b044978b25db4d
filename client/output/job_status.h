#pragma once

#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>

#include "absl/status/statusor.h"
#include "client/api/farm_client.h"
#include "client/api/signal_handler.h"

namespace tessera::client {

/// Returns "queued", "running", "paused", "done", "failed" or "cancelled".
std::string state_name(v1::Job::State state);
/// Returns the name of a dependency, as in the options of `submit` and in JSON documents: `after`,
/// `after-any`, `after-frames`.
std::string dependency_name(v1::JobDependency::Kind kind);

/// Returns "user", "store full" or "failures"; empty if the job is not paused.
std::string pause_cause_name(const v1::Job& job);
/// Returns whether units kept failing on independent workers, so that the job waits for somebody to
/// look at it.
bool is_paused_by_failures(const v1::Job& job);

/// Returns whether the job is done, failed or cancelled.
bool has_ended(const v1::Job& job);

/// Returns the exit code for a job that has ended or is paused by failures; see
/// docs/reference/exit-codes.md.
int exit_code_of(const v1::Job& job);

/// Returns "converged", "capped" or "uncertain"; empty without an error target or if the job is not
/// done.
std::string certainty_name(const v1::Job& job);

/// Returns the job as a document of schema tessera.job/1.
nlohmann::ordered_json job_document(const v1::Job& job);

/// Shows progress until the job ends or is paused by failures, on a terminal (stderr) or as JSON
/// lines (stdout), then prints those warnings of the report that are not in `already_printed`. On
/// an interrupt the job keeps running. Returns the exit code.
int watch_until_finished(FarmClient& client, SignalHandler& signals, const std::string& job_id,
                         bool json, std::span<const std::string> already_printed = {});

}  // namespace tessera::client
