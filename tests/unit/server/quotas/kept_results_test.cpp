#include "server/state/kept_results.h"

#include <gtest/gtest.h>

namespace tessera::server {
namespace {

TEST(KeptResults, SumsByOwner) {
  KeptResults kept;
  kept.set(1, "ann", 100);
  kept.set(2, "ann", 20);
  kept.set(3, "bob", 3);
  EXPECT_EQ(kept.of_owner("ann"), 120);
  EXPECT_EQ(kept.of_owner("bob"), 3);
  EXPECT_EQ(kept.of_owner("carl"), 0);
  EXPECT_EQ(kept.of_job(2), 20);
}

TEST(KeptResults, NewAmountReplacesOld) {
  KeptResults kept;
  kept.set(1, "ann", 100);
  kept.set(1, "ann", 40);
  EXPECT_EQ(kept.of_owner("ann"), 40);
  kept.set(1, "ann", 0);
  EXPECT_EQ(kept.of_owner("ann"), 0);
  EXPECT_EQ(kept.of_job(1), 0);
  kept.remove(1);
  EXPECT_EQ(kept.of_owner("ann"), 0);
}

}  // namespace
}  // namespace tessera::server
