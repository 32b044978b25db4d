#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "tessera/v1/job_service.pb.h"

namespace tessera::client {

/// A job's timeline in the Trace Event Format, which chrome://tracing and ui.perfetto.dev show: a
/// process a worker, a thread a thread of it, a slice a delivered unit, and a mark for what
/// happened. `report` says how many threads a worker has; `events` are those of the whole farm,
/// of which those of the job and, while it ran, of its workers are taken.
///
/// The server knows when a result was durable and how much CPU time it took, not when it was begun:
/// a slice is as long as its CPU time and lies as late as its end and its thread's later slices let
/// it. So a worker that was busy with something else shows gaps.
///
/// Errors: FailedPrecondition, nothing is known of the job's units (why).
/// Source: "Trace Event Format", Google,
/// docs.google.com/document/d/1CvAClvFfyA5R-PhYUmn5OOQtYMH4h6I0nSsKchNAySU.
absl::StatusOr<std::string> timeline_json(const nlohmann::ordered_json& report,
                                          const std::vector<v1::Delivery>& deliveries,
                                          const std::vector<v1::Event>& events);

}  // namespace tessera::client
