#include "server/state/job_index.h"

#include <gtest/gtest.h>

#include <chrono>
#include <set>
#include <string>
#include <vector>

namespace tessera::server {
namespace {

JobSpec job(const std::string& id, const std::string& name, const std::string& owner) {
  JobSpec spec;
  spec.id = id;
  spec.name = name;
  spec.owner = owner;
  spec.request_id = "request-" + id;
  return spec;
}

TEST(JobIndex, FindsJobsOfAllAndOfOneOwner) {
  JobIndex index;
  index.add(1, job("aa1", "chair", "ann"));
  index.add(2, job("aa2", "chair", "bob"));
  index.add(3, job("ab3", "table", "ann"));
  EXPECT_EQ(index.with_id("aa2"), 2);
  EXPECT_EQ(index.with_id("aa"), 0);
  EXPECT_EQ(index.of_request("request-ab3"), 3);
  EXPECT_EQ(index.with_prefix("a", "", 9), (std::vector<JobKey>{3, 2, 1}));
  EXPECT_EQ(index.with_prefix("a", "ann", 9), (std::vector<JobKey>{3, 1}));
  EXPECT_EQ(index.with_prefix("aa", "bob", 9), (std::vector<JobKey>{2}));
  EXPECT_EQ(index.with_prefix("a", "ann", 1), (std::vector<JobKey>{1}));
  EXPECT_TRUE(index.with_prefix("a", "eve", 9).empty());
  EXPECT_EQ(index.newest_named("chair", ""), 2);
  EXPECT_EQ(index.newest_named("chair", "ann"), 1);
  EXPECT_EQ(index.newest_named("table", "bob"), 0);
  EXPECT_EQ(index.of_owner("ann"), (std::set<JobKey>{1, 3}));
  EXPECT_EQ(index.owners(), (std::vector<std::string>{"ann", "bob"}));
}

TEST(JobIndex, RemovedJobLeavesNothing) {
  JobIndex index;
  index.add(1, job("aa1", "chair", "ann"));
  index.add(2, job("aa2", "chair", "bob"));
  index.remove(2, job("aa2", "chair", "bob"));
  EXPECT_EQ(index.with_id("aa2"), 0);
  EXPECT_EQ(index.of_request("request-aa2"), 0);
  EXPECT_EQ(index.with_prefix("a", "", 9), (std::vector<JobKey>{1}));
  EXPECT_EQ(index.newest_named("chair", ""), 1);
  EXPECT_EQ(index.newest_named("chair", "bob"), 0);
  EXPECT_TRUE(index.of_owner("bob").empty());
  EXPECT_EQ(index.owners(), std::vector<std::string>{"ann"});
}

/// 20,000 lookups take milliseconds; visiting the jobs of the other owner takes half a minute.
TEST(JobIndex, JobsOfOthersCostNothing) {
  JobIndex index;
  for (JobKey key = 1; key <= 100'000; ++key) {
    index.add(key, job("a" + std::to_string(key), "shot", "bob"));
  }
  index.add(100'001, job("b1", "shot", "ann"));
  index.add(100'002, job("b2", "shot", "bob"));
  const auto start = std::chrono::steady_clock::now();
  for (int i = 0; i < 10'000; ++i) {
    ASSERT_EQ(index.newest_named("shot", "ann"), 100'001);
    ASSERT_TRUE(index.with_prefix("a", "ann", 9).empty());
  }
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(5));
}

}  // namespace
}  // namespace tessera::server
