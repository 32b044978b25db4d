#pragma once

#include <nlohmann/json_fwd.hpp>
#include <span>
#include <string>

#include "absl/status/statusor.h"
#include "client/api/farm_client.h"
#include "client/api/signal_handler.h"

namespace tessera::client {

/// "queued", "running", "paused", "done", "failed" or "cancelled".
std::string state_name(v1::Job::State state);

/// Whether the job is done, failed or cancelled.
bool has_ended(const v1::Job& job);

/// The exit code an ended job stands for: 2 where a worker found the scene to be at fault.
int exit_code_of(const v1::Job& job);
/// "converged", "capped" or "uncertain"; empty if no error was asked for or the job is not done.
std::string certainty_name(const v1::Job& job);

/// The job as a document, schema tessera.job/1.
nlohmann::ordered_json job_document(const v1::Job& job);

/// Follows a job to its end on stderr's terminal, or as lines of JSON on stdout. On an interrupt it
/// says that the job goes on. At the end it says what the report has against the result and has not
/// been `said`. Returns the exit code.
int watch_until_finished(FarmClient& client, SignalHandler& interrupts, const std::string& job_id,
                     bool json, std::span<const std::string> said = {});

}  // namespace tessera::client
