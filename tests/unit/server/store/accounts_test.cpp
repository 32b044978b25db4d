// Accounts of committed units.
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "tests/unit/server/store/store_fixture.h"

namespace tessera::server {
namespace {

class AccountsTest : public StoreFixture {
 protected:
  AccountsTest() { uses_rows_ = true; }

  JobRecord add(const std::string& id, const std::string& owner, const std::string& project = "") {
    JobRecord job;
    job.id = job.name = id;
    job.owner = owner;
    job.project = project;
    job.create_time_us = 7 * kHourUs;
    EXPECT_TRUE(store().jobs().add(job).ok());
    return job;
  }
  std::vector<UsageSum> read(const UsageQuery& query, std::size_t limit = 100) {
    const auto sums = store().usage().read(query, limit);
    EXPECT_TRUE(sums.ok()) << sums.status();
    return sums.value_or(std::vector<UsageSum>{});
  }
  /// Units charged to a job.
  std::int64_t units_of(const std::string& id) {
    for (const UsageSum& sum : read({.by_job = true})) {
      if (sum.job_id == id) return sum.units;
    }
    return 0;
  }
  double all_seconds() {
    double sum = 0;
    for (const UsageSum& each : read({})) sum += each.cpu_seconds;
    return sum;
  }
};

TEST_F(AccountsTest, GroupsAndFilters) {
  add("a", "ann", "film");
  add("b", "ben", "film");
  add("c", "ann");
  commit("a", 0, 4);  // each unit takes 0.25 s
  commit("b", 0, 2);
  commit("c", 0, 1);
  EXPECT_EQ(all_seconds(), 1.75);
  const auto owners = read({.by_owner = true});
  ASSERT_EQ(owners.size(), 2u);
  EXPECT_EQ(owners[0].owner, "ann");
  EXPECT_EQ(owners[0].units, 5);
  EXPECT_EQ(owners[0].cpu_seconds, 1.25);
  EXPECT_EQ(owners[1].owner, "ben");
  const auto both = read({.by_owner = true, .by_project = true});
  ASSERT_EQ(both.size(), 3u);
  EXPECT_EQ(both[0].project, "");
  EXPECT_EQ(both[1].project, "film");
  const auto jobs = read({.by_job = true, .owner = "ann"});
  ASSERT_EQ(jobs.size(), 2u);
  EXPECT_EQ(jobs[0].job_id, "a");
  EXPECT_EQ(jobs[0].job_name, "a");
  EXPECT_EQ(read({.project = ""}).at(0).units, 1);
  EXPECT_EQ(read({.project = "film"}).at(0).units, 6);
  EXPECT_EQ(*store().usage().cpu_seconds({.owner = "ann", .project = "film"}), 1.0);
}

TEST_F(AccountsTest, PagesGoOnAfterAGroup) {
  for (const char* id : {"a", "b", "c"}) {
    add(id, "ann");
    commit(id, 0, 1);
  }
  UsageQuery query{.by_owner = true, .by_job = true};
  std::string seen;
  for (auto page = read(query, 1); !page.empty(); page = read(query, 1)) {
    seen += page[0].job_id;
    query.after = page[0];
  }
  EXPECT_EQ(seen, "abc");
}

TEST_F(AccountsTest, HoursAreThoseOfTheCommit) {
  add("a", "ann");
  commit("a", 0, 1);  // hour 100
  now_us_ += 2 * kHourUs;
  commit("a", 1, 2);
  EXPECT_EQ(read({.first_hour = 101}).at(0).units, 2);
  EXPECT_EQ(read({.first_hour = 100, .end_hour = 102}).at(0).units, 1);
  EXPECT_TRUE(read({.first_hour = 103}).empty());
}

TEST_F(AccountsTest, SecondCommitOfAUnitChargesNothing) {
  add("a", "ann");
  commit("a", 0, 3);
  std::vector<Commit> again{make_commit("a", {0, 9, 0}, "x"), make_commit("a", {0, 1, 0}, "x")};
  EXPECT_TRUE(absl::IsAlreadyExists(store().units().commit(again)));
  EXPECT_EQ(units_of("a"), 3);
  EXPECT_EQ(all_seconds(), 0.75);
  open();
  EXPECT_EQ(units_of("a"), 3);
}

TEST_F(AccountsTest, FailedTransactionChargesNothing) {
  add("a", "ann");
  std::vector<Commit> group{make_commit("a", {0, 0, 0}, "x")};
  const absl::Status status = store().write_together([&] {
    EXPECT_TRUE(store().units().commit(group).ok());
    store().units().commit(group).IgnoreError();  // undone, with its charge
  });
  ASSERT_TRUE(status.ok()) << status;
  EXPECT_EQ(units_of("a"), 1);
}

TEST_F(AccountsTest, DroppedUnitsAreChargedOnceAgain) {
  add("a", "ann");
  commit("a", 0, 3);
  now_us_ += kHourUs;
  ASSERT_TRUE(store().units().drop("a", {{0, 1, 0}, {7, 7, 7}}).ok());
  EXPECT_EQ(units_of("a"), 2);
  std::vector<Commit> group{make_commit("a", {0, 1, 0}, "x")};
  ASSERT_TRUE(store().units().commit(group).ok());
  EXPECT_EQ(units_of("a"), 3);
  EXPECT_EQ(all_seconds(), 0.75);
  EXPECT_EQ(read({.first_hour = 101}).at(0).units, 1);
  ASSERT_TRUE(store().units().drop("a", {{0, 0, 0}, {0, 1, 0}, {0, 2, 0}}).ok());
  EXPECT_TRUE(read({}).empty()) << "no row is left with a rounding error";
}

TEST_F(AccountsTest, DoneAndRemovedJobsStayInTheAccounts) {
  JobRecord job = add("a", "ann", "film");
  commit("a", 0, 2);
  finish_frame("a", 0, "image");
  ASSERT_TRUE(store().units().close_job("a").ok());
  EXPECT_EQ(units_of("a"), 2);
  ASSERT_TRUE(store().jobs().remove("a").ok());
  open();
  const auto sums = read({.by_owner = true, .by_project = true, .by_job = true});
  ASSERT_EQ(sums.size(), 1u);
  EXPECT_EQ(sums[0].owner, "ann");
  EXPECT_EQ(sums[0].project, "film");
  EXPECT_EQ(sums[0].job_name, "a");
  EXPECT_EQ(sums[0].units, 2);
}

TEST_F(AccountsTest, UsageOfJobsRemovedLongAgoHasNoJob) {
  max_removed_jobs_ = 2;
  open();
  for (const std::string id : {"a", "b", "c", "d", "e"}) {
    add(id, id == "b" ? "ben" : "ann", "film");
    commit(id, 0, 1);
  }
  now_us_ += kHourUs;
  commit("a", 1, 2);
  for (const std::string id : {"d", "a", "c", "b"}) {
    ASSERT_TRUE(store().jobs().remove(id).ok());
    open();  // the number of removed jobs is read again
  }
  const auto jobs = read({.by_owner = true, .by_project = true, .by_job = true});
  std::string seen;
  for (const UsageSum& sum : jobs) {
    seen += absl::StrCat(sum.owner, "/", sum.project, "/", sum.job_id, ":", sum.units, " ");
  }
  EXPECT_EQ(seen, "ann/film/:3 ann/film/c:1 ann/film/d:1 ann/film/e:1 ben/film/:1 ");
  EXPECT_EQ(read({.first_hour = 101}).at(0).units, 2) << "hours are kept";
  EXPECT_EQ(all_seconds(), 7 * 0.25);
  EXPECT_EQ(*store().usage().cpu_seconds({.owner = "ann", .project = "film"}), 6 * 0.25);
  EXPECT_EQ(*store().jobs().removed_state("a"), 0) << "has no row";
  EXPECT_EQ(store().jobs().removed_state("e")->has_value(), false) << "is not removed";
  expect_consistent();
}

}  // namespace
}  // namespace tessera::server
