#include "server/coordinator/coordinator.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "absl/strings/match.h"
#include "tests/unit/server/coordinator/coordinator_fixture.h"

namespace tessera::server {
namespace {

using namespace std::chrono_literals;
using CoordinatorTest = CoordinatorFixture;

int count(const std::vector<Acknowledgement>& acknowledgements, AckStatus status) {
  return static_cast<int>(std::count_if(acknowledgements.begin(), acknowledgements.end(),
                                        [&](const auto& v) { return v.status == status; }));
}

// Results -----------------------------------------------------------------------------------------

TEST_F(CoordinatorTest, SingleWorkerCompletesJob) {
  const std::string job = create_job("a", 64);
  auto worker = join("w1");
  finish_job(worker, job);
  const JobView done = view(job);
  EXPECT_EQ(done.state, JobState::done);
  EXPECT_EQ(done.committed_unit_count, 12);
  EXPECT_EQ(done.committed_sample_count, 20 * 12 * 64);
  EXPECT_DOUBLE_EQ(done.cpu_seconds, 6);
  EXPECT_EQ(count(worker.acknowledgements, AckStatus::committed), 12);
  EXPECT_EQ(worker.ended, std::vector<std::string>{job});
  const auto frames = store.frames().list(job);
  ASSERT_EQ(frames->size(), 1u);
  EXPECT_TRUE(
      std::filesystem::exists(*store.frames().output_folder(job) + "/" + frames->front().file));
}

TEST_F(CoordinatorTest, WaitingJobExplainsMissingWorkers) {
  const std::string job = create_job("a");
  EXPECT_EQ(view(job).reason, "no workers connected");
  JobSpec choosy = spec_of("b");
  choosy.required_tag = "big";
  const std::string tagged = create(choosy)->view.spec->id;
  auto worker = join("w1", 1);
  EXPECT_EQ(view(job).reason, "");
  EXPECT_EQ(view(tagged).reason, "no connected worker has tag big");
  coordinator->workers().begin_draining(worker.session);
  EXPECT_EQ(view(job).reason, "no workers connected");
  ASSERT_TRUE(change(job, JobAdmin::Change::cancel).ok());
  EXPECT_EQ(view(job).reason, "cancelled") << "it does not wait";
}

TEST_F(CoordinatorTest, LogLevelsMatchSeverity) {
  std::map<LogLevel, std::vector<std::string>> lines;
  options.log = [&lines](LogLevel level, const std::string& text) { lines[level].push_back(text); };
  start();
  const std::string id = create_job("told");
  TestWorker ann = join("ann");
  EXPECT_EQ(lines[LogLevel::info],
            (std::vector<std::string>{"worker ann connected: ann on , , 2 threads",
                                      "job " + id + " is RUNNING"}));
  ASSERT_FALSE(ann.units.empty());
  const Leased unit = ann.units.front();
  coordinator->workers().fail_unit(ann.session, unit.lease, unit.name.unit.tile,
                                   {"", "out of luck", ""}, absl::StatusCode::kInternal);
  ASSERT_EQ(lines[LogLevel::warn].size(), 1u);
  EXPECT_EQ(lines[LogLevel::warn].front(), "worker ann: job " + id + ", frame 0, tile " +
                                               std::to_string(unit.name.unit.tile) +
                                               ", pass 0 failed: out of luck");
  lines.clear();
  finish_job(ann, id);
  EXPECT_EQ(lines[LogLevel::info], (std::vector<std::string>{"job " + id + ", frame 0 finished",
                                                             "job " + id + " is DONE"}));
  EXPECT_FALSE(lines[LogLevel::debug].empty()) << "commits are not logged at info";
  EXPECT_TRUE(lines[LogLevel::warn].empty());
  EXPECT_TRUE(lines[LogLevel::error].empty());
}

TEST_F(CoordinatorTest, AcknowledgesOnlyDurableBlocks) {
  create_job("a");
  auto worker = join("w1");
  deliver_all(worker);
  collect(worker);
  EXPECT_TRUE(worker.acknowledgements.empty());
  store.controls().fail_commits_with(absl::UnavailableError("disk"));
  pump();
  collect(worker);
  EXPECT_TRUE(worker.acknowledgements.empty()) << "no acknowledgement: the worker sends again";
}

TEST_F(CoordinatorTest, PendingBlocksFormOneJournalGroup) {
  create_job("a");
  auto worker = join("w1");
  deliver_all(worker);
  pump();
  EXPECT_EQ(store.units().group_count(), 1);
}

TEST_F(CoordinatorTest, PixelsAreDeliveryIndependent) {
  options.policy.audit_fraction = 0;
  start();
  const std::string alone = create_job("a", 64);
  auto worker = join("w1");
  finish_job(worker, alone);

  const std::string shared = create_job("b", 64);
  auto second = join("w2");
  collect(worker);
  std::vector<std::pair<const TestWorker*, Leased>> all;
  for (const auto* w : {&worker, &second}) {
    for (const Leased& unit : w->units) all.emplace_back(w, unit);
  }
  ASSERT_EQ(all.size(), 12u);
  std::reverse(all.begin(), all.end());  // last passes and tiles first
  for (const auto& [w, unit] : all) {
    deliver(*w, unit, bytes_of(unit));
    deliver(*w, unit, bytes_of(unit));
    pump();
  }
  EXPECT_EQ(view(shared).state, JobState::done);
  EXPECT_NE(pixels_of(alone), "");
  EXPECT_EQ(pixels_of(alone), pixels_of(shared));
}

TEST_F(CoordinatorTest, EveryBlockIsAcknowledgedOnce) {
  const std::string job = create_job("a");
  auto worker = join("w1");
  const auto units = worker.units;
  ASSERT_EQ(units.size(), 6u);
  deliver(worker, units[0], bytes_of(units[0]));
  deliver(worker, units[0], bytes_of(units[0]));  // twice in one group
  pump();
  collect(worker);
  EXPECT_EQ(count(worker.acknowledgements, AckStatus::committed), 1);
  EXPECT_EQ(count(worker.acknowledgements, AckStatus::duplicate), 1);
  deliver(worker, units[0], bytes_of(units[0]));  // and later
  pump();
  collect(worker);
  EXPECT_EQ(count(worker.acknowledgements, AckStatus::duplicate), 2);
  EXPECT_EQ(worker.acknowledgements.size(), 3u);
  const auto report = coordinator->queries().report(job);
  EXPECT_EQ(report->counters.duplicated, 2);
  EXPECT_DOUBLE_EQ(report->counters.wasted_cpu_seconds, 1);
}

TEST_F(CoordinatorTest, MismatchedDuplicateIsRejected) {
  const std::string job = create_job("a");
  auto worker = join("w1");
  const Leased unit = worker.units[0];
  deliver(worker, unit, bytes_of(unit));
  pump();
  contract::FilmBlock other = block_of(unit, shape_of(unit));
  other.rgb[3] += 1;
  deliver(worker, unit, contract::encode(other));
  pump();
  collect(worker);
  EXPECT_EQ(count(worker.acknowledgements, AckStatus::rejected), 1);
  EXPECT_EQ(coordinator->queries().report(job)->counters.mismatched, 1);
  EXPECT_EQ(view(job).state, JobState::running);
}

TEST_F(CoordinatorTest, LateResultsOfLostWorkerAreAccepted) {
  const std::string job = create_job("a");
  auto worker = join("w1");
  const auto units = worker.units;
  for (int i = 0; i < 60; ++i) {
    now += 100ms;
    coordinator->tick();
  }
  EXPECT_TRUE(absl::IsUnavailable(worker.link->closed));
  auto again = join("w1", 0);
  EXPECT_TRUE(deliver(again, units[0], bytes_of(units[0])));
  pump();
  collect(again);
  EXPECT_EQ(count(again.acknowledgements, AckStatus::committed), 1);
  EXPECT_EQ(view(job).committed_unit_count, 1);
}

TEST_F(CoordinatorTest, InvalidBlocksAreRejectedWithReason) {
  create_job("a");
  auto worker = join("w1");
  const auto units = worker.units;
  Leased forged = units[0];
  forged.lease.tile_count += 1;
  EXPECT_FALSE(deliver(worker, forged, bytes_of(units[0]))) << "seal";
  EXPECT_FALSE(deliver(worker, units[1], bytes_of(units[1]) + "x")) << "size";
  BlockHeader header = header_of(units[2], bytes_of(units[2]));
  std::string damaged = bytes_of(units[2]);
  damaged[5] = static_cast<char>(damaged[5] ^ 1);
  const auto admission = coordinator->intake().admit("w1", header);
  ASSERT_TRUE(admission);
  coordinator->intake().deliver("w1", header, *admission, damaged);
  contract::FilmBlock poisoned = block_of(units[3], shape_of(units[3]));
  poisoned.alpha[0] = std::numeric_limits<float>::quiet_NaN();
  deliver(worker, units[3], contract::encode(poisoned));
  pump();
  collect(worker);
  ASSERT_EQ(count(worker.acknowledgements, AckStatus::rejected), 4);
  EXPECT_NE(worker.acknowledgements[0].reason.find("seal"), std::string::npos);
  EXPECT_NE(worker.acknowledgements[1].reason.find("size_bytes"), std::string::npos);
  EXPECT_NE(worker.acknowledgements[2].reason.find("sha256"), std::string::npos);
  EXPECT_NE(worker.acknowledgements[3].reason.find("finite"), std::string::npos);
  EXPECT_EQ(store.units().group_count(), 0);
}

TEST_F(CoordinatorTest, CancelledJobResultsAreObsolete) {
  const std::string job = create_job("a");
  auto worker = join("w1");
  const auto units = worker.units;
  deliver(worker, units[0], bytes_of(units[0]));
  pump();
  deliver(worker, units[1], bytes_of(units[1]));
  ASSERT_TRUE(change(job, JobAdmin::Change::cancel).ok());
  EXPECT_FALSE(deliver(worker, units[2], bytes_of(units[2])));
  pump();
  collect(worker);
  EXPECT_EQ(count(worker.acknowledgements, AckStatus::obsolete), 2)
      << "one before the restart, one after";
  EXPECT_EQ(worker.ended, std::vector<std::string>{job});
  ASSERT_TRUE(change(job, JobAdmin::Change::retry).ok());
  coordinator->workers().grant_credits(worker.session, 64);
  finish_job(worker, job);
  EXPECT_EQ(view(job).state, JobState::done);
  EXPECT_EQ(coordinator->queries().report(job)->contributions.at("w1").units, 6);
}

TEST_F(CoordinatorTest, FullStorePausesJobUntilResumed) {
  const std::string job = create_job("a");
  auto worker = join("w1");
  const auto units = worker.units;
  store.controls().fail_commits_with(absl::ResourceExhaustedError("no space left"));
  deliver(worker, units[0], bytes_of(units[0]));
  pump();
  EXPECT_EQ(view(job).state, JobState::paused);
  EXPECT_NE(view(job).reason.find("no space left"), std::string::npos);
  store.controls().fail_commits_with(absl::OkStatus());
  ASSERT_TRUE(change(job, JobAdmin::Change::resume).ok());
  for (const Leased& unit : units) deliver(worker, unit, bytes_of(unit));
  pump();
  EXPECT_EQ(view(job).state, JobState::done);
}

TEST_F(CoordinatorTest, RetryOfJobPausedByUserNamesResume) {
  const std::string job = create_job("a");
  join("w1");
  ASSERT_TRUE(change(job, JobAdmin::Change::pause).ok());
  const absl::Status status = change(job, JobAdmin::Change::retry).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(status));
  EXPECT_NE(status.message().find("`tessera resume " + job + "`"), std::string::npos) << status;
  EXPECT_EQ(view(job).state, JobState::paused);
  ASSERT_TRUE(change(job, JobAdmin::Change::resume).ok());
  EXPECT_TRUE(change(job, JobAdmin::Change::retry).ok()) << "it runs already";
}

TEST_F(CoordinatorTest, FullStoreAtFrameEndPausesJob) {
  const std::string job = create_job("a");
  auto worker = join("w1");
  deliver_all(worker);
  write_all();  // all units are committed, the image is not written
  store.controls().fail_commits_with(absl::ResourceExhaustedError("no space left"));
  store.controls().set_free_bytes(0);  // or it would resume by itself
  pump();
  EXPECT_EQ(view(job).state, JobState::paused);
  EXPECT_NE(view(job).reason.find("no space left"), std::string::npos);
  const auto journaled = [&] { return static_cast<JobState>(store.jobs().list()->front().state); };
  EXPECT_EQ(journaled(), JobState::running) << "the full disk cannot record the change";
  store.controls().fail_commits_with(absl::OkStatus());
  now += std::chrono::seconds(20);
  coordinator->tick();
  pump();
  EXPECT_EQ(journaled(), JobState::paused);
  ASSERT_TRUE(change(job, JobAdmin::Change::resume).ok());
  EXPECT_EQ(view(job).state, JobState::done);
  EXPECT_EQ(journaled(), JobState::done);
}

TEST_F(CoordinatorTest, BacklogStopsReading) {
  options.ingest_bytes = 1000;
  start();
  create_job("a");
  auto worker = join("w1");
  int resumed = 0;
  EXPECT_TRUE(coordinator->intake().has_room_or_call([&] { ++resumed; }));
  deliver(worker, worker.units[0], bytes_of(worker.units[0]));
  EXPECT_FALSE(coordinator->intake().has_room_or_call([&] { ++resumed; }));
  EXPECT_EQ(resumed, 0);
  store.controls().fail_commits_with(absl::UnavailableError("disk"));
  pump();
  EXPECT_EQ(resumed, 1) << "also when the commit fails: the block is sent again";
  store.controls().fail_commits_with(absl::OkStatus());
  deliver(worker, worker.units[0], bytes_of(worker.units[0]));
  EXPECT_FALSE(coordinator->intake().has_room_or_call([&] { ++resumed; }));
  pump();
  EXPECT_EQ(resumed, 2);
  EXPECT_TRUE(coordinator->intake().has_room_or_call([&] { ++resumed; }));
}

// Sessions ----------------------------------------------------------------------------------------

TEST_F(CoordinatorTest, NewStreamClosesOldOne) {
  create_job("a");
  auto old = join("w1");
  auto fresh = join("w1");
  EXPECT_TRUE(absl::IsAborted(old.link->closed));
  coordinator->workers().disconnect(
      old.session);  // the old stream's end must not touch the new one
  EXPECT_TRUE(coordinator->intake().check_delivery("w1").ok());
  coordinator->workers().grant_credits(old.session, 1000);
  EXPECT_TRUE(coordinator->workers().take_outbox(old.session).empty());
  coordinator->workers().disconnect(fresh.session);
  EXPECT_FALSE(coordinator->intake().check_delivery("w1").ok());
}

TEST_F(CoordinatorTest, NewMessageWakesConnection) {
  auto worker = join("w1");
  const int before = worker.link->wake_count;
  create_job("a");
  EXPECT_GT(worker.link->wake_count, before);
}

}  // namespace
}  // namespace tessera::server
