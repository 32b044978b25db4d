// Simulated servers. TESSERA_SEEDS=COUNT runs so many instead of 500 (or of 50 with
// AddressSanitizer, which takes several times as long), TESSERA_FIRST_SEED=N others. Several tests
// share the seeds, so that ctest runs them side by side.
#include <gtest/gtest.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>

#include "absl/base/config.h"
#include "tests/unit/server/simulation/simulated_server.h"

namespace tessera::server {
namespace {

constexpr int kParts = 10;
#ifdef ABSL_HAVE_ADDRESS_SANITIZER
constexpr int kSeeds = 50;
#else
constexpr int kSeeds = 500;
#endif

int from_environment(const char* name, int otherwise) {
  const char* text = std::getenv(name);
  return text == nullptr ? otherwise : std::atoi(text);
}

class ServerSimulation : public ::testing::TestWithParam<int> {};

INSTANTIATE_TEST_SUITE_P(Seeds, ServerSimulation, ::testing::Range(0, kParts));

TEST_P(ServerSimulation, InvariantsHoldForAllSeeds) {
  const int all = from_environment("TESSERA_SEEDS", kSeeds);
  const int begin = all * GetParam() / kParts;
  const int first = from_environment("TESSERA_FIRST_SEED", 1) + begin;
  const int count = all * (GetParam() + 1) / kParts - begin;
  SimulatedServer::Events sum;
  constexpr int SimulatedServer::Events::*kCounts[] = {
      &SimulatedServer::Events::crashes,        &SimulatedServer::Events::power_cuts,
      &SimulatedServer::Events::full_disks,     &SimulatedServer::Events::refused_writes,
      &SimulatedServer::Events::worker_crashes, &SimulatedServer::Events::broken_streams,
      &SimulatedServer::Events::lost_messages,  &SimulatedServer::Events::overtaken_messages,
      &SimulatedServer::Events::late_hellos,    &SimulatedServer::Events::repeated_blocks,
      &SimulatedServer::Events::full_ingests,   &SimulatedServer::Events::abandoned_requests,
      &SimulatedServer::Events::lost_answers,   &SimulatedServer::Events::pauses,
      &SimulatedServer::Events::cancels,        &SimulatedServer::Events::retries,
      &SimulatedServer::Events::extensions,     &SimulatedServer::Events::removals,
      &SimulatedServer::Events::commits,        &SimulatedServer::Events::wrong_blocks,
      &SimulatedServer::Events::quarantines,    &SimulatedServer::Events::leases,
      &SimulatedServer::Events::overdue_leases, &SimulatedServer::Events::share_windows};
  for (int seed = first; seed < first + count; ++seed) {
    SimulatedServer server(static_cast<std::uint64_t>(seed));
    ASSERT_EQ(server.run(), "") << "seed " << seed;
    for (const auto field : kCounts) sum.*field += server.events().*field;
    sum.doubted_frames += server.events().doubted_frames;
  }
  std::printf(
      "seeds %d to %d: %d crashes, %d power cuts, %d times full, %d refused writes, "
      "%d worker crashes, %d broken streams, %d lost and %d overtaken messages, %d late Hellos, "
      "%d repeated blocks, %d times no room for blocks, %d abandoned requests, %d lost answers, "
      "%d pauses, %d cancels, %d retries, %d extensions, %d removals, %d commits, "
      "%d wrong blocks, %d quarantines, %d doubted frames, %d leases, %d of overdue owners, "
      "%d share windows\n",
      first, first + count - 1, sum.crashes, sum.power_cuts, sum.full_disks, sum.refused_writes,
      sum.worker_crashes, sum.broken_streams, sum.lost_messages, sum.overtaken_messages,
      sum.late_hellos, sum.repeated_blocks, sum.full_ingests, sum.abandoned_requests,
      sum.lost_answers, sum.pauses, sum.cancels, sum.retries, sum.extensions, sum.removals,
      sum.commits, sum.wrong_blocks, sum.quarantines, sum.doubted_frames, sum.leases,
      sum.overdue_leases, sum.share_windows);
  EXPECT_LE(sum.doubted_frames, 1 + sum.quarantines / 20) << "nearly all frames are audited";
  if (count < 50) return;
  for (const auto field : kCounts) EXPECT_GT(sum.*field, 0) << "every kind of fault takes place";
}

/// Each of these found a fault of the server or of the simulation.
TEST(ServerSimulationTest, FormerFailuresPass) {
  for (const std::uint64_t seed : {502'797, 504'193, 511'551, 512'356, 515'679}) {
    EXPECT_EQ(SimulatedServer(seed).run(), "") << "seed " << seed;
  }
}

}  // namespace
}  // namespace tessera::server
