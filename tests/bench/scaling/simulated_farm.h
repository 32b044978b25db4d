#pragma once

#include <cstdint>
#include <optional>
#include <vector>

namespace tessera::bench {

/// What a real render has shown of its units and of what they cost the coordinator.
struct MeasuredUnits {
  std::vector<double> sample_seconds;  // CPU seconds of one sample of every pixel, by tile; some
  double block_bytes = 0;              // of a unit's result, on the wire
  double merge_seconds = 0;            // the film thread takes for one
};

/// The machines around them.
struct FarmPlan {
  std::int32_t workers = 1;  // of one thread
  double round_trip_seconds = 0.0005;
  double bytes_per_second = 1.25e9;     // into the coordinator: a line of 10 Gbit/s
  double durable_per_second = 228e6;    // bytes, docs/notes/coordinator.md
  double durable_after_seconds = 0.01;  // a group's commit
  /// When a worker dies without a word, and another takes its place at once; at most one.
  std::optional<double> death_seconds;
};

/// The job: 1920x1080 in tiles of 64, say.
struct JobPlanned {
  std::int32_t frames = 100, tiles = 510, spp = 512;
};

struct Simulated {
  double wall_seconds = 0;  // from the first lease to the last merged block
  double unit_seconds = 0;  // rendered and wanted: the sum over the job's units
  double tail_seconds = 0;  // from the moment a worker found nothing to do to the end
  double merge_busy = 0;    // share of the wall time in which the film thread merged
  double ingest_busy = 0;  // share of it in which the store took in bytes, or the line carried them
  std::int64_t units = 0, copies = 0;
};

/// Walks a job through the coordinator's own scheduler (server/schedule) event by event: workers
/// take units, render them for as long as one was measured to take by its samples, and send them
/// down one line into one store and one film thread. Equal arguments give equal results.
Simulated simulate(const MeasuredUnits& measured, const FarmPlan& farm, const JobPlanned& job);

}  // namespace tessera::bench
