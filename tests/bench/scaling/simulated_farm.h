#pragma once

#include <cstdint>
#include <optional>
#include <vector>

namespace tessera::bench {

/// Measured costs of units for workers and coordinator.
struct MeasuredUnits {
  std::vector<double> sample_seconds;  // CPU seconds of one sample of every pixel, for some tiles
  double block_bytes = 0;              // transmitted bytes of a unit's result
  double merge_seconds = 0;            // time that a film thread takes to merge one
  double image_seconds = 0;            // time that it takes to write the image of a frame
};

/// The simulated machines.
struct FarmPlan {
  std::int32_t workers = 1;  // with one thread each
  double round_trip_seconds = 0.0005;
  double bytes_per_second = 1.25e9;     // into the coordinator: 10 Gbit/s
  double durable_per_second = 228e6;    // bytes, docs/notes/coordinator.md
  double durable_after_seconds = 0.01;  // commit of a group
  int film_threads = 4;                 // of a server with four cores or more
  /// Time at which a worker dies silently and another replaces it at once; at most one.
  std::optional<double> death_seconds;
};

/// The job, for example 1920x1080 in tiles of 64.
struct JobPlanned {
  std::int32_t frames = 100, tiles = 510, spp = 512;
};

struct Simulated {
  double wall_seconds = 0;  // from the first lease to the last image
  double unit_seconds = 0;  // render time of all units of the job
  double tail_seconds = 0;  // from the moment when the first worker is idle to the end
  double film_busy = 0;     // share of the film threads' time in which they worked
  double ingest_busy = 0;   // share of it in which the store wrote, or the network carried, bytes
  std::int64_t units = 0, copies = 0;
};

/// Simulates a job event by event with the scheduler of the coordinator (server/schedule): workers
/// take units, render them for the measured time per sample, and send them over one network link
/// to one store, whose film threads merge them and write images. Equal arguments give equal
/// results.
Simulated simulate(const MeasuredUnits& measured, const FarmPlan& farm, const JobPlanned& job);

}  // namespace tessera::bench
