// Jobs: which are accepted, and what can be done with them.

#include <gtest/gtest.h>

#include <chrono>
#include <string>

#include "absl/strings/match.h"
#include "tests/unit/server/coordinator/coordinator_fixture.h"

namespace tessera::server {
namespace {

using JobsTest = CoordinatorFixture;

TEST_F(JobsTest, RepeatedRequestCreatesOneJob) {
  const std::string job = create_job("a");
  EXPECT_EQ(create_job("a"), job);
  start();
  EXPECT_EQ(create_job("a"), job);
  EXPECT_NE(create_job("b"), job);
}

TEST_F(JobsTest, JobNeedsAssetsAndDiskSpace) {
  JobSpec spec = spec_of("a");
  spec.assets = {{"scene.gltf", contract::sha256("scene"), 5}};
  const auto missing = create(spec);
  EXPECT_TRUE(absl::IsFailedPrecondition(missing.status()));
  EXPECT_NE(std::string(missing.status().message()).find("scene.gltf"), std::string::npos);
  ASSERT_TRUE(store.assets().add(spec.assets[0].digest, "scene").ok());
  store.controls().set_used_bytes(options.quota_bytes - 1000);
  EXPECT_TRUE(absl::IsResourceExhausted(create(spec).status()));
  store.controls().set_used_bytes(0);
  EXPECT_TRUE(create(spec).ok());
}

TEST_F(JobsTest, UnfinishedJobsPerOwnerAreLimited) {
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

TEST_F(JobsTest, RetryCountsJobsBeingCreated) {
  options.client_quotas.defaults.jobs = 2;
  start();
  const std::string one = create_job("one");
  create_job("two");
  ASSERT_TRUE(change(one, JobAdmin::Change::cancel).ok());
  coordinator->admission().create_job(spec_of("three"), [](const auto& /*created*/) {});
  ASSERT_TRUE(coordinator->run_writer(false)) << "written and not answered";
  EXPECT_TRUE(absl::IsResourceExhausted(change(one, JobAdmin::Change::retry).status()));
}

TEST_F(JobsTest, SamplesPerOwnerAreLimited) {
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

TEST_F(JobsTest, StoredBytesPerOwnerAreLimited) {
  options.client_quotas.defaults.gb =
      static_cast<double>(max_job_size(spec_of("one")).store_bytes) / 1e9;
  start();
  create_job("one");
  EXPECT_TRUE(absl::IsResourceExhausted(create(spec_of("two")).status()));
}

TEST_F(JobsTest, FindsJobsByIdPrefixNameAndLast) {
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

TEST_F(JobsTest, ListsNewestFirstInPages) {
  for (const char* name : {"a", "b", "c"}) create_job(name);
  const auto first = coordinator->queries().list_jobs(0, 2);
  ASSERT_EQ(first.jobs.size(), 2u);
  EXPECT_EQ(first.jobs[0].spec->name, "c");
  EXPECT_EQ(first.before, first.jobs.back().key);
  const auto second = coordinator->queries().list_jobs(first.before, 2);
  ASSERT_EQ(second.jobs.size(), 1u);
  EXPECT_EQ(second.jobs[0].spec->name, "a");
  EXPECT_EQ(second.before, 0) << "the last page";
}

TEST_F(JobsTest, FilteredPageVisitsLimitedNumberOfJobs) {
  JobSpec rare = spec_of("rare");
  rare.project = "film";
  ASSERT_TRUE(create(rare).ok());
  for (int i = 0; i < FarmQueries::kMaxVisitedJobs; ++i) create_job("job" + std::to_string(i));
  const JobFilter filter{.projects = {"film"}};
  const JobPage first = coordinator->queries().list_jobs(0, 10, filter);
  EXPECT_TRUE(first.jobs.empty());
  ASSERT_NE(first.before, 0) << "not the last page";
  const JobPage second = coordinator->queries().list_jobs(first.before, 10, filter);
  ASSERT_EQ(second.jobs.size(), 1u);
  EXPECT_EQ(second.jobs[0].spec->name, "rare");
  EXPECT_EQ(second.before, 0);
}

TEST_F(JobsTest, JobWithoutWorkersHasNoRemainingTime) {
  const std::string job = create_job("a");
  TestWorker worker = join("w", 2);
  now += std::chrono::seconds(1);
  deliver_all(worker);
  pump();
  ASSERT_EQ(view(job).reason, "");
  EXPECT_TRUE(view(job).remaining_seconds.has_value());
  for (int i = 0; i < 60; ++i) {  // until the worker is lost
    now += std::chrono::milliseconds(100);
    coordinator->tick();
  }
  EXPECT_EQ(view(job).reason, "no workers connected");
  EXPECT_FALSE(view(job).remaining_seconds.has_value());
}

TEST_F(JobsTest, OnlyEndedJobsCanBeRemoved) {
  const std::string job = create_job("a");
  EXPECT_TRUE(absl::IsFailedPrecondition(remove(job)));
  ASSERT_TRUE(change(job, JobAdmin::Change::cancel).ok());
  EXPECT_TRUE(remove(job).ok());
  EXPECT_TRUE(absl::IsNotFound(coordinator->queries().job(job).status()));
  EXPECT_TRUE(store.jobs().list()->empty());
}

TEST_F(JobsTest, ExtendedJobMatchesLongerJob) {
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

TEST_F(JobsTest, ExtensionByErrorDoesNotGuideExistingJob) {
  const std::string job = create_job("fixed", 32);
  coordinator->jobs().extend_job(job, {{}, 0.1}, [](const auto& /*view*/) {});
  pump();
  const contract::RenderSettings& settings = coordinator->queries().job(job)->spec->settings;
  EXPECT_EQ(settings.error, 0.1);
  EXPECT_FALSE(settings.is_guided()) << "the samples of pass 0 are not, and loaded frames are not";
}

/// Gives the store's jobs an older render contract, as after an upgrade.
void age_jobs(MemoryStore& store) {
  const std::vector<JobRecord> jobs = store.jobs().list().value();
  for (JobRecord record : jobs) {
    record.render_contract = contract::kRenderContract - 1;
    ASSERT_TRUE(store.jobs().update(record).ok());
  }
}

TEST_F(JobsTest, ContractChangeStopsStartedJob) {
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

TEST_F(JobsTest, UnstartedJobAdoptsNewContract) {
  const std::string job = create_job("a");
  age_jobs(store);
  start();
  pump();
  EXPECT_EQ(view(job).state, JobState::queued);
  EXPECT_EQ(store.jobs().list()->front().render_contract, contract::kRenderContract)
      << "recorded at once";
  auto worker = join("w1");
  finish_job(worker, job);
  EXPECT_EQ(view(job).state, JobState::done);
}

TEST_F(JobsTest, PartialFrameListsMissingTiles) {
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
