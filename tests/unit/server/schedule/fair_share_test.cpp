// Fair share: use that fades, weights, and waits that end.
#include "server/schedule/queue/fair_share.h"

#include <gtest/gtest.h>

#include <map>
#include <string>
#include <vector>

#include "tests/unit/server/schedule/scheduler_harness.h"

namespace tessera::server {
namespace {

using namespace std::chrono_literals;

TEST(FairShare, UseHalvesAfterHalfLife) {
  const Time start = Time{} + 1000h;
  FairShare share(1h, {}, start);
  share.charge("ann", 100, start);
  EXPECT_DOUBLE_EQ(share.cpu_seconds("ann", start), 100);
  EXPECT_NEAR(share.cpu_seconds("ann", start + 1h), 50, 1e-9);
  EXPECT_NEAR(share.cpu_seconds("ann", start + 3h), 12.5, 1e-9);
  share.charge("ben", 60, start + 1h);
  EXPECT_GT(share.position("ben"), share.position("ann")) << "60 now is more than 100 then";
}

TEST(FairShare, RefundTakesBackExactCharge) {
  FairShare share(1h, {}, Time{});
  share.charge("ann", 7, Time{} + 10min);
  share.charge("ann", 0.3, Time{} + 20min);
  share.charge("ann", -7, Time{} + 10min);
  EXPECT_NEAR(share.cpu_seconds("ann", Time{} + 20min), 0.3, 1e-12);
}

TEST(FairShare, RebaseKeepsUseAndOrder) {
  FairShare share(1h, {}, Time{});
  Time now{};
  for (int hour = 0; hour < 5000; ++hour) {  // 2^5000 is not a double
    now += 1h;
    if (share.needs_rebase(now)) share.rebase(now);
    share.charge("ann", 10, now);
    share.charge("ben", 5, now);
  }
  EXPECT_NEAR(share.cpu_seconds("ann", now), 20, 1e-9);
  EXPECT_NEAR(share.cpu_seconds("ben", now), 10, 1e-9);
}

TEST(FairShare, TableRestoresUse) {
  FairShare share(1h, {{"ann", 2.0}}, Time{});
  share.charge("ann", 30, Time{});
  share.charge("ben", 5, Time{} + 1h);
  FairShare next(1h, {{"ann", 2.0}}, Time{} + 50h);
  next.restore(share.table(Time{} + 1h), Time{} + 50h);
  EXPECT_NEAR(next.cpu_seconds("ann", Time{} + 50h), 15, 1e-9);
  EXPECT_NEAR(next.cpu_seconds("ben", Time{} + 50h), 5, 1e-9);
  EXPECT_NEAR(next.position("ann"), 7.5, 1e-9) << "per weight";
}

TEST(FairShare, FadedOwnersAreForgotten) {
  FairShare share(1h, {}, Time{});
  for (int i = 0; i < 1000; ++i) share.charge("owner" + std::to_string(i), 1, Time{});
  share.charge("late", 1, Time{} + 20h);
  share.forget_faded(Time{} + 20h);
  EXPECT_EQ(share.size(), 1u);
}

TEST(FairShare, NewWeightCountsForLaterChargesOnly) {
  FairShare share(1h, {{"ann", 2.0}}, Time{});
  share.charge("ann", 30, Time{});
  share.set_weight("ann", 3);
  EXPECT_NEAR(share.usage("ann", Time{}), 15, 1e-9);
  share.charge("ann", 30, Time{});
  EXPECT_NEAR(share.usage("ann", Time{}), 25, 1e-9);
  EXPECT_NEAR(share.usage("ann", Time{} + 1h), 12.5, 1e-9);
  FairShare next(1h, {{"ann", 3.0}}, Time{});
  next.restore(share.table(Time{}), Time{});
  EXPECT_NEAR(next.usage("ann", Time{}), 25, 1e-9) << "also in the next process";
}

// In the scheduler --------------------------------------------------------------------------------

/// A farm of workers with one thread each that render what they are leased, in simulated time.
class SharedFarm {
 public:
  SharedFarm(int workers, const SchedulePolicy& policy) : farm({}, policy) {
    for (int i = 0; i < workers; ++i) {
      workers_.push_back(
          farm.connect("w" + std::to_string(i), {.threads = 1, .credits = 1, .tags = {"gpu"}}));
    }
  }
  /// Renders for a time. `cost`: CPU seconds of a unit of each owner.
  void run(Duration span, const std::map<std::string, double>& cost) {
    for (const Time end = farm.now + span; farm.now < end;) {
      farm.now += 1s;
      for (const WorkerKey worker : workers_) serve(worker, cost);
      farm.scheduler.tick(farm.now, 1s);
    }
  }
  double total() const {
    double sum = 0;
    for (const auto& [owner, seconds] : spent) sum += seconds;
    return sum;
  }

  SchedulerHarness farm;
  std::map<std::string, double> spent;      // CPU seconds rendered, by owner
  std::map<std::string, Duration> longest;  // time between two leases, by owner
  std::map<std::string, Time> last_leased;

 private:
  struct Rendering {
    UnitName unit;
    Time until;
    double seconds = 0;
  };
  void serve(WorkerKey worker, const std::map<std::string, double>& cost) {
    farm.scheduler.connections().record_contact(worker, farm.now);
    auto& rendering = rendering_[worker];
    if (!rendering.unit.job_id.empty() && farm.now >= rendering.until) {
      const Job& job = *farm.scheduler.jobs().find(rendering.unit.job_id);
      spent[job.spec->owner] += rendering.seconds;
      const UnitName done = std::exchange(rendering, {}).unit;
      farm.complete(worker, done, cost.at(job.spec->owner));
    }
    for (const UnitName& unit : farm.leased(worker)) {
      const std::string owner = farm.scheduler.jobs().find(unit.job_id)->spec->owner;
      const double seconds = cost.at(owner);
      rendering = {unit, farm.now + std::chrono::milliseconds(static_cast<int>(1000 * seconds)),
                   seconds};
      farm.scheduler.connections().scene_loaded(worker, unit.job_id, {0, 0});
      if (last_leased.count(owner) > 0) {
        longest[owner] = std::max(longest[owner], farm.now - last_leased[owner]);
      }
      last_leased[owner] = farm.now;
    }
  }
  std::vector<WorkerKey> workers_;
  std::map<WorkerKey, Rendering> rendering_;
};

TEST(FairShare, TwentyTenantsGetTheirShares) {
  SchedulePolicy policy;
  policy.audit_fraction = 0;
  std::map<std::string, double> cost;
  double weights = 0;
  for (int i = 0; i < 20; ++i) {
    const std::string owner = "tenant" + std::to_string(i);
    cost[owner] = 1 + i % 7 * 3;  // seconds a unit: 1 to 19
    policy.share.weights[owner] = i % 4 == 0 ? 2 : 1;
    weights += policy.share.weights[owner];
  }
  SharedFarm farm(40, policy);
  for (int i = 0; i < 20; ++i) {
    const std::string owner = "tenant" + std::to_string(i);
    if (i % 2 == 0) {  // one long job
      farm.farm.queue_job({.tiles = 8000, .frames = 10, .owner = owner});
    } else {  // many short ones
      for (int k = 0; k < 800; ++k) farm.farm.queue_job({.tiles = 1 + k % 50, .owner = owner});
    }
  }
  farm.farm.scheduler.dispatcher().dispatch_all(farm.farm.now);
  farm.run(2h, cost);
  for (const auto& [owner, unit_seconds] : cost) {
    const double share = policy.share.weights[owner] / weights;
    EXPECT_NEAR(farm.spent[owner] / farm.total() / share, 1, 0.05) << owner;
  }
}

TEST(FairShare, LeasesFollowNewWeightFromChangeOn) {
  SchedulePolicy policy;
  policy.audit_fraction = 0;
  SharedFarm farm(4, policy);
  const std::map<std::string, double> cost{{"ann", 2}, {"ben", 2}};
  farm.farm.queue_job({.tiles = 8000, .frames = 10, .owner = "ann"});
  farm.farm.queue_job({.tiles = 8000, .frames = 10, .owner = "ben"});
  farm.farm.scheduler.dispatcher().dispatch_all(farm.farm.now);
  const auto ratio_in = [&](Duration span) {
    farm.spent.clear();
    farm.run(span, cost);
    return farm.spent["ann"] / farm.spent["ben"];
  };
  EXPECT_NEAR(ratio_in(30min), 1, 0.02);
  farm.farm.scheduler.limits().set_weight("ann", 3, farm.farm.now);
  EXPECT_NEAR(ratio_in(10min), 3, 0.2) << "past use is not divided again";
  EXPECT_NEAR(ratio_in(30min), 3, 0.06);
  farm.farm.scheduler.limits().set_weight("ann", 1, farm.farm.now);
  EXPECT_NEAR(ratio_in(10min), 1, 0.1);
}

TEST(FairShare, LeasesAreTakenBackWithWeightOfTheirCharge) {
  SchedulerHarness farm;
  const WorkerKey worker = farm.connect("w1", {.threads = 4, .credits = 4});
  farm.add_job({.tiles = 4, .owner = "ann"});
  const std::vector<UnitName> units = farm.leased(worker);
  ASSERT_EQ(units.size(), 4u);
  EXPECT_NEAR(farm.scheduler.limits().share().usage("ann", farm.now), 4, 1e-9);
  farm.scheduler.limits().set_weight("ann", 100, farm.now);
  EXPECT_NEAR(farm.scheduler.limits().share().usage("ann", farm.now), 0.04, 1e-9);
  for (const UnitName& unit : units) farm.commit(worker, unit, 0);
  EXPECT_NEAR(farm.scheduler.limits().share().usage("ann", farm.now), 0, 1e-9);
}

TEST(FairShare, ShortJobsInTurnDoNotGoFirst) {
  SchedulePolicy policy;
  policy.audit_fraction = 0;
  SharedFarm farm(4, policy);
  const std::map<std::string, double> cost{{"ann", 2}, {"ben", 2}};
  farm.farm.add_job({.tiles = 8000, .frames = 10, .owner = "ben"});
  farm.run(1h, cost);
  farm.spent.clear();
  for (int i = 0; i < 360; ++i) {  // ann always has exactly one short job
    Job& job = farm.farm.add_job({.tiles = 4, .owner = "ann"});
    for (int second = 0;
         second < 600 && job.plan.value_or(JobPlan({0}, 1, {{}})).counts().committed < 4;
         ++second) {
      farm.run(1s, cost);
    }
    farm.farm.scheduler.results().finish_frame(job, 0, farm.farm.now);
    ASSERT_EQ(job.state, JobState::done);
  }
  EXPECT_LT(farm.spent["ann"], 1.1 * farm.spent["ben"]);
}

TEST(FairShare, NewcomerDoesNotGetWholeFarm) {
  SchedulePolicy policy;
  policy.audit_fraction = 0;
  SharedFarm farm(10, policy);
  const std::map<std::string, double> cost{{"old", 2}, {"new", 2}};
  farm.farm.add_job({.tiles = 8000, .frames = 1000, .owner = "old"});
  farm.run(5h, cost);  // several half-lives: as after a week
  farm.farm.add_job({.tiles = 8000, .frames = 10, .owner = "new"});
  farm.spent.clear();
  farm.run(10min, cost);
  EXPECT_GT(farm.spent["old"], 0.4 * farm.total());
  EXPECT_GT(farm.spent["new"], 0.45 * farm.total());
}

TEST(FairShare, UseOutlivesJobAndRestart) {
  SchedulePolicy policy;
  SchedulerHarness farm({}, policy);
  const WorkerKey worker = farm.connect("w1", {.threads = 1, .credits = 1});
  Job& job = farm.add_job({.tiles = 1, .owner = "ann"});
  farm.complete(worker, farm.leased(worker).at(0), 500);
  farm.scheduler.results().finish_frame(job, 0, farm.now);
  ASSERT_EQ(job.state, JobState::done);
  const auto table = farm.scheduler.limits().usage(farm.now);
  ASSERT_EQ(table.size(), 1u);
  EXPECT_EQ(table[0].owner, "ann");
  EXPECT_NEAR(table[0].cpu_seconds, 500, 1e-6);

  SchedulerHarness restarted({}, policy);
  restarted.scheduler.limits().restore_usage(table, restarted.now);
  restarted.queue_job({.tiles = 1, .owner = "ann"});
  const Job& of_ben = restarted.queue_job({.tiles = 1, .owner = "ben"});
  const WorkerKey other = restarted.connect("w1", {.threads = 1, .credits = 1});
  EXPECT_EQ(restarted.leased(other).at(0).job_id, of_ben.spec->id);
}

TEST(FairShare, LowPriorityWaitsNoLongerThanLimit) {
  SchedulePolicy policy;
  policy.audit_fraction = 0;
  SharedFarm farm(4, policy);
  const std::map<std::string, double> cost{{"high", 3}, {"low", 3}, {"tagged", 3}};
  farm.farm.queue_job({.tiles = 8000, .frames = 10, .priority = 50, .owner = "high"});
  farm.farm.queue_job({.tiles = 8000, .frames = 10, .priority = -50, .owner = "low"});
  farm.farm.queue_job(
      {.tiles = 8000, .frames = 10, .priority = -60, .owner = "tagged", .tag = "gpu"});
  farm.farm.scheduler.dispatcher().dispatch_all(farm.farm.now);
  farm.run(1h, cost);
  for (const char* owner : {"low", "tagged"}) {
    EXPECT_GT(farm.spent[owner], 20) << owner;
    EXPECT_LE(farm.longest[owner], policy.share.max_wait + 10s) << owner;
  }
  EXPECT_GT(farm.spent["high"], 0.95 * farm.total()) << "priority still decides";
}

}  // namespace
}  // namespace tessera::server
