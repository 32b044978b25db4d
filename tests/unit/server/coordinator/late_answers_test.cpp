// The writer begins its next round before the answers of the one before it have been given.
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/unit/server/coordinator/coordinator_fixture.h"

namespace tessera::server {
namespace {

class LateAnswers : public CoordinatorFixture {
 protected:
  /// Writes what is pending; the answers wait.
  void write_only() { EXPECT_TRUE(coordinator->run_writer(false)); }

  std::vector<AckStatus> acknowledgements(TestWorker& worker) {
    pump();
    collect(worker);
    std::vector<AckStatus> found;
    for (const Acknowledgement& each : worker.acknowledgements) found.push_back(each.status);
    return found;
  }
};

TEST_F(LateAnswers, UnitInCommitIsNotCommittedAgain) {
  const std::string job = create_job("a");
  auto worker = join("w1", 1);
  ASSERT_EQ(worker.units.size(), 1u);
  const Leased unit = worker.units.front();
  EXPECT_TRUE(deliver(worker, unit, bytes_of(unit)));
  write_only();
  EXPECT_TRUE(deliver(worker, unit, bytes_of(unit)));
  write_only();
  EXPECT_EQ(acknowledgements(worker),
            (std::vector<AckStatus>{AckStatus::committed, AckStatus::duplicate}));
  EXPECT_EQ(view(job).committed_unit_count, 1);
  EXPECT_EQ(coordinator->queries().report(job)->counters.duplicated, 1);
}

TEST_F(LateAnswers, CopyOfUnwrittenUnitIsNotAcknowledged) {
  const std::string job = create_job("a");
  auto worker = join("w1", 1);
  const Leased unit = worker.units.front();
  store.controls().fail_commits_with(absl::InternalError("broken disk"));
  deliver(worker, unit, bytes_of(unit));
  write_only();
  deliver(worker, unit, bytes_of(unit));
  write_only();
  EXPECT_TRUE(acknowledgements(worker).empty());
  store.controls().fail_commits_with(absl::OkStatus());
  deliver(worker, unit, bytes_of(unit));
  EXPECT_EQ(acknowledgements(worker), std::vector<AckStatus>{AckStatus::committed});
}

TEST_F(LateAnswers, QuotaCountsJobsWithoutAnswer) {
  options.client_quotas.defaults.jobs = 1;
  start();
  std::vector<std::string> created;
  int refused = 0;
  for (const char* name : {"a", "b", "a"}) {
    coordinator->admission().create_job(remember(spec_of(name)), [&](const auto& job) {
      if (job.ok()) created.push_back(job->view.spec->id);
      refused += absl::IsResourceExhausted(job.status()) ? 1 : 0;
    });
    write_only();
  }
  pump();
  ASSERT_EQ(created.size(), 2u);
  EXPECT_EQ(created[0], created[1]) << "the same request is the same job";
  EXPECT_EQ(refused, 1);
}

TEST_F(LateAnswers, EventIsVisibleAfterItsAnswer) {
  bool has_answer = false;
  coordinator->admission().create_job(remember(spec_of("a")),
                                      [&](const auto& job) { has_answer = job.ok(); });
  write_only();
  EXPECT_FALSE(has_answer);
  EXPECT_TRUE(coordinator->farm().events().read({}, 9).empty());
  EXPECT_TRUE(coordinator->run_answers(false));
  EXPECT_TRUE(has_answer);
  EXPECT_EQ(coordinator->farm().events().read({}, 9).size(), 1u);
}

TEST_F(LateAnswers, ReaderWhoHasAnswerFindsItsEvent) {
  std::vector<std::size_t> found;  // events that a reader finds
  const auto read = [&] {
    coordinator->queries().after_answers(
        [&] { found.push_back(coordinator->farm().events().read({}, 9).size()); });
  };
  read();
  EXPECT_EQ(found, std::vector<std::size_t>{0}) << "at once: there are no answers to wait for";
  coordinator->admission().create_job(remember(spec_of("a")), [&](const auto&) { read(); });
  write_only();
  EXPECT_EQ(found.size(), 1u);
  pump();
  EXPECT_EQ(found, (std::vector<std::size_t>{0, 1}));
}

TEST_F(LateAnswers, EventsKeepTheirOrder) {
  for (const char* name : {"a", "b", "c"}) {
    coordinator->admission().create_job(remember(spec_of(name)), [](const auto&) {});
    write_only();
  }
  pump();
  std::int64_t last = 0;
  for (const Event& event : coordinator->farm().events().read({}, 9)) {
    EXPECT_GT(event.sequence, last);
    last = event.sequence;
  }
  EXPECT_EQ(coordinator->farm().events().read({}, 9).size(), store.events().newest(9)->size());
}

TEST_F(LateAnswers, TaskBetweenTransactionsFollowsAnswers) {
  const std::string job = create_job("a");
  auto worker = join("w1");
  deliver_all(worker);
  bool is_removed = false;
  coordinator->jobs().remove_job(job, [&](const absl::Status& status) {
    is_removed = true;
    EXPECT_TRUE(absl::IsFailedPrecondition(status)) << status;  // it has not ended
  });
  write_only();
  EXPECT_TRUE(is_removed);
  EXPECT_EQ(view(job).committed_unit_count, 6) << "the blocks before it have been answered";
}

}  // namespace
}  // namespace tessera::server
