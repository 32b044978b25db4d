// Workers as operators see them: their states, also of workers that are gone.
#include <algorithm>
#include <string>
#include <vector>

#include "server/service/messages/messages.h"
#include "tests/unit/server/coordinator/coordinator_fixture.h"

namespace tessera::server {
namespace {

class ListedWorkers : public CoordinatorFixture {
 protected:
  /// Returns the worker, or one with state unspecified if it is not listed.
  v1::Worker listed(const std::string& id) {
    pump();
    for (const auto& [worker, silence] : coordinator->workers().list()) {
      if (worker.id == id) return to_message(worker, silence);
    }
    return {};
  }
  v1::Worker::State state(const std::string& id) { return listed(id).state(); }

  std::int64_t count_of(EventKind kind) {
    pump();
    const auto events = coordinator->farm().events().read({}, 1000);
    return std::count_if(events.begin(), events.end(),
                         [&](const Event& event) { return event.kind == kind; });
  }
};

TEST_F(ListedWorkers, DrainedWorkerHasLeftWhenItDisconnects) {
  const TestWorker ordered = join("ordered"), signalled = join("signalled");
  ASSERT_TRUE(coordinator->workers().drain_worker("ordered").ok());
  coordinator->workers().begin_draining(ordered.session);  // the worker confirms the order
  coordinator->workers().begin_draining(signalled.session);
  EXPECT_EQ(count_of(EventKind::worker_draining), 2);
  EXPECT_EQ(count_of(EventKind::worker_drained), 0);
  EXPECT_EQ(state("ordered"), v1::Worker::STATE_DRAINING);
  coordinator->workers().disconnect(ordered.session);
  coordinator->workers().disconnect(signalled.session);
  EXPECT_EQ(count_of(EventKind::worker_drained), 2);
  EXPECT_EQ(state("ordered"), v1::Worker::STATE_LEFT);
  EXPECT_EQ(state("signalled"), v1::Worker::STATE_LEFT);
  join("ordered");
  EXPECT_EQ(state("ordered"), v1::Worker::STATE_IDLE);
  now += std::chrono::minutes(1);
  coordinator->tick();
  EXPECT_EQ(count_of(EventKind::worker_lost), 1) << "only the worker that had not left";
}

TEST_F(ListedWorkers, DrainingWorkerWithUnitsIsLost) {
  create_job("job");
  const TestWorker worker = join("w");
  ASSERT_FALSE(worker.units.empty());
  coordinator->workers().begin_draining(worker.session);
  coordinator->workers().disconnect(worker.session);
  now += std::chrono::minutes(1);
  coordinator->tick();
  EXPECT_EQ(state("w"), v1::Worker::STATE_LOST);
  EXPECT_EQ(count_of(EventKind::worker_drained), 0);
}

TEST_F(ListedWorkers, DecisionsAboutAbsentWorkersAreListed) {
  join("bad", 64, "rack");
  join("aside");
  const auto ignore = [](const absl::Status&) {};
  coordinator->workers().ban_worker("bad", [](const auto&) {});
  coordinator->settings().set_aside("aside", "new memory", ignore);
  pump();
  EXPECT_TRUE(listed("bad").connected());
  EXPECT_EQ(state("aside"), v1::Worker::STATE_SET_ASIDE);

  start();  // the server knows only the decisions
  EXPECT_EQ(state("bad"), v1::Worker::STATE_QUARANTINED);
  EXPECT_EQ(state("certificate rack"), v1::Worker::STATE_QUARANTINED);
  const v1::Worker aside = listed("aside");
  EXPECT_EQ(aside.state(), v1::Worker::STATE_SET_ASIDE);
  EXPECT_EQ(aside.note(), "new memory");
  EXPECT_FALSE(aside.connected());
  EXPECT_FALSE(aside.has_silence());

  coordinator->workers().allow_worker("bad", ignore);
  coordinator->workers().allow_worker("certificate rack", ignore);
  coordinator->settings().bring_back("aside", ignore);
  pump();
  EXPECT_TRUE(coordinator->workers().list().empty());
}

TEST_F(ListedWorkers, BannedCertificateIsListedByItsWorkers) {
  join("one", 64, "rack");
  coordinator->workers().ban_worker("one", [](const auto&) {});
  join("two", 64, "rack");
  EXPECT_EQ(state("one"), v1::Worker::STATE_QUARANTINED);
  EXPECT_EQ(state("two"), v1::Worker::STATE_QUARANTINED);
  EXPECT_EQ(coordinator->workers().list().size(), 2u);
}

}  // namespace
}  // namespace tessera::server
