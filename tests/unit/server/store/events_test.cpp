// Events in the store.
#include <string>
#include <vector>

#include "tests/unit/server/store/store_fixture.h"

namespace tessera::server {
namespace {

class StoredEvents : public StoreFixture {
 protected:
  void add(std::int64_t first, int count) {
    std::vector<Event> events;
    for (int i = 0; i < count; ++i) {
      events.push_back({first + i, 5, EventKind::job_done, "j", "ann", "w", std::to_string(i)});
    }
    EXPECT_TRUE(store().events().add(events).ok());
  }
  std::vector<std::int64_t> sequences(const EventQuery& query = {}, std::size_t limit = 1000) {
    std::vector<std::int64_t> found;
    const auto events = store().events().read(query, limit);
    EXPECT_TRUE(events.ok()) << events.status();
    for (const Event& event : *events) found.push_back(event.sequence);
    return found;
  }
};

TEST_F(StoredEvents, AreReadInOrderAfterReopening) {
  add(10, 2);
  add(50, 1);
  open();
  EXPECT_EQ(sequences(), (std::vector<std::int64_t>{10, 11, 50}));
  EXPECT_EQ(sequences({.after = 10}), (std::vector<std::int64_t>{11, 50}));
  EXPECT_EQ(sequences({}, 2), (std::vector<std::int64_t>{10, 11}));
  const auto newest = store().events().newest(2);
  ASSERT_EQ(newest->size(), 2u);
  EXPECT_EQ(newest->front().sequence, 11);
  const Event& last = newest->back();
  EXPECT_EQ(last.time_us, 5);
  EXPECT_EQ(last.kind, EventKind::job_done);
  EXPECT_EQ(last.job_id + last.owner + last.worker_id + last.text, "jannw0");
  EXPECT_EQ(store().events().last_dropped(), 0);
}

TEST_F(StoredEvents, OwnersSeeTheirOwn) {
  const std::vector<Event> events = {{1, 0, EventKind::job_done, "a", "ann", "", ""},
                                     {2, 0, EventKind::job_done, "b", "ben", "", ""},
                                     {3, 0, EventKind::worker_joined, "", "", "w", ""},
                                     {4, 0, EventKind::budget_warning, "", "ann", "", "of ann"},
                                     {5, 0, EventKind::budget_warning, "", "ben", "", "of ben"},
                                     {6, 0, EventKind::budget_used_up, "", "", "", "of a project"}};
  ASSERT_TRUE(store().events().add(events).ok());
  EXPECT_EQ(sequences({.owner = "ann"}), (std::vector<std::int64_t>{1, 3, 4}));
  EXPECT_EQ(sequences({.job_id = "b"}), (std::vector<std::int64_t>{2}));
  EXPECT_EQ(sequences().size(), 6u);
  for (const Event& event : events) {  // the log in memory says the same
    const bool is_seen = event.sequence == 1 || event.sequence == 3 || event.sequence == 4;
    EXPECT_EQ(is_visible_to(event, "ann"), is_seen) << event.sequence;
  }
}

TEST_F(StoredEvents, OldestAreDroppedAndThatIsRemembered) {
  max_events_ = 100;
  open();
  for (int i = 0; i < 30; ++i) add(1 + 10 * i, 10);
  const auto kept = sequences();
  EXPECT_GE(kept.size(), 100u);
  EXPECT_LE(kept.size(), 110u);
  EXPECT_EQ(kept.back(), 300);
  EXPECT_EQ(store().events().last_dropped(), kept.front() - 1);
  open();
  EXPECT_EQ(store().events().last_dropped(), kept.front() - 1);
  EXPECT_EQ(sequences(), kept);
  for (int i = 30; i < 60; ++i) add(1 + 10 * i, 10);
  EXPECT_LE(sequences().size(), 110u) << "the count is right after reopening";
}

TEST_F(StoredEvents, LostEventsCountAsDropped) {
  add(10, 1);
  ASSERT_TRUE(store().events().note_lost(31).ok());
  add(31, 1);
  open();
  EXPECT_EQ(store().events().last_dropped(), 30);
}

}  // namespace
}  // namespace tessera::server
