#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "tessera/v1/job_service.pb.h"

namespace tessera::client {

/// Returns the timeline of a job in the Trace Event Format for chrome://tracing and
/// ui.perfetto.dev: workers as processes, their threads as threads, delivered units as slices and
/// events as marks. `report`: the job's report, for the threads of each worker. `events`: events of
/// the whole farm; those of the job and, while it ran, of its workers are included.
///
/// The server knows when a result became durable and its CPU time, but not its start. A slice is as
/// long as its CPU time and placed as late as its end and the later slices of the thread allow, so
/// a worker that was busy with other work shows gaps.
///
/// Errors: FailedPrecondition, the server has no deliveries of the job.
/// Source: "Trace Event Format", Google,
/// docs.google.com/document/d/1CvAClvFfyA5R-PhYUmn5OOQtYMH4h6I0nSsKchNAySU.
absl::StatusOr<std::string> timeline_json(const nlohmann::ordered_json& report,
                                          const std::vector<v1::Delivery>& deliveries,
                                          const std::vector<v1::Event>& events);

}  // namespace tessera::client
