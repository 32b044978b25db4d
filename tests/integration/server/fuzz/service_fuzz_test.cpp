// Random calls. TESSERA_SEEDS=COUNT runs so many seeds, TESSERA_FIRST_SEED=N others.
#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>

#include "absl/base/config.h"
#include "tests/integration/server/fuzz/service_fuzzer.h"

namespace tessera::server {
namespace {

#ifdef ABSL_HAVE_ADDRESS_SANITIZER
constexpr int kSeeds = 40;
#else
constexpr int kSeeds = 100;
#endif
constexpr int kSteps = 60;

int from_environment(const char* name, int otherwise) {
  const char* text = std::getenv(name);
  return text == nullptr ? otherwise : std::atoi(text);
}

TEST(ServiceFuzz, AnswersFollowTheModelForAllSeeds) {
  const int first = from_environment("TESSERA_FIRST_SEED", 1);
  const int count = from_environment("TESSERA_SEEDS", kSeeds);
  ServiceFuzzer::Counts sum;
  constexpr int ServiceFuzzer::Counts::*kCounts[] = {
      &ServiceFuzzer::Counts::jobs,    &ServiceFuzzer::Counts::orders,
      &ServiceFuzzer::Counts::looks,   &ServiceFuzzer::Counts::raw,
      &ServiceFuzzer::Counts::refused, &ServiceFuzzer::Counts::raw_accepted,
      &ServiceFuzzer::Counts::workers, &ServiceFuzzer::Counts::restarts};
  for (int seed = first; seed < first + count; ++seed) {
    ServiceFuzzer fuzzer(static_cast<std::uint64_t>(seed));
    ASSERT_EQ(fuzzer.run(kSteps), "") << "seed " << seed;
    for (const auto field : kCounts) sum.*field += fuzzer.counts().*field;
  }
  std::printf(
      "seeds %d to %d: %d jobs, %d orders, %d looks, %d random calls (%d accepted), %d refusals, "
      "%d workers, %d restarts\n",
      first, first + count - 1, sum.jobs, sum.orders, sum.looks, sum.raw, sum.raw_accepted,
      sum.refused, sum.workers, sum.restarts);
  if (count < kSeeds) return;
  for (const auto field : kCounts) EXPECT_GT(sum.*field, 0) << "every kind of step takes place";
}

}  // namespace
}  // namespace tessera::server
