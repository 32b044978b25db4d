#include "server/schedule/plan/lease.h"

#include <gtest/gtest.h>

#include <functional>
#include <vector>

namespace tessera::server {
namespace {

constexpr char kKey[] = "a key of the store, 32 bytes long";

Lease sealed() {
  Lease lease{"job1", 3, 1, 10, 5, 8, 56, {2, 99}, {}};
  lease.seal = make_seal(lease, "w1", kKey);
  return lease;
}

TEST(Lease, SealIsBoundToWorkerAndStore) {
  EXPECT_TRUE(is_seal_valid(sealed(), "w1", kKey));
  EXPECT_FALSE(is_seal_valid(sealed(), "w2", kKey));
  EXPECT_FALSE(is_seal_valid(sealed(), "w1", "another store's key"));
}

TEST(Lease, SealCoversEveryField) {
  const std::vector<std::function<void(Lease&)>> forgeries = {
      [](Lease& l) { l.job_id = "job2"; },
      [](Lease& l) { ++l.frame; },
      [](Lease& l) { ++l.pass; },
      [](Lease& l) { --l.first_tile; },
      [](Lease& l) { ++l.tile_count; },
      [](Lease& l) { ++l.first_sample; },
      [](Lease& l) { ++l.sample_count; },
      [](Lease& l) { ++l.attempt.boot; },
      [](Lease& l) { ++l.attempt.counter; },
      [](Lease& l) { l.seal.clear(); },
      [](Lease& l) { l.seal.back() = static_cast<char>(l.seal.back() ^ 1); }};
  for (std::size_t i = 0; i < forgeries.size(); ++i) {
    Lease lease = sealed();
    forgeries[i](lease);
    EXPECT_FALSE(is_seal_valid(lease, "w1", kKey)) << "forgery " << i;
  }
}

TEST(Lease, SealSeparatesFields) {
  Lease lease = sealed();
  lease.job_id = "job1w";  // "job1" + "w1" and "job1w" + "1" are the same letters
  EXPECT_FALSE(is_seal_valid(lease, "1", kKey));
}

TEST(Lease, CoversOnlyItsTiles) {
  const Lease lease = sealed();
  EXPECT_TRUE(lease.covers({3, 10, 1}));
  EXPECT_TRUE(lease.covers({3, 14, 1}));
  EXPECT_FALSE(lease.covers({3, 15, 1}));
  EXPECT_FALSE(lease.covers({3, 9, 1}));
  EXPECT_FALSE(lease.covers({3, 10, 0}));
  EXPECT_FALSE(lease.covers({2, 10, 1}));
}

}  // namespace
}  // namespace tessera::server
