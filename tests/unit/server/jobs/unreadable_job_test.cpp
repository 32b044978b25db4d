// A job whose row or units cannot be read does not keep the server from starting; users see it and
// can remove it.
#include <chrono>
#include <string>
#include <vector>

#include "tests/unit/server/coordinator/coordinator_fixture.h"

namespace tessera::server {
namespace {

class UnreadableJob : public CoordinatorFixture {
 protected:
  /// Restarts a server that cannot read the row of this job.
  void start_without(const std::string& lost) {
    coordinator.reset();
    FarmOptions broken = options;
    broken.read_spec = [read = options.read_spec,
                        lost](const JobRecord& record) -> absl::StatusOr<JobSpec> {
      if (record.id == lost) return absl::DataLossError("cannot parse its request");
      return read(record);
    };
    broken.log = [&](LogLevel level, const std::string& line) {
      if (level == LogLevel::error) errors_.push_back(line);
    };
    auto opened = Coordinator::open(store, broken);
    ASSERT_TRUE(opened.ok()) << opened.status();
    coordinator = *std::move(opened);
    pump();
  }
  /// Returns the job's row; one without ID if there is none.
  JobRecord row(const std::string& job) {
    const auto rows = store.jobs().list();
    for (const JobRecord& record : *rows) {
      if (record.id == job) return record;
    }
    return {};
  }
  absl::Status update_priority(const std::string& job) {
    JobAdmin::Update update;
    update.priority = 7;
    absl::Status result = absl::UnknownError("no answer");
    coordinator->jobs().update_job(job, update,
                                   [&](const auto& changed) { result = changed.status(); });
    pump();
    return result;
  }
  absl::Status extend(const std::string& job) {
    JobAdmin::Extension extension;
    extension.spp = 512;
    absl::Status result = absl::UnknownError("no answer");
    coordinator->jobs().extend_job(job, extension,
                                   [&](const auto& changed) { result = changed.status(); });
    pump();
    return result;
  }

  std::vector<std::string> errors_;
};

TEST_F(UnreadableJob, IsListedAsFailedWithItsCause) {
  const std::string lost = create_job("lost"), kept = create_job("kept");
  start_without(lost);
  EXPECT_EQ(view(kept).state, JobState::queued);
  const JobView found = view(lost);
  EXPECT_EQ(found.state, JobState::failed);
  EXPECT_EQ(found.failure_code, absl::StatusCode::kDataLoss);
  EXPECT_EQ(found.spec->name, "lost");
  EXPECT_EQ(found.spec->owner, "ann");
  EXPECT_NE(found.reason.find("cannot parse its request"), std::string::npos) << found.reason;
  EXPECT_EQ(coordinator->queries().list_jobs(0, 10, {.visible_owner = "ann"}).jobs.size(), 2u);
  ASSERT_EQ(errors_.size(), 1u);
  EXPECT_NE(errors_[0].find(lost), std::string::npos) << errors_[0];
}

TEST_F(UnreadableJob, RowStaysAsItIs) {
  const std::string lost = create_job("lost");
  start_without(lost);
  for (const auto what : {JobAdmin::Change::retry, JobAdmin::Change::resume,
                          JobAdmin::Change::pause, JobAdmin::Change::cancel}) {
    EXPECT_TRUE(absl::IsFailedPrecondition(change(lost, what).status()));
  }
  EXPECT_TRUE(absl::IsFailedPrecondition(update_priority(lost)));
  EXPECT_TRUE(absl::IsFailedPrecondition(extend(lost)));
  EXPECT_EQ(row(lost).request, "request-lost");
  EXPECT_EQ(row(lost).state, static_cast<std::int32_t>(JobState::queued));
  start();
  EXPECT_EQ(view(lost).state, JobState::queued) << "by a server that can read it";
}

TEST_F(UnreadableJob, SameRequestFindsIt) {
  const std::string lost = create_job("lost");
  start_without(lost);
  const auto again = create(spec_of("lost"));
  ASSERT_TRUE(again.ok()) << again.status();
  EXPECT_EQ(again->view.spec->id, lost);
}

TEST_F(UnreadableJob, CanBeRemoved) {
  const std::string lost = create_job("lost");
  start_without(lost);
  EXPECT_TRUE(remove(lost).ok());
  EXPECT_TRUE(absl::IsNotFound(coordinator->queries().job(lost).status()));
  EXPECT_EQ(row(lost).id, "");
}

TEST_F(UnreadableJob, IsNotRemovedByAge) {
  options.job_retention_us = 1;
  const std::string lost = create_job("lost");
  ASSERT_TRUE(change(lost, JobAdmin::Change::cancel).ok());
  start_without(lost);
  now += std::chrono::hours(1);
  coordinator->tick();
  pump();
  EXPECT_EQ(view(lost).state, JobState::failed);
}

TEST_F(UnreadableJob, DependentWaitsUntilItIsRemoved) {
  const std::string lost = create_job("lost");
  for (const auto kind : {Dependency::Kind::success, Dependency::Kind::end}) {
    JobSpec spec = spec_of(kind == Dependency::Kind::end ? "any" : "after");
    spec.after = {{lost, kind}};
    ASSERT_TRUE(create(spec).ok());
  }
  start_without(lost);
  const auto named = [&](const std::string& name) {
    return coordinator->queries().find_job(name).value();
  };
  for (const char* name : {"after", "any"}) {
    EXPECT_EQ(named(name).reason, "waits for job " + lost + ", which the server cannot read");
  }
  ASSERT_TRUE(remove(lost).ok());
  EXPECT_EQ(named("after").state, JobState::failed);
  EXPECT_EQ(named("any").state, JobState::queued);
}

TEST_F(UnreadableJob, UnitsThatCannotBeReadFailIt) {
  const std::string lost = create_job("lost", 64);
  auto worker = join("w1", 2);
  deliver_all(worker);
  pump();
  ASSERT_EQ(view(lost).state, JobState::running);
  const JobRecord before = row(lost);
  store.units().fail_reads_of(lost, absl::DataLossError("a unit without digest"));
  start();
  pump();
  EXPECT_EQ(view(lost).state, JobState::failed);
  EXPECT_NE(view(lost).reason.find("a unit without digest"), std::string::npos);
  EXPECT_EQ(view(lost).leased_unit_count, 0);
  EXPECT_EQ(row(lost).state, before.state);
  EXPECT_EQ(row(lost).request, before.request);
  EXPECT_EQ(row(lost).end_time_us, 0);
  auto again = join("w1");
  EXPECT_TRUE(again.units.empty());
  EXPECT_TRUE(remove(lost).ok());
}

}  // namespace
}  // namespace tessera::server
