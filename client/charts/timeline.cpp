#include "client/charts/timeline.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/api/event_document.h"

namespace tessera::client {
namespace {

using nlohmann::ordered_json;

/// Returns a time in µs, the unit of the format.
template <typename TimeMessage>  // google.protobuf.Timestamp or Duration
std::int64_t micros(const TimeMessage& span) {
  return span.seconds() * 1'000'000 + span.nanos() / 1000;
}

struct Slice {
  const v1::Delivery* delivery = nullptr;
  std::int64_t begin_us = 0, end_us = 0;
  std::size_t thread = 0;
};

/// Assigns a worker's deliveries to `most` threads, latest first: each to the thread that is free
/// the longest, cut where that thread's next slice starts.
std::vector<Slice> place(std::vector<const v1::Delivery*> deliveries, std::size_t most) {
  std::stable_sort(deliveries.begin(), deliveries.end(), [](const auto* a, const auto* b) {
    return micros(a->end_time()) > micros(b->end_time());
  });
  std::vector<std::int64_t> free_until;  // by thread
  std::vector<Slice> slices;
  slices.reserve(deliveries.size());
  for (const v1::Delivery* delivery : deliveries) {
    const std::int64_t end = micros(delivery->end_time());
    auto thread = std::max_element(free_until.begin(), free_until.end());
    if ((thread == free_until.end() || *thread < end) && free_until.size() < most) {
      thread = free_until.insert(free_until.end(), end);
    }
    const std::int64_t last = std::min(end, *thread);
    *thread = last - micros(delivery->cpu_duration());
    slices.push_back(
        {delivery, *thread, last, static_cast<std::size_t>(thread - free_until.begin())});
  }
  return slices;
}

std::string title(const v1::Delivery& delivery) {
  std::string text = absl::StrCat("frame ", delivery.frame(), ", tile ", delivery.tile(), ", pass ",
                                  delivery.pass());
  if (delivery.outcome() == v1::Delivery::OUTCOME_AUDIT) absl::StrAppend(&text, ": audit");
  if (delivery.outcome() == v1::Delivery::OUTCOME_DUPLICATE) absl::StrAppend(&text, ": duplicate");
  if (delivery.retry_count() > 0) absl::StrAppend(&text, ": retry ", delivery.retry_count());
  return text;
}

const char* category(const v1::Delivery& delivery) {
  switch (delivery.outcome()) {
    case v1::Delivery::OUTCOME_AUDIT:
      return "audit";
    case v1::Delivery::OUTCOME_DUPLICATE:
      return "duplicate";
    default:
      return delivery.retry_count() > 0 ? "retry" : "unit";
  }
}

ordered_json slice_json(const Slice& slice, int process, std::int64_t begin_us) {
  const v1::Delivery& delivery = *slice.delivery;
  ordered_json facts = {{"frame", delivery.frame()},
                        {"tile", delivery.tile()},
                        {"pass", delivery.pass()},
                        {"retries", delivery.retry_count()},
                        {"cpu_seconds", 1e-6 * static_cast<double>(slice.end_us - slice.begin_us)}};
  if (delivery.has_lease_duration()) {
    facts["lease_seconds"] = 1e-6 * static_cast<double>(micros(delivery.lease_duration()));
  }
  return {{"name", title(delivery)},
          {"cat", category(delivery)},
          {"ph", "X"},
          {"ts", slice.begin_us - begin_us},
          {"dur", slice.end_us - slice.begin_us},
          {"pid", process},
          {"tid", static_cast<int>(slice.thread) + 1},
          {"args", std::move(facts)}};
}

ordered_json name_json(const char* kind, const std::string& name, int process, int thread) {
  return {
      {"name", kind}, {"ph", "M"}, {"pid", process}, {"tid", thread}, {"args", {{"name", name}}}};
}

/// Returns the number of threads of each worker in the report.
std::map<std::string, std::size_t> threads_of(const ordered_json& report) {
  std::map<std::string, std::size_t> threads;
  for (const ordered_json& worker : report.value("workers", ordered_json::array())) {
    const auto count = worker.find("threads");
    if (count == worker.end() || !count->is_number_integer()) continue;
    threads[worker.value("id", "")] = std::max(1, count->get<int>());
  }
  return threads;
}

/// Slices of all workers, and their time range.
struct Layout {
  std::map<std::string, std::vector<Slice>> workers;
  std::int64_t begin_us = std::numeric_limits<std::int64_t>::max(), end_us = 0;
};

Layout lay_out(const ordered_json& report, const std::vector<v1::Delivery>& deliveries) {
  std::map<std::string, std::vector<const v1::Delivery*>> by_worker;
  for (const v1::Delivery& delivery : deliveries) {
    by_worker[delivery.worker_id()].push_back(&delivery);
  }
  const auto threads = threads_of(report);
  Layout layout;
  for (const auto& [worker, its] : by_worker) {
    const auto known = threads.find(worker);
    const std::vector<Slice>& slices = layout.workers[worker] =
        place(its, known == threads.end() ? its.size() : known->second);
    for (const Slice& slice : slices) {
      layout.begin_us = std::min(layout.begin_us, slice.begin_us);
      layout.end_us = std::max(layout.end_us, slice.end_us);
    }
  }
  return layout;
}

void add_worker(const std::string& worker, const std::vector<Slice>& slices, int process,
                std::int64_t begin_us, ordered_json& trace) {
  trace.push_back(name_json("process_name", absl::StrCat("worker ", worker), process, 0));
  std::size_t threads = 0;
  for (const Slice& slice : slices) threads = std::max(threads, slice.thread + 1);
  for (std::size_t i = 1; i <= threads; ++i) {
    trace.push_back(
        name_json("thread_name", absl::StrCat("thread ", i), process, static_cast<int>(i)));
  }
  for (const Slice& slice : slices) trace.push_back(slice_json(slice, process, begin_us));
}

ordered_json event_json(const v1::Event& event, int process, std::int64_t begin_us) {
  return {{"name", event_name(event.kind())},
          {"cat", "event"},
          {"ph", "i"},
          {"s", "p"},
          {"ts", micros(event.event_time()) - begin_us},
          {"pid", process},
          {"tid", 0},
          {"args", {{"message", event.message()}, {"worker", event.worker_id()}}}};
}

}  // namespace

absl::StatusOr<std::string> timeline_json(const ordered_json& report,
                                          const std::vector<v1::Delivery>& deliveries,
                                          const std::vector<v1::Event>& events) {
  if (deliveries.empty()) {
    return absl::FailedPreconditionError(
        "no deliveries recorded: nothing committed yet, or the server has restarted since (it "
        "keeps "
        "the newest 100,000 in memory)");
  }
  const std::string job = report.value("job", "");
  Layout layout = lay_out(report, deliveries);
  for (const v1::Event& event : events) {
    if (event.job_id() != job) continue;
    layout.begin_us = std::min(layout.begin_us, micros(event.event_time()));
  }
  ordered_json trace = ordered_json::array();
  trace.push_back(name_json("process_name", absl::StrCat("job ", job), 0, 0));
  std::map<std::string, int> processes;
  for (const auto& [worker, slices] : layout.workers) {
    const int process = static_cast<int>(processes.size()) + 1;
    processes[worker] = process;
    add_worker(worker, slices, process, layout.begin_us, trace);
  }
  for (const v1::Event& event : events) {
    const auto process = processes.find(event.worker_id());
    const std::int64_t time_us = micros(event.event_time());
    const bool is_of_its_workers = event.job_id().empty() && process != processes.end() &&
                                   time_us >= layout.begin_us && time_us <= layout.end_us;
    if (event.job_id() != job && !is_of_its_workers) continue;
    trace.push_back(
        event_json(event, process == processes.end() ? 0 : process->second, layout.begin_us));
  }
  const ordered_json document = {{"traceEvents", std::move(trace)},
                                 {"displayTimeUnit", "ms"},
                                 {"otherData", {{"job", job}, {"begin_unix_us", layout.begin_us}}}};
  // Messages of workers may contain invalid UTF-8.
  return document.dump(1, ' ', false, ordered_json::error_handler_t::replace) + "\n";
}

}  // namespace tessera::client
