#include "worker/agent/units/unit_queue.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cstdint>
#include <deque>
#include <string>
#include <vector>

namespace tessera::agent {
namespace {

using std::chrono::seconds;

constexpr std::int32_t kFrame = 7, kPass = 2;

v1::Lease lease(std::int32_t first_tile, std::int32_t tile_count, std::int64_t counter = 1,
                const std::string& job = "job") {
  v1::Lease made;
  made.set_job_id(job);
  made.set_frame(kFrame);
  made.set_pass(kPass);
  made.set_first_tile(first_tile);
  made.set_tile_count(tile_count);
  made.set_attempt_counter(counter);
  made.set_seal("seal " + std::to_string(counter));
  return made;
}

UnitKey unit(std::int32_t tile, const std::string& job = "job") {
  return {job, {kFrame, tile, kPass}};
}

void render(UnitQueue& queue, std::int32_t tile, const std::string& block = "block") {
  queue.start(unit(tile));
  ASSERT_TRUE(queue.finish(unit(tile), block, contract::sha256(block), 0.5));
}

TEST(UnitQueue, LeasedUnitsWaitInCurveOrder) {
  UnitQueue queue;
  queue.add_lease(lease(3, 2));
  queue.add_lease(lease(0, 1, 2));
  EXPECT_EQ(queue.waiting(), (std::deque<UnitKey>{unit(3), unit(4), unit(0)}));
  EXPECT_EQ(queue.lease_of(unit(4))->seal(), "seal 1");
  EXPECT_EQ(queue.lease_of(unit(5)), nullptr);
}

TEST(UnitQueue, StartedUnitsFollowEveryChange) {
  using Keys = std::vector<UnitKey>;
  UnitQueue queue;
  queue.set_store("store");
  queue.add_lease(lease(0, 4));
  queue.add_lease(lease(0, 1, 2, "other"));
  for (const std::int32_t tile : {2, 0, 1}) queue.start(unit(tile));
  queue.start(unit(0, "other"));
  EXPECT_EQ(queue.started(), (Keys{unit(0), unit(1), unit(2), unit(0, "other")}));
  queue.requeue(unit(1));
  EXPECT_EQ(queue.started(), (Keys{unit(0), unit(2), unit(0, "other")}));
  queue.finish(unit(0), "block", contract::sha256("block"), 0.5);
  EXPECT_EQ(queue.started(), (Keys{unit(2), unit(0, "other")}));
  queue.fail(unit(2), "broke", "", absl::StatusCode::kInternal);
  EXPECT_EQ(queue.started(), Keys{unit(0, "other")});
  queue.drop_job("other");
  EXPECT_EQ(queue.started(), Keys{});
  queue.start(unit(1));
  queue.set_store("another store");
  EXPECT_EQ(queue.started(), Keys{});
}

TEST(UnitQueue, KeepsBlockUntilAcknowledged) {
  UnitQueue queue;
  queue.add_lease(lease(0, 1));
  render(queue, 0, "pixels");
  const auto block = queue.next_block(Time());
  ASSERT_TRUE(block.has_value());
  EXPECT_EQ(*block->bytes, "pixels");
  EXPECT_EQ(block->lease->seal(), "seal 1");
  EXPECT_EQ(block->cpu_seconds, 0.5);
  EXPECT_FALSE(queue.next_block(Time()).has_value());
  queue.reset_offers();  // a new stream
  EXPECT_TRUE(queue.next_block(Time()).has_value());
  EXPECT_TRUE(queue.acknowledge(unit(0)));
  EXPECT_FALSE(queue.acknowledge(unit(0)));
  queue.reset_offers();
  EXPECT_FALSE(queue.next_block(Time()).has_value());
  EXPECT_TRUE(queue.empty());
}

TEST(UnitQueue, AcknowledgementKeepsBytesBeingSent) {
  UnitQueue queue;
  queue.add_lease(lease(0, 1));
  render(queue, 0, "pixels");
  const auto block = queue.next_block(Time());
  queue.drop_job("job");
  EXPECT_EQ(*block->bytes, "pixels");
}

TEST(UnitQueue, OnlyWaitingUnitsAreReturned) {
  UnitQueue queue;
  queue.add_lease(lease(0, 3));
  queue.start(unit(0));
  render(queue, 1);
  EXPECT_EQ(queue.revoke({unit(0), unit(1), unit(2), unit(9)}), std::vector<UnitKey>{unit(2)});
  EXPECT_EQ(queue.size(), 2);
  EXPECT_TRUE(queue.waiting().empty());
}

TEST(UnitQueue, ReturnedUnitIsNextInLine) {
  UnitQueue queue;
  queue.add_lease(lease(0, 3));
  queue.start(unit(1));
  queue.requeue(unit(1));
  EXPECT_EQ(queue.waiting().front(), unit(1));
  EXPECT_FALSE(queue.finish(unit(1), "late", {}, 0)) << "a dead renderer's block was accepted";
  render(queue, 1);
}

TEST(UnitQueue, FailureCarriesLeaseAndRemovesUnit) {
  UnitQueue queue;
  queue.add_lease(lease(0, 2));
  queue.start(unit(1));
  const auto failure = queue.fail(unit(1), "why", "log", absl::StatusCode::kNotFound);
  ASSERT_TRUE(failure.has_value());
  EXPECT_EQ(failure->lease().seal(), "seal 1");
  EXPECT_EQ(failure->tile(), 1);
  EXPECT_EQ(failure->message(), "why");
  EXPECT_EQ(failure->log_tail(), "log");
  EXPECT_EQ(failure->code(), 5) << "NOT_FOUND";
  EXPECT_FALSE(queue.fail(unit(1), "why", "log", absl::StatusCode::kNotFound).has_value());
  EXPECT_EQ(queue.size(), 1);
}

TEST(UnitQueue, FinishedUnitCannotFail) {
  UnitQueue queue;
  queue.add_lease(lease(0, 1));
  render(queue, 0);
  EXPECT_FALSE(queue.fail(unit(0), "too late", "", absl::StatusCode::kInternal).has_value());
  EXPECT_TRUE(queue.next_block(Time()).has_value());
}

TEST(UnitQueue, HelloListsStartedAndHeldUnits) {
  UnitQueue queue;
  queue.set_store("store");
  queue.add_lease(lease(0, 3, 1));
  queue.add_lease(lease(8, 2, 2));
  queue.start(unit(0));
  render(queue, 1);
  v1::WorkerHello hello;
  queue.fill_hello(hello, {5, 5});
  ASSERT_EQ(hello.running_size(), 1);
  EXPECT_EQ(key_of(hello.running(0)), unit(0));
  ASSERT_EQ(hello.unacknowledged_size(), 1);
  EXPECT_EQ(key_of(hello.unacknowledged(0)), unit(1));
  ASSERT_EQ(hello.leases_size(), 1) << "a lease of units that only wait is not adopted";
  EXPECT_EQ(hello.leases(0).seal(), "seal 1");
  EXPECT_EQ(hello.store_id(), "store");
  EXPECT_EQ(hello.credit_count(), 3);
  EXPECT_TRUE(queue.waiting().empty()) << "the server leases these anew";
}

TEST(UnitQueue, OtherStoreDiscardsEverything) {
  UnitQueue queue;
  queue.set_store("one");
  queue.add_lease(lease(0, 3));
  queue.start(unit(0));
  render(queue, 1);
  queue.set_store("one");
  EXPECT_EQ(queue.size(), 3);
  queue.set_store("two");
  EXPECT_TRUE(queue.empty());
  EXPECT_FALSE(queue.next_block(Time()).has_value());
  EXPECT_FALSE(queue.finish(unit(0), "block", {}, 0));
}

TEST(UnitQueue, LeasedPlusGrantedStaysWithinWindow) {
  UnitQueue queue;
  const CreditWindow four{4, 4};
  EXPECT_EQ(queue.credits_to_grant(four), 4);
  EXPECT_EQ(queue.credits_to_grant(four), 0);
  queue.add_lease(lease(0, 3));
  EXPECT_EQ(queue.credits_to_grant(four), 0) << "three leased, one still granted";
  render(queue, 0);
  EXPECT_EQ(queue.credits_to_grant(four), 0) << "an unacknowledged block still counts";
  queue.acknowledge(unit(0));
  EXPECT_EQ(queue.credits_to_grant(four), 1);
  queue.revoke({unit(1)});
  EXPECT_EQ(queue.credits_to_grant(four), 1);
  EXPECT_EQ(queue.credits_to_grant({2, 2}), 0) << "a smaller window does not revoke credits";
}

TEST(UnitQueue, BlocksInFlightFreePrefetchSlots) {
  UnitQueue queue;
  const CreditWindow window{2, 4};
  EXPECT_EQ(queue.credits_to_grant(window), 2);
  queue.add_lease(lease(0, 2));
  render(queue, 0);
  EXPECT_EQ(queue.credits_to_grant(window), 0) << "it has not been sent";
  ASSERT_TRUE(queue.next_block(Time()).has_value());
  EXPECT_EQ(queue.credits_to_grant(window), 1);
  queue.add_lease(lease(2, 1));
  for (int i = 1; i <= 2; ++i) render(queue, i);
  while (queue.next_block(Time())) continue;
  EXPECT_EQ(queue.credits_to_grant(window), 1) << "three in flight: four in total";
  queue.reset_offers();
  queue.acknowledge(unit(0));
  v1::WorkerHello hello;
  queue.fill_hello(hello, window);
  EXPECT_EQ(hello.credit_count(), 0) << "two held units are not sent yet";
  while (queue.next_block(Time())) continue;
  queue.fill_hello(hello, window);
  EXPECT_EQ(hello.credit_count(), 2);
}

TEST(UnitQueue, HeldUnitIsOfferedUnderNewLease) {
  UnitQueue queue;
  queue.add_lease(lease(0, 1, 1));
  render(queue, 0);
  ASSERT_TRUE(queue.next_block(Time()).has_value());
  queue.add_lease(lease(0, 1, 2));
  EXPECT_TRUE(queue.waiting().empty()) << "it is not rendered twice";
  const auto block = queue.next_block(Time());
  ASSERT_TRUE(block.has_value());
  EXPECT_EQ(block->lease->seal(), "seal 2");
}

TEST(UnitQueue, EndedJobRemovesOnlyItsUnits) {
  UnitQueue queue;
  queue.add_lease(lease(0, 2, 1, "job"));
  queue.add_lease(lease(0, 2, 2, "other"));
  queue.start(unit(0));
  queue.drop_job("job");
  EXPECT_EQ(queue.waiting(), (std::deque<UnitKey>{unit(0, "other"), unit(1, "other")}));
  EXPECT_FALSE(queue.finish(unit(0), "block", {}, 0));
  EXPECT_EQ(queue.size(), 2);
}

TEST(CreditWindow, CoversRoundTripWithinBuffer) {
  EXPECT_EQ(credit_window(4, 0, 0, 0, 1'000'000).prefetch_limit, 8) << "no measurements yet";
  EXPECT_EQ(credit_window(4, 0.1, 0.2, 0, 1'000'000).prefetch_limit, 8 + 2);
  EXPECT_EQ(credit_window(4, 0.1, 0.2, 200'000, 1'000'000).in_flight_limit, 5);
  EXPECT_EQ(credit_window(4, 0.1, 0.2, 2'000'000, 1'000'000).in_flight_limit, 1) << "never zero";
  EXPECT_GE(credit_window(4, 0.1, 0.2, 0, 1LL << 60).in_flight_limit, 1 << 30) << "no overflow";
}

TEST(UnitQueue, TracksOldestUnacknowledgedBlock) {
  UnitQueue queue;
  queue.add_lease(lease(0, 2));
  const Time begin = Time() + std::chrono::hours(1);
  render(queue, 0);
  EXPECT_FALSE(queue.oldest_offer().has_value());
  ASSERT_TRUE(queue.next_block(begin).has_value());
  render(queue, 1);
  ASSERT_TRUE(queue.next_block(begin + seconds(5)).has_value());
  EXPECT_EQ(queue.oldest_offer(), begin);
  EXPECT_EQ(queue.offered(unit(0)), begin);
  EXPECT_EQ(queue.offered(unit(1)), begin + seconds(5)) << "each block has its own round trip";
  ASSERT_TRUE(queue.acknowledge(unit(0)));
  EXPECT_FALSE(queue.offered(unit(0)).has_value());
  EXPECT_EQ(queue.oldest_offer(), begin + seconds(5));
  queue.reset_offers();
  EXPECT_FALSE(queue.oldest_offer().has_value());
}

}  // namespace
}  // namespace tessera::agent