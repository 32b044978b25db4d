// Simulated farms. TESSERA_SEEDS=COUNT runs so many instead of 500 (or of 100 with
// AddressSanitizer, which takes 15 times as long), TESSERA_FIRST_SEED others. Two tests share the
// seeds, so that ctest runs them side by side.
#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <string>

#include "absl/base/config.h"
#include "tests/unit/server/schedule/simulation/simulated_farm.h"

namespace tessera::server {
namespace {

int from_environment(const char* name, int otherwise) {
  const char* text = std::getenv(name);
  return text == nullptr ? otherwise : std::atoi(text);
}

constexpr int kShares = 2;
#ifdef ABSL_HAVE_ADDRESS_SANITIZER
constexpr int kSeeds = 100;
#else
constexpr int kSeeds = 500;
#endif

class Simulation : public testing::TestWithParam<int> {};

INSTANTIATE_TEST_SUITE_P(Seeds, Simulation, testing::Range(0, kShares));

TEST_P(Simulation, InvariantsHoldForAllSeeds) {
  const int all = from_environment("TESSERA_SEEDS", kSeeds);
  const int begin = all * GetParam() / kShares;
  const int first = from_environment("TESSERA_FIRST_SEED", 1) + begin;
  const int count = all * (GetParam() + 1) / kShares - begin;
  SimulatedFarm::Events sum;
  for (int seed = first; seed < first + count; ++seed) {
    SimulatedFarm farm(static_cast<std::uint64_t>(seed));
    const std::string violation = farm.run();
    EXPECT_EQ(violation, "") << "seed " << seed;
    if (HasFailure()) break;
    const SimulatedFarm::Events& events = farm.events();
    sum.commits += events.commits;
    sum.duplicates += events.duplicates;
    sum.audits += events.audits;
    sum.restarts += events.restarts;
    sum.crashes += events.crashes;
    sum.failures += events.failures;
    sum.lies += events.lies;
    sum.redone += events.redone;
    sum.quarantines += events.quarantines;
    sum.late_ticks += events.late_ticks;
    sum.lost_writes += events.lost_writes;
    sum.removals += events.removals;
    sum.impossible += events.impossible;
    sum.moves += events.moves;
    sum.full_limits += events.full_limits;
    sum.asides += events.asides;
    sum.blocks += events.blocks;
    sum.stops += events.stops;
  }
  std::printf(
      "seeds %d to %d: %d commits, %d duplicates, %d audits, %d restarts, %d crashes, %d failures, "
      "%d wrong results, %d redone, %d quarantined, %d late ticks, %d lost writes, %d removed, "
      "%d never possible, %d moved, %d steps at a limit, %d set aside, %d blocked, %d stopped\n",
      first, first + count - 1, sum.commits, sum.duplicates, sum.audits, sum.restarts, sum.crashes,
      sum.failures, sum.lies, sum.redone, sum.quarantines, sum.late_ticks, sum.lost_writes,
      sum.removals, sum.impossible, sum.moves, sum.full_limits, sum.asides, sum.blocks, sum.stops);
  if (count < 100) return;
  for (const int happened :
       {sum.duplicates, sum.audits, sum.restarts, sum.crashes, sum.failures, sum.lies, sum.redone,
        sum.quarantines, sum.late_ticks, sum.removals, sum.impossible, sum.moves, sum.full_limits,
        sum.asides, sum.blocks, sum.stops}) {
    EXPECT_GT(happened, 0) << "every kind of fault takes place";
  }
}

TEST(SimulatedFarm, SameSeedGivesSameRun) {
  SimulatedFarm one(7), other(7);
  EXPECT_EQ(one.run(), other.run());
  EXPECT_EQ(one.events().commits, other.events().commits);
  EXPECT_EQ(one.events().duplicates, other.events().duplicates);
}

}  // namespace
}  // namespace tessera::server
