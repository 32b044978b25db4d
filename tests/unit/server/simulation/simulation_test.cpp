// Simulated servers. TESSERA_SEEDS=COUNT runs so many, TESSERA_FIRST_SEED=N others.
#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>

#include "absl/base/config.h"
#include "tests/unit/server/simulation/simulated_server.h"

namespace tessera::server {
namespace {

#ifdef ABSL_HAVE_ADDRESS_SANITIZER
constexpr int kSeeds = 20;
#else
constexpr int kSeeds = 100;
#endif

int from_environment(const char* name, int otherwise) {
  const char* text = std::getenv(name);
  return text == nullptr ? otherwise : std::atoi(text);
}

TEST(ServerSimulation, InvariantsHoldForAllSeeds) {
  const int first = from_environment("TESSERA_FIRST_SEED", 1);
  const int count = from_environment("TESSERA_SEEDS", kSeeds);
  SimulatedServer::Events sum;
  constexpr int SimulatedServer::Events::*kCounts[] = {
      &SimulatedServer::Events::crashes,        &SimulatedServer::Events::power_cuts,
      &SimulatedServer::Events::full_disks,     &SimulatedServer::Events::refused_writes,
      &SimulatedServer::Events::worker_crashes, &SimulatedServer::Events::broken_streams,
      &SimulatedServer::Events::lost_blocks,    &SimulatedServer::Events::repeated_blocks,
      &SimulatedServer::Events::lost_answers,   &SimulatedServer::Events::pauses,
      &SimulatedServer::Events::cancels,        &SimulatedServer::Events::retries,
      &SimulatedServer::Events::extensions,     &SimulatedServer::Events::removals,
      &SimulatedServer::Events::commits,        &SimulatedServer::Events::wrong_blocks,
      &SimulatedServer::Events::quarantines};
  for (int seed = first; seed < first + count; ++seed) {
    SimulatedServer server(static_cast<std::uint64_t>(seed));
    ASSERT_EQ(server.run(), "") << "seed " << seed;
    for (const auto field : kCounts) sum.*field += server.events().*field;
    sum.doubted_frames += server.events().doubted_frames;
  }
  std::printf(
      "seeds %d to %d: %d crashes, %d power cuts, %d times full, %d refused writes, "
      "%d worker crashes, %d broken streams, %d lost and %d repeated blocks, %d lost answers, "
      "%d pauses, %d cancels, %d retries, %d extensions, %d removals, %d commits, "
      "%d wrong blocks, %d quarantines, %d doubted frames\n",
      first, first + count - 1, sum.crashes, sum.power_cuts, sum.full_disks, sum.refused_writes,
      sum.worker_crashes, sum.broken_streams, sum.lost_blocks, sum.repeated_blocks,
      sum.lost_answers, sum.pauses, sum.cancels, sum.retries, sum.extensions, sum.removals,
      sum.commits, sum.wrong_blocks, sum.quarantines, sum.doubted_frames);
  EXPECT_LE(sum.doubted_frames, 1 + sum.quarantines / 20) << "nearly all frames are audited";
  if (count < kSeeds) return;
  for (const auto field : kCounts) EXPECT_GT(sum.*field, 0) << "every kind of fault takes place";
}

}  // namespace
}  // namespace tessera::server
