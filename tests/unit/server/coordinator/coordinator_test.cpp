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
  const auto frames = store.frames(job);
  ASSERT_EQ(frames->size(), 1u);
  EXPECT_TRUE(std::filesystem::exists(*store.output_folder(job) + "/" + frames->front().file));
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
  store.fail_commits_with(absl::UnavailableError("disk"));
  pump();
  collect(worker);
  EXPECT_TRUE(worker.acknowledgements.empty()) << "no acknowledgement: the worker sends again";
}

TEST_F(CoordinatorTest, PendingBlocksFormOneJournalGroup) {
  create_job("a");
  auto worker = join("w1");
  deliver_all(worker);
  pump();
  EXPECT_EQ(store.group_count(), 1);
}

TEST_F(CoordinatorTest, PixelsAreDeliveryIndependent) {
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
  EXPECT_EQ(store.group_count(), 0);
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
  store.fail_commits_with(absl::ResourceExhaustedError("no space left"));
  deliver(worker, units[0], bytes_of(units[0]));
  pump();
  EXPECT_EQ(view(job).state, JobState::paused);
  EXPECT_NE(view(job).reason.find("no space left"), std::string::npos);
  store.fail_commits_with(absl::OkStatus());
  ASSERT_TRUE(change(job, JobAdmin::Change::resume).ok());
  for (const Leased& unit : units) deliver(worker, unit, bytes_of(unit));
  pump();
  EXPECT_EQ(view(job).state, JobState::done);
}

TEST_F(CoordinatorTest, FullStoreAtFrameEndPausesJob) {
  const std::string job = create_job("a");
  auto worker = join("w1");
  deliver_all(worker);
  while (coordinator->run_writer(false)) {  // all units are committed, the image is not written
  }
  store.fail_commits_with(absl::ResourceExhaustedError("no space left"));
  store.set_free_bytes(0);  // or it would resume by itself
  pump();
  EXPECT_EQ(view(job).state, JobState::paused);
  EXPECT_NE(view(job).reason.find("no space left"), std::string::npos);
  const auto journaled = [&] { return static_cast<JobState>(store.jobs()->front().state); };
  EXPECT_EQ(journaled(), JobState::running) << "the full disk cannot record the change";
  store.fail_commits_with(absl::OkStatus());
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
  store.fail_commits_with(absl::UnavailableError("disk"));
  pump();
  EXPECT_EQ(resumed, 1) << "also when the commit fails: the block is sent again";
  store.fail_commits_with(absl::OkStatus());
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

// Restarts ----------------------------------------------------------------------------------------

TEST_F(CoordinatorTest, RestartContinuesFromCommittedUnits) {
  const std::string whole = create_job("whole", 64);
  auto first = join("w1");
  finish_job(first, whole);

  const std::string job = create_job("cut", 64);
  collect(first);
  std::vector<contract::Unit> acknowledged;
  for (std::size_t i = 0; i < 5; ++i) {
    deliver(first, first.units[2 * i], bytes_of(first.units[2 * i]));
    acknowledged.push_back(first.units[2 * i].name.unit);
  }
  pump();
  start();  // the process was killed
  EXPECT_EQ(view(job).committed_unit_count, 5);
  EXPECT_EQ(view(job).state, JobState::running);
  auto worker = join("w1", 64);
  for (const Leased& unit : worker.units) {
    EXPECT_EQ(std::count(acknowledged.begin(), acknowledged.end(), unit.name.unit), 0)
        << "an acknowledged unit is leased again";
    EXPECT_EQ(unit.lease.attempt.boot, store.boot_count());
  }
  finish_job(worker, job);
  EXPECT_EQ(view(job).state, JobState::done);
  EXPECT_EQ(pixels_of(job), pixels_of(whole));
  EXPECT_DOUBLE_EQ(view(job).cpu_seconds, 6) << "exact over crashes";
  EXPECT_EQ(coordinator->queries().report(whole)->contributions.at("w1").units, 12);
}

TEST_F(CoordinatorTest, LeasesSurviveRestart) {
  const std::string job = create_job("a");
  auto worker = join("w1");
  const auto units = worker.units;
  start();
  auto again = join("w1", 0);
  for (const Leased& unit : units) EXPECT_TRUE(deliver(again, unit, bytes_of(unit)));
  pump();
  EXPECT_EQ(view(job).state, JobState::done);
}

TEST_F(CoordinatorTest, RestartWritesCompleteFrame) {
  const std::string job = create_job("a");
  auto worker = join("w1");
  deliver_all(worker);
  while (coordinator->run_writer(false)) {
  }
  start();  // before the film thread has run
  EXPECT_EQ(view(job).state, JobState::running);
  pump();
  EXPECT_EQ(view(job).state, JobState::done);
}

TEST_F(CoordinatorTest, DamagedBlockIsRenderedAgain) {
  const std::string whole = create_job("whole");
  auto worker = join("w1");
  finish_job(worker, whole);
  const std::string job = create_job("a");
  deliver_all(worker);
  while (coordinator->run_writer(false)) {
  }
  store.damage({0, 4, 0});
  start();  // merged tiles are lost, blocks are read again
  pump();
  EXPECT_EQ(view(job).state, JobState::running);
  auto again = join("w1");
  ASSERT_EQ(again.units.size(), 1u);
  EXPECT_EQ(again.units[0].name.unit, (contract::Unit{0, 4, 0}));
  finish_job(again, job);
  EXPECT_EQ(view(job).state, JobState::done);
  EXPECT_EQ(view(job).committed_sample_count, view(whole).committed_sample_count);
  EXPECT_EQ(pixels_of(job), pixels_of(whole));
  EXPECT_EQ(coordinator->queries().report(job)->counters.redone, 1);
}

TEST_F(CoordinatorTest, GrantsWaitForKnownWorkersAfterRestart) {
  create_job("a");
  join("w1");
  join("w2");
  pump();  // the known workers are journaled
  start();
  auto worker = join("w1");
  EXPECT_TRUE(worker.units.empty());
  join("w2");
  collect(worker);
  EXPECT_FALSE(worker.units.empty());
}

// Jobs --------------------------------------------------------------------------------------------

TEST_F(CoordinatorTest, RepeatedRequestCreatesOneJob) {
  const std::string job = create_job("a");
  EXPECT_EQ(create_job("a"), job);
  start();
  EXPECT_EQ(create_job("a"), job);
  EXPECT_NE(create_job("b"), job);
}

TEST_F(CoordinatorTest, JobNeedsAssetsAndDiskSpace) {
  JobSpec spec = spec_of("a");
  spec.assets = {{"scene.gltf", contract::sha256("scene"), 5}};
  const auto missing = create(spec);
  EXPECT_TRUE(absl::IsFailedPrecondition(missing.status()));
  EXPECT_NE(std::string(missing.status().message()).find("scene.gltf"), std::string::npos);
  ASSERT_TRUE(store.assets().add(spec.assets[0].digest, "scene").ok());
  store.set_used_bytes(options.quota_bytes - 1000);
  EXPECT_TRUE(absl::IsResourceExhausted(create(spec).status()));
  store.set_used_bytes(0);
  EXPECT_TRUE(create(spec).ok());
}

TEST_F(CoordinatorTest, UnfinishedJobsPerOwnerAreLimited) {
  options.client_quotas.defaults.jobs = 2;
  start();
  const std::string one = create_job("one");
  create_job("two");
  EXPECT_TRUE(absl::IsResourceExhausted(create(spec_of("three")).status()));
  JobSpec bobs = spec_of("bobs");
  bobs.owner = "bob";
  EXPECT_TRUE(create(bobs).ok()) << "other owners are counted separately";
  EXPECT_TRUE(create(spec_of("two")).ok()) << "the same request is the same job";
  ASSERT_TRUE(change(one, JobAdmin::Change::cancel).ok());
  EXPECT_TRUE(create(spec_of("three")).ok());
  EXPECT_TRUE(absl::IsResourceExhausted(change(one, JobAdmin::Change::retry).status()));
}

TEST_F(CoordinatorTest, SamplesPerOwnerAreLimited) {
  options.client_quotas.defaults.gigasamples = 2.0 * 20 * 12 * 8 / 1e9;
  start();
  const std::string one = create_job("one", 8);
  EXPECT_TRUE(absl::IsResourceExhausted(create(spec_of("more", 12)).status()));
  create_job("two", 8);
  JobAdmin::Extension extension;
  extension.spp = 12;
  absl::StatusOr<JobView> extended = absl::UnknownError("no answer");
  coordinator->jobs().extend_job(one, extension, [&](const auto& view) { extended = view; });
  pump();
  EXPECT_TRUE(absl::IsResourceExhausted(extended.status()));
}

TEST_F(CoordinatorTest, StoredBytesPerOwnerAreLimited) {
  options.client_quotas.defaults.gb =
      static_cast<double>(max_job_size(spec_of("one")).store_bytes) / 1e9;
  start();
  create_job("one");
  EXPECT_TRUE(absl::IsResourceExhausted(create(spec_of("two")).status()));
}

TEST_F(CoordinatorTest, FindsJobsByIdPrefixNameAndLast) {
  const std::string one = create_job("one");
  const std::string two = create_job("two");
  EXPECT_EQ(coordinator->queries().find_job(one)->spec->id, one);
  EXPECT_EQ(coordinator->queries().find_job("two")->spec->id, two);
  EXPECT_EQ(coordinator->queries().find_job("last")->spec->id, two);
  std::size_t different = 0;
  while (one[different] == two[different]) ++different;
  EXPECT_EQ(coordinator->queries().find_job(one.substr(0, different + 1))->spec->id, one);
  EXPECT_TRUE(absl::IsNotFound(coordinator->queries().find_job("nothing").status()));
  EXPECT_TRUE(absl::IsNotFound(coordinator->queries().find_job("").status()));
}

TEST_F(CoordinatorTest, ListsNewestFirstInPages) {
  for (const char* name : {"a", "b", "c"}) create_job(name);
  const auto first = coordinator->queries().list_jobs(0, 2);
  ASSERT_EQ(first.size(), 2u);
  EXPECT_EQ(first[0].spec->name, "c");
  const auto second = coordinator->queries().list_jobs(first.back().key, 2);
  ASSERT_EQ(second.size(), 1u);
  EXPECT_EQ(second[0].spec->name, "a");
}

TEST_F(CoordinatorTest, OnlyEndedJobsCanBeRemoved) {
  const std::string job = create_job("a");
  absl::Status status;
  coordinator->jobs().remove_job(job, [&](const absl::Status& s) { status = s; });
  pump();
  EXPECT_TRUE(absl::IsFailedPrecondition(status));
  ASSERT_TRUE(change(job, JobAdmin::Change::cancel).ok());
  coordinator->jobs().remove_job(job, [&](const absl::Status& s) { status = s; });
  pump();
  EXPECT_TRUE(status.ok());
  EXPECT_TRUE(absl::IsNotFound(coordinator->queries().job(job).status()));
  EXPECT_TRUE(store.jobs()->empty());
}

TEST_F(CoordinatorTest, ExtendedJobMatchesLongerJob) {
  const std::string longer = create_job("longer", 64);
  auto worker = join("w1");
  finish_job(worker, longer);

  const std::string job = create_job("short", 32);  // passes 8, 24; longer: 8, 56
  collect(worker);
  for (const Leased& unit : worker.units) {
    if (unit.name.unit.tile != 3) deliver(worker, unit, bytes_of(unit));
  }
  worker.units.clear();
  pump();
  absl::StatusOr<JobView> extended = absl::UnknownError("");
  coordinator->jobs().extend_job(job, {64, {}}, [&](const auto& view) { extended = view; });
  pump();
  ASSERT_TRUE(extended.ok()) << extended.status();
  EXPECT_EQ(extended->committed_unit_count, 5) << "pass 0 is the same in both";
  coordinator->workers().grant_credits(worker.session, 64);
  // The units of pass 0 that it still holds stay with it; the worker seems to have died.
  coordinator->workers().disconnect(worker.session);
  auto again = join("w1");
  finish_job(again, job);
  EXPECT_EQ(view(job).state, JobState::done);
  EXPECT_EQ(pixels_of(job), pixels_of(longer));
}

/// Gives the store's jobs an older render contract, as after an upgrade.
void age_jobs(MemoryStore& store) {
  const std::vector<JobRecord> jobs = store.jobs().value();
  for (JobRecord record : jobs) {
    record.render_contract = contract::kRenderContract - 1;
    ASSERT_TRUE(store.update_job(record).ok());
  }
}

TEST_F(CoordinatorTest, ContractChangeStopsStartedJob) {
  const std::string done = create_job("done"), begun = create_job("begun");
  auto worker = join("w1", 8);  // of 12 units
  deliver_all(worker);
  pump();
  ASSERT_EQ(view(done).state, JobState::done);
  ASSERT_EQ(view(begun).committed_unit_count, 2);
  const std::string pixels = pixels_of(done);
  const double cpu_seconds = view(done).cpu_seconds, spent = view(begun).cpu_seconds;
  for (int restart = 0; restart < 2; ++restart) {
    if (restart == 0) age_jobs(store);
    start();
    pump();
    EXPECT_EQ(view(done).state, JobState::done);
    EXPECT_EQ(pixels_of(done), pixels);
    EXPECT_EQ(view(done).cpu_seconds, cpu_seconds);
    EXPECT_EQ(view(done).spec->render_contract, contract::kRenderContract - 1);
    EXPECT_EQ(view(begun).state, JobState::failed);
    EXPECT_TRUE(absl::StrContains(view(begun).reason, "submit the job again"))
        << view(begun).reason;
    EXPECT_EQ(view(begun).committed_unit_count, 0) << "its blocks are read by other passes now";
    EXPECT_DOUBLE_EQ(view(begun).cpu_seconds, spent);
  }
  EXPECT_TRUE(absl::IsFailedPrecondition(change(begun, JobAdmin::Change::retry).status()));
  absl::StatusOr<JobView> extended = absl::UnknownError("");
  coordinator->jobs().extend_job(begun, {64, {}}, [&](const auto& view) { extended = view; });
  pump();
  EXPECT_TRUE(absl::IsFailedPrecondition(extended.status())) << extended.status();
}

TEST_F(CoordinatorTest, UnstartedJobAdoptsNewContract) {
  const std::string job = create_job("a");
  age_jobs(store);
  start();
  pump();
  EXPECT_EQ(view(job).state, JobState::queued);
  EXPECT_EQ(store.jobs()->front().render_contract, contract::kRenderContract) << "recorded at once";
  auto worker = join("w1");
  finish_job(worker, job);
  EXPECT_EQ(view(job).state, JobState::done);
}

TEST_F(CoordinatorTest, PartialFrameListsMissingTiles) {
  const std::string job = create_job("a");
  auto worker = join("w1");
  const auto fetch = [&](bool allow_partial) {
    absl::StatusOr<FrameFile> result = absl::UnknownError("no answer");
    coordinator->images().fetch_frame({job, 0, FrameFormat::exr, 0, allow_partial},
                                      [&](const auto& file) { result = file; });
    pump();
    return result;
  };
  EXPECT_TRUE(absl::IsFailedPrecondition(fetch(true).status())) << "nothing is committed";
  const auto units = worker.units;
  deliver(worker, units[0], bytes_of(units[0]));
  deliver(worker, units[4], bytes_of(units[4]));
  pump();
  EXPECT_TRUE(absl::IsFailedPrecondition(fetch(false).status()));
  const auto partial = fetch(true);
  ASSERT_TRUE(partial.ok()) << partial.status();
  EXPECT_EQ(partial->missing_tiles.size(), 4u);
  EXPECT_FALSE(partial->pixels_sha256);
  EXPECT_TRUE(partial->is_temporary);
  finish_job(worker, job);
  for (const Leased& unit : units) deliver(worker, unit, bytes_of(unit));
  pump();
  const auto whole = fetch(false);
  ASSERT_TRUE(whole.ok());
  EXPECT_TRUE(whole->missing_tiles.empty());
  EXPECT_TRUE(whole->pixels_sha256);
}

}  // namespace
}  // namespace tessera::server
