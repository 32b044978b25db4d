#include "server/schedule/plan/audit.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "tests/unit/server/schedule/scheduler_harness.h"

namespace tessera::server {
namespace {

using contract::Unit;

const contract::Digest other_lie = contract::sha256("other");

using Names = std::vector<std::string>;

TEST(Audit, AgreementOfTwoSettles) {
  Audit audit("a", truth);
  EXPECT_FALSE(audit.is_settled());
  EXPECT_FALSE(audit.may_ask("a", true)) << "a worker cannot confirm its own result";
  EXPECT_FALSE(audit.may_ask("a", false));
  EXPECT_TRUE(audit.may_ask("b", true));
  audit.answer("b", truth);
  EXPECT_TRUE(audit.is_settled());
  EXPECT_EQ(audit.faulty_workers(), Names());
}

TEST(Audit, ThirdResultDecidesDispute) {
  for (const bool committer_is_wrong : {false, true}) {
    Audit audit("a", committer_is_wrong ? wrong : truth);
    audit.answer("b", committer_is_wrong ? truth : wrong);
    EXPECT_TRUE(audit.is_disputed());
    EXPECT_FALSE(audit.is_settled());
    EXPECT_FALSE(audit.may_ask("a", true)) << "while there are others";
    audit.answer("c", truth);
    EXPECT_TRUE(audit.is_settled());
    EXPECT_EQ(audit.faulty_workers(), Names{committer_is_wrong ? "a" : "b"});
  }
}

TEST(Audit, ThreeDifferentResultsNeedFourth) {
  Audit audit("a", truth);
  audit.answer("b", wrong);
  audit.answer("c", other_lie);
  EXPECT_FALSE(audit.is_settled());
  audit.answer("d", truth);
  EXPECT_TRUE(audit.is_settled());
  EXPECT_EQ(audit.faulty_workers(), (Names{"b", "c"}));
}

TEST(Audit, SelfContradictionDecidesBetweenTwo) {
  Audit audit("a", truth);
  audit.answer("b", wrong);
  EXPECT_TRUE(audit.may_ask("a", false));
  audit.answer("a", truth);
  EXPECT_FALSE(audit.may_ask("a", false)) << "once";
  EXPECT_FALSE(audit.is_settled());
  audit.answer("b", truth);
  EXPECT_TRUE(audit.is_settled());
  EXPECT_EQ(audit.faulty_workers(), Names{"b"});
}

TEST(Audit, TwoConsistentWorkersStayDisputed) {
  Audit audit("a", truth);
  audit.answer("b", wrong);
  audit.answer("a", truth);
  audit.answer("b", wrong);
  EXPECT_FALSE(audit.is_settled());
  EXPECT_FALSE(audit.may_ask("a", false));
  EXPECT_FALSE(audit.may_ask("b", false));
}

TEST(Audit, SelfContradictingResultDoesNotCount) {
  Audit audit("a", truth);
  audit.answer("b", wrong);
  audit.answer("c", other_lie);
  audit.answer("a", other_lie);
  audit.answer("d", truth);
  EXPECT_FALSE(audit.is_settled()) << "a has given this result only once";
  audit.answer("e", truth);
  EXPECT_TRUE(audit.is_settled());
  EXPECT_EQ(audit.faulty_workers(), (Names{"a", "b", "c"}));
}

TEST(Audit, FaultyWorkersResultsAreWithdrawn) {
  Audit audit("a", truth);
  audit.answer("b", wrong);
  audit.disregard("b");
  EXPECT_FALSE(audit.is_disputed());
  EXPECT_FALSE(audit.is_settled());
}

/// A worker with n wrong units is found with probability 1 - (1 - f)^n: over many farms (keys), the
/// rate must be within four standard deviations of the binomial distribution.
TEST(Audit, DetectionRateMatchesAuditShare) {
  constexpr int kFarms = 2000;
  constexpr double kFraction = 0.01;
  for (const int units : {10, 100, 300}) {
    int found = 0;
    for (int farm = 0; farm < kFarms; ++farm) {
      const std::string key = "key of farm " + std::to_string(farm);
      bool drawn = false;
      for (int tile = 0; tile < units; ++tile) {
        drawn = drawn || is_drawn_for_audit(key, "job", {0, tile, 0}, kFraction);
      }
      found += drawn ? 1 : 0;
    }
    const double expected = 1 - std::pow(1 - kFraction, units);
    const double deviation = std::sqrt(expected * (1 - expected) / kFarms);
    EXPECT_NEAR(static_cast<double>(found) / kFarms, expected, 4 * deviation) << units << " units";
  }
}

TEST(Audit, DrawDependsOnlyOnKeyJobAndUnit) {
  int differing_keys = 0, differing_jobs = 0, differing_passes = 0;
  for (int tile = 0; tile < 1000; ++tile) {
    const bool drawn = is_drawn_for_audit("key", "job", {0, tile, 0}, 0.5);
    EXPECT_EQ(drawn, is_drawn_for_audit("key", "job", {0, tile, 0}, 0.5));
    differing_keys += drawn != is_drawn_for_audit("other", "job", {0, tile, 0}, 0.5);
    differing_jobs += drawn != is_drawn_for_audit("key", "jab", {0, tile, 0}, 0.5);
    differing_passes += drawn != is_drawn_for_audit("key", "job", {0, tile, 1}, 0.5);
    EXPECT_TRUE(is_drawn_for_audit("key", "job", {0, tile, 0}, 1));
    EXPECT_FALSE(is_drawn_for_audit("key", "job", {0, tile, 0}, 0));
  }
  for (const int differing : {differing_keys, differing_jobs, differing_passes}) {
    EXPECT_NEAR(differing, 500, 4 * std::sqrt(250.0));
  }
}

}  // namespace
}  // namespace tessera::server
