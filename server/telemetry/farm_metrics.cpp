#include "server/telemetry/farm_metrics.h"

#include <string>

#include "absl/strings/ascii.h"
#include "server/schedule/plan/job_spec.h"
#include "telemetry/registry/families.h"

namespace tessera::server {
namespace {

using metrics::counter;
using metrics::counters;
using metrics::gauge;
using metrics::gauges;
using metrics::histogram;
using prometheus::Counter;
using prometheus::Family;
using prometheus::Gauge;
using prometheus::Histogram;
using prometheus::Registry;

/// Bucket bounds in seconds, for the disk and for merging.
Histogram::BucketBoundaries to_ten_seconds() {
  return {0.0001, 0.0003, 0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1, 3, 10};
}

/// Bucket bounds in seconds, for leases and frames, which vary widely.
Histogram::BucketBoundaries to_half_a_day() {
  return {0.01, 0.03, 0.1, 0.3, 1, 3, 10, 30, 100, 1000, 10000, 40000};
}

std::array<Counter*, 4> acknowledgement_counters(Registry& registry) {
  Family<Counter>& family =
      counters(registry, "tessera_acknowledgements_total", "Acknowledgements of delivered results");
  return {&family.Add({{"status", "committed"}}), &family.Add({{"status", "duplicate"}}),
          &family.Add({{"status", "obsolete"}}), &family.Add({{"status", "rejected"}})};
}

FarmMetrics::Errors error_counters(Registry& registry) {
  Family<Counter>& family =
      counters(registry, "tessera_errors_total", "Recoverable errors, by kind");
  const auto add = [&](const char* kind) -> Counter& { return family.Add({{"kind", kind}}); };
  return {add("unit_failed"), add("worker_lost"), add("block_rejected"),
          add("commit"),      add("journal"),     add("film")};
}

FarmMetrics::FilmBlocks film_block_counters(Registry& registry) {
  Family<Counter>& family = counters(registry, "tessera_film_blocks_total",
                                     "Blocks merged as delivered, or read back from the store");
  return {family.Add({{"source", "delivered"}}), family.Add({{"source", "store"}})};
}

FarmMetrics::Units unit_gauges(Registry& registry) {
  Family<Gauge>& family =
      gauges(registry, "tessera_units", "Units of unfinished jobs; waiting units are the queue");
  const auto add = [&](const char* state) -> Gauge& { return family.Add({{"state", state}}); };
  return {add("waiting"), add("blocked"), add("paused"), add("leased"), add("committed")};
}

std::array<Gauge*, 6> job_gauges(Registry& registry) {
  Family<Gauge>& family = gauges(registry, "tessera_jobs", "Jobs in the store");
  std::array<Gauge*, 6> jobs{};
  for (std::size_t i = 0; i < jobs.size(); ++i) {
    const std::string state = state_name(static_cast<JobState>(i + 1));
    jobs[i] = &family.Add({{"state", absl::AsciiStrToLower(state)}});
  }
  return jobs;
}

FarmMetrics::Workers worker_gauges(Registry& registry) {
  Family<Gauge>& family =
      gauges(registry, "tessera_workers", "Workers connected now, or within the last hour");
  const auto add = [&](const char* state) -> Gauge& { return family.Add({{"state", state}}); };
  return {add("working"),      add("draining"), add("quarantined"), add("set_aside"),
          add("disconnected"), add("lost"),     add("left")};
}

std::array<Gauge*, 3> paused_job_gauges(Registry& registry) {
  Family<Gauge>& family = gauges(registry, "tessera_jobs_paused", "Paused jobs, by cause");
  const auto add = [&](const char* cause) { return &family.Add({{"cause", cause}}); };
  return {add("user"), add("store_full"), add("failures")};
}

}  // namespace

FarmMetrics::FarmMetrics()
    : units_committed(counter(registry_, "tessera_units_committed_total", "Units made durable")),
      samples(counter(registry_, "tessera_samples_total", "Samples of committed units")),
      block_bytes(counter(registry_, "tessera_block_bytes_total", "Film blocks made durable")),
      cpu_seconds(counter(registry_, "tessera_cpu_seconds_total",
                          "CPU time that workers spent on committed units")),
      acknowledgements(acknowledgement_counters(registry_)),
      audits_ended(counter(registry_, "tessera_audits_total", "Finished audits")),
      results_mismatched(counter(registry_, "tessera_results_mismatched_total",
                                 "Results that differ from the committed one")),
      workers_quarantined(counter(registry_, "tessera_workers_quarantined_total",
                                  "Workers found to deliver wrong pixels")),
      errors(error_counters(registry_)),
      film_blocks(film_block_counters(registry_)),
      unit_turnaround_seconds(histogram(registry_, "tessera_unit_turnaround_seconds",
                                        "From the lease of a unit until it is durable",
                                        to_half_a_day())),
      commit_seconds(histogram(registry_, "tessera_commit_seconds",
                               "Making a group of units durable, fsync included",
                               to_ten_seconds())),
      fsync_seconds(histogram(registry_, "tessera_fsync_duration_seconds",
                              "fdatasync of blocks and scene files, and commits of the journal",
                              to_ten_seconds())),
      merge_seconds(histogram(registry_, "tessera_merge_seconds", "Merging a block into the film",
                              to_ten_seconds())),
      frame_write_seconds(histogram(registry_, "tessera_frame_write_duration_seconds",
                                    "Writing the image of a finished frame", to_half_a_day())),
      units(unit_gauges(registry_)),
      jobs(job_gauges(registry_)),
      workers(worker_gauges(registry_)),
      worker_threads(
          gauge(registry_, "tessera_worker_threads", "Threads of workers in state working")),
      ingest_bytes(gauge(registry_, "tessera_ingest_bytes",
                         "Delivered blocks in memory that are not yet durable and merged")),
      film_bytes(gauge(registry_, "tessera_film_bytes", "Merged tiles in memory")),
      film_queue_length(
          gauge(registry_, "tessera_film_queue_length", "Backlog of the film threads")),
      store_bytes(gauge(registry_, "tessera_store_bytes", "Disk space of the store")),
      store_free_bytes(
          gauge(registry_, "tessera_store_free_bytes", "Free space of the store's disk")),
      store_quota_bytes(gauge(registry_, "tessera_store_quota_bytes",
                              "Size of the store above which new jobs are refused")),
      pools{{gauges(registry_, "tessera_pool_units_waiting",
                    "Units that a worker of the pool could be leased now"),
             {"pool"}},
            {gauges(registry_, "tessera_pool_units_for_new_workers",
                    "Units that further workers of the pool with the tag could be leased now"),
             {"tag", "pool"}},
            {gauges(registry_, "tessera_pool_oldest_wait_seconds",
                    "Longest time that a job of the pool has had waiting units and no leased one"),
             {"pool"}},
            {gauges(registry_, "tessera_pool_worker_threads",
                    "Threads of the working workers of the pool"),
             {"pool"}}},
      limits{{gauges(registry_, "tessera_limit_units", "Units of the limit"), {"limit"}},
             {gauges(registry_, "tessera_limit_used_units", "Units of the limit that leases use"),
              {"limit"}}},
      budget_used_fraction(gauges(registry_, "tessera_budget_used_fraction",
                                  "Fraction of the budget used in the current period"),
                           {"account"}),
      paused_jobs(paused_job_gauges(registry_)),
      quota_used_fraction(gauges(registry_, "tessera_client_quota_used_fraction",
                                 "Fraction used of the client's quota closest to its limit"),
                          {"client"}),
      certificate_expiry(gauges(registry_, "tessera_certificate_expiry_timestamp_seconds",
                                "When the server's certificate expires, seconds since 1970")),
      quota_refusals(counters(registry_, "tessera_quota_refusals_total",
                              "Requests refused because of a quota")) {}

}  // namespace tessera::server
