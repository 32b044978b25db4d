// A job's timeline: positions of slices, and marks.
#include "client/charts/timeline.h"

#include <gtest/gtest.h>

#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace tessera::client {
namespace {

using nlohmann::ordered_json;

constexpr std::int64_t kStart = 1'700'000'000;  // seconds since 1970

v1::Delivery delivery(const std::string& worker, std::int32_t tile, std::int64_t end_ms,
                      std::int64_t cpu_ms) {
  v1::Delivery made;
  made.set_frame(3);
  made.set_tile(tile);
  made.set_pass(1);
  made.set_worker_id(worker);
  made.set_outcome(v1::Delivery::OUTCOME_COMMITTED);
  made.mutable_end_time()->set_seconds(kStart + end_ms / 1000);
  made.mutable_end_time()->set_nanos(static_cast<int>(end_ms % 1000) * 1'000'000);
  made.mutable_cpu_duration()->set_seconds(cpu_ms / 1000);
  made.mutable_cpu_duration()->set_nanos(static_cast<int>(cpu_ms % 1000) * 1'000'000);
  return made;
}

v1::Event event(v1::Event::Kind kind, const std::string& job, const std::string& worker,
                std::int64_t at_s) {
  v1::Event made;
  made.set_kind(kind);
  made.set_job_id(job);
  made.set_worker_id(worker);
  made.set_message("why");
  made.mutable_event_time()->set_seconds(kStart + at_s);
  return made;
}

ordered_json report_of(int threads) {
  return {{"job", "j"}, {"workers", {{{"id", "w1"}, {"threads", threads}}}}};
}

std::vector<ordered_json> of_phase(const std::string& phase, const std::string& text) {
  std::vector<ordered_json> found;
  const auto document = ordered_json::parse(text);
  for (const ordered_json& entry : document["traceEvents"]) {
    if (entry["ph"] == phase) found.push_back(entry);
  }
  return found;
}

ordered_json of_tile(const std::vector<ordered_json>& slices, int tile) {
  for (const ordered_json& slice : slices) {
    if (slice["args"]["tile"] == tile) return slice;
  }
  return nullptr;
}

TEST(Timeline, SliceEndsWithResultAndLastsCpuTime) {
  v1::Delivery one = delivery("w1", 7, 2500, 1250);
  one.mutable_lease_duration()->set_seconds(2);
  const auto text =
      timeline_json(report_of(1), {one}, {event(v1::Event::KIND_JOB_SUBMITTED, "j", "", 1)});
  ASSERT_TRUE(text.ok()) << text.status();
  const auto slices = of_phase("X", *text);
  ASSERT_EQ(slices.size(), 1U);
  EXPECT_EQ(slices[0]["name"], "frame 3, tile 7, pass 1");
  EXPECT_EQ(slices[0]["cat"], "unit");
  EXPECT_EQ(slices[0]["ts"], 250'000) << "in microseconds since the job was submitted";
  EXPECT_EQ(slices[0]["dur"], 1'250'000);
  EXPECT_DOUBLE_EQ(slices[0]["args"]["lease_seconds"].get<double>(), 2);
  EXPECT_EQ(ordered_json::parse(*text)["otherData"]["begin_unix_us"], (kStart + 1) * 1'000'000);
}

TEST(Timeline, UnitsCommittedTogetherDoNotOverlap) {
  const std::vector<v1::Delivery> together = {
      delivery("w1", 0, 9000, 1000), delivery("w1", 1, 9000, 2000), delivery("w1", 2, 9000, 3000)};
  const auto on_one = timeline_json(report_of(1), together, {});
  ASSERT_TRUE(on_one.ok()) << on_one.status();
  const auto serial = of_phase("X", *on_one);
  EXPECT_EQ(of_tile(serial, 2)["ts"], 0);
  EXPECT_EQ(of_tile(serial, 1)["ts"], 3'000'000);
  EXPECT_EQ(of_tile(serial, 0)["ts"], 5'000'000);
  for (const ordered_json& slice : serial) EXPECT_EQ(slice["tid"], 1);

  const auto on_two = timeline_json(report_of(2), together, {});
  ASSERT_TRUE(on_two.ok()) << on_two.status();
  const auto parallel = of_phase("X", *on_two);
  EXPECT_EQ(of_tile(parallel, 0)["tid"], 1);
  EXPECT_EQ(of_tile(parallel, 1)["tid"], 2);
  EXPECT_EQ(of_tile(parallel, 2)["tid"], 1) << "the thread that is free longest";
  EXPECT_EQ(of_tile(parallel, 2)["ts"], 0);
  EXPECT_EQ(of_tile(parallel, 1)["ts"], 2'000'000);

  ordered_json unknown = report_of(1);
  unknown["workers"][0]["threads"] = nullptr;
  const auto on_any = timeline_json(unknown, together, {});
  ASSERT_TRUE(on_any.ok()) << on_any.status();
  EXPECT_EQ(of_tile(of_phase("X", *on_any), 2)["tid"], 3);
}

TEST(Timeline, WorkersAreProcessesWithNamedThreads) {
  const auto text = timeline_json(
      report_of(2),
      {delivery("w2", 0, 1000, 900), delivery("w1", 1, 1000, 900), delivery("w1", 2, 1000, 900)},
      {});
  ASSERT_TRUE(text.ok()) << text.status();
  std::map<int, std::string> processes;
  int threads = 0;
  for (const ordered_json& name : of_phase("M", *text)) {
    if (name["name"] == "process_name") {
      processes[name["pid"].get<int>()] = name["args"]["name"].get<std::string>();
    }
    threads += name["name"] == "thread_name" ? 1 : 0;
  }
  EXPECT_EQ(processes,
            (std::map<int, std::string>{{0, "job j"}, {1, "worker w1"}, {2, "worker w2"}}));
  EXPECT_EQ(threads, 3);
  EXPECT_EQ(of_tile(of_phase("X", *text), 0)["pid"], 2);
}

TEST(Timeline, RetriesAuditsAndRepeatsAreLabelled) {
  v1::Delivery retry = delivery("w1", 0, 1000, 10), audit = delivery("w1", 1, 2000, 10),
               repeat = delivery("w1", 2, 3000, 10);
  retry.set_retry_count(2);
  audit.set_outcome(v1::Delivery::OUTCOME_AUDIT);
  repeat.set_outcome(v1::Delivery::OUTCOME_DUPLICATE);
  const auto text = timeline_json(report_of(1), {retry, audit, repeat}, {});
  ASSERT_TRUE(text.ok()) << text.status();
  const auto slices = of_phase("X", *text);
  EXPECT_EQ(of_tile(slices, 0)["cat"], "retry");
  EXPECT_EQ(of_tile(slices, 0)["name"], "frame 3, tile 0, pass 1: retry 2");
  EXPECT_EQ(of_tile(slices, 1)["cat"], "audit");
  EXPECT_EQ(of_tile(slices, 2)["cat"], "duplicate");
}

TEST(Timeline, MarksJobAndWorkerEvents) {
  const auto text = timeline_json(report_of(1), {delivery("w1", 0, 9000, 8000)},
                                  {event(v1::Event::KIND_WORKER_LOST, "", "w1", 0),
                                   event(v1::Event::KIND_UNIT_FAILED, "j", "w1", 2),
                                   event(v1::Event::KIND_UNIT_FAILED, "other", "w1", 3),
                                   event(v1::Event::KIND_WORKER_LOST, "", "w1", 4),
                                   event(v1::Event::KIND_WORKER_LOST, "", "stranger", 5),
                                   event(v1::Event::KIND_JOB_DONE, "j", "", 10)});
  ASSERT_TRUE(text.ok()) << text.status();
  const auto marks = of_phase("i", *text);
  ASSERT_EQ(marks.size(), 3U);
  EXPECT_EQ(marks[0]["name"], "unit failed");
  EXPECT_EQ(marks[0]["pid"], 1);
  EXPECT_EQ(marks[0]["ts"], 1'000'000);
  EXPECT_EQ(marks[0]["args"]["message"], "why");
  EXPECT_EQ(marks[1]["name"], "worker lost");
  EXPECT_EQ(marks[2]["name"], "job done");
  EXPECT_EQ(marks[2]["pid"], 0);
}

TEST(Timeline, JobWithoutDeliveriesIsAnError) {
  EXPECT_EQ(timeline_json(report_of(1), {}, {}).status().code(),
            absl::StatusCode::kFailedPrecondition);
}

}  // namespace
}  // namespace tessera::client
