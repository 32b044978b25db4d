// The log of delivered units, which timelines are drawn from.
#include <string>
#include <utility>
#include <vector>

#include "server/telemetry/delivery_log.h"
#include "tests/unit/server/coordinator/coordinator_fixture.h"

namespace tessera::server {
namespace {

Delivery made(std::int64_t job, std::int32_t tile) {
  return {.job = job, .unit = {0, tile, 0}, .worker_id = "w"};
}

TEST(DeliveryLog, ReadsByJobFromSequenceInPages) {
  DeliveryLog log;
  EXPECT_TRUE(log.read(1, 0, 9).empty());
  for (std::int32_t tile = 0; tile < 6; ++tile) log.add(made(tile % 2, tile));
  const auto first = log.read(1, 0, 2);
  ASSERT_EQ(first.size(), 2U);
  EXPECT_EQ(first[0].unit.tile, 1);
  EXPECT_EQ(first[1].unit.tile, 3);
  const auto rest = log.read(1, first.back().sequence, 9);
  ASSERT_EQ(rest.size(), 1U);
  EXPECT_EQ(rest[0].unit.tile, 5);
  EXPECT_TRUE(log.read(1, rest.back().sequence + 100, 9).empty());
}

TEST(DeliveryLog, KeepsNewestAndNamesOfGoneWorkers) {
  DeliveryLog log;
  for (int i = 0; i < 10; ++i) {
    log.add({.job = 1, .unit = {0, i, 0}, .worker_id = "worker " + std::to_string(i)});
  }
  EXPECT_EQ(log.read(1, 0, 99).at(7).worker_id, "worker 7");
  const auto max_count = static_cast<std::int32_t>(DeliveryLog::kMaxDeliveries);
  for (std::int32_t i = 0; i < max_count; ++i) log.add(made(2, i));
  EXPECT_TRUE(log.read(1, 0, 99).empty());
  EXPECT_EQ(log.worker_count(), 1U) << "IDs of workers without kept deliveries are forgotten";
  const auto all_kept = log.read(2, 0, 2 * DeliveryLog::kMaxDeliveries);
  ASSERT_EQ(all_kept.size(), DeliveryLog::kMaxDeliveries);
  EXPECT_EQ(all_kept.front().unit.tile, 0);
  EXPECT_EQ(log.read(2, all_kept.back().sequence - 1, 9).at(0).unit.tile, max_count - 1);
}

class Deliveries : public CoordinatorFixture {
 protected:
  std::vector<Delivery> all(const std::string& job) {
    return coordinator->queries().deliveries(job, 0, 1000).value();
  }
};

TEST_F(Deliveries, RecordWorkerCpuTimeAndLease) {
  TestWorker worker = join("w", 2);
  const std::string job = create_job("a");
  collect(worker);
  ASSERT_EQ(worker.units.size(), 2U);
  const contract::Unit unit = worker.units[0].name.unit;
  now += std::chrono::seconds(3);
  wall_us += 5'000'000;
  deliver_all(worker);
  pump();
  const auto deliveries = all(job);
  ASSERT_EQ(deliveries.size(), 2U);
  EXPECT_EQ(deliveries[0].unit, unit);
  EXPECT_EQ(deliveries[0].worker_id, "w");
  EXPECT_EQ(deliveries[0].outcome, DeliveryOutcome::committed);
  EXPECT_EQ(deliveries[0].end_us, wall_us);
  EXPECT_EQ(deliveries[0].cpu_seconds, 0.5);
  EXPECT_EQ(deliveries[0].lease_seconds, 3);
  EXPECT_EQ(deliveries[0].retry_count, 0);
  EXPECT_TRUE(absl::IsNotFound(coordinator->queries().deliveries("nosuch", 0, 9).status()));
}

TEST_F(Deliveries, CountEarlierFailuresAndLosses) {
  TestWorker first = join("first", 1);
  const std::string job = create_job("a");
  collect(first);
  const Leased unit = std::exchange(first.units, {}).at(0);
  coordinator->workers().fail_unit(first.session, unit.lease, unit.name.unit.tile,
                                   {"first", "burnt", ""}, absl::StatusCode::kInternal);
  TestWorker second = join("second", 64);
  collect(second);
  finish_job(second, job);
  for (const Delivery& delivery : all(job)) {
    EXPECT_EQ(delivery.retry_count, delivery.unit == unit.name.unit ? 1 : 0) << delivery.unit.tile;
  }
}

TEST_F(Deliveries, DistinguishAuditsFromRepeats) {
  options.policy.audit_fraction = 1;
  start();
  TestWorker ann = join("ann");
  TestWorker bob = join("bob");
  const std::string job = create_job("a");
  collect(ann);
  const Leased unit = ann.units.at(0);
  deliver(ann, unit, bytes_of(unit));
  pump();
  deliver(ann, unit, bytes_of(unit));  // a repeat of its own block
  pump();
  for (int round = 0; round < 20 && !has_ended(view(job).state); ++round) {
    for (TestWorker* worker : {&ann, &bob}) {
      deliver_all(*worker);
      pump();
      coordinator->workers().grant_credits(worker->session, 8);
    }
  }
  ASSERT_EQ(view(job).state, JobState::done);
  std::vector<DeliveryOutcome> outcomes;
  std::vector<std::string> workers;
  for (const Delivery& delivery : all(job)) {
    if (delivery.unit != unit.name.unit) continue;
    outcomes.push_back(delivery.outcome);
    workers.emplace_back(delivery.worker_id);
  }
  ASSERT_GE(outcomes.size(), 3U);
  EXPECT_EQ(outcomes[0], DeliveryOutcome::committed);
  EXPECT_EQ(outcomes[1], DeliveryOutcome::duplicate);
  EXPECT_EQ(outcomes.back(), DeliveryOutcome::audit);
  EXPECT_EQ(workers.back(), "bob");
}

}  // namespace
}  // namespace tessera::server
