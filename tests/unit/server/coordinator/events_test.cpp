// Events of jobs and workers, and operators' orders to workers.
#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "server/telemetry/event_log.h"
#include "tests/unit/server/coordinator/coordinator_fixture.h"

namespace tessera::server {
namespace {

std::int64_t no_time() {
  return 0;
}

Event event_of(EventKind kind, const std::string& job, const std::string& text = "",
               const std::string& owner = "ann") {
  return {0, 0, kind, job, owner, "w", text};
}

/// Adds an event as the writer thread does once it is durable.
void add(EventLog& log, const Event& event) {
  log.publish(log.number({log.stamp(event)}));
}

std::vector<std::string> texts(const std::vector<Event>& events) {
  std::vector<std::string> texts;
  texts.reserve(events.size());
  for (const Event& event : events) texts.push_back(event.text);
  return texts;
}

class CountingReader final : public EventReader {
 public:
  void wake() override { ++wake_count; }
  int wake_count = 0;
};

TEST(EventLog, WakesWaitingReaderOnce) {
  EventLog log(1, no_time);
  add(log, event_of(EventKind::job_done, "j"));
  const auto reader = std::make_shared<CountingReader>();
  EXPECT_TRUE(log.wake_after(log.newest(), reader));
  EXPECT_TRUE(log.wake_after(log.newest(), reader));
  log.publish({});
  EXPECT_EQ(reader->wake_count, 0);
  for (int i = 0; i < 2; ++i) add(log, event_of(EventKind::job_done, "j"));
  EXPECT_EQ(reader->wake_count, 1);
}

TEST(EventLog, ReaderThatIsBehindNeedNotWait) {
  EventLog log(1, no_time);
  const std::int64_t seen = log.newest();
  add(log, event_of(EventKind::job_done, "j"));
  const auto reader = std::make_shared<CountingReader>();
  EXPECT_FALSE(log.wake_after(seen, reader)) << "the event came between reading and waiting";
}

TEST(EventLog, ForgottenReaderIsNotWoken) {
  EventLog log(1, no_time);
  const auto reader = std::make_shared<CountingReader>();
  EXPECT_TRUE(log.wake_after(log.newest(), reader));
  log.forget_reader(reader);
  add(log, event_of(EventKind::job_done, "j"));
  EXPECT_EQ(reader->wake_count, 0);
  EXPECT_EQ(reader.use_count(), 1) << "the log does not keep it";
}

TEST(EventLog, WatcherIsWokenByChangesOfItsJobOnly) {
  EventLog log(1, no_time);
  const auto reader = std::make_shared<CountingReader>();
  EXPECT_TRUE(log.wake_after_change(log.newest(), "a", reader));
  add(log, event_of(EventKind::job_done, "b"));
  add(log, event_of(EventKind::frame_finished, "a"));
  add(log, event_of(EventKind::log_line, "a"));
  EXPECT_EQ(reader->wake_count, 0);
  add(log, event_of(EventKind::job_done, "a"));
  add(log, event_of(EventKind::job_removed, "a"));
  EXPECT_EQ(reader->wake_count, 1) << "a reader waits once";
}

TEST(EventLog, WatcherThatIsBehindNeedNotWait) {
  EventLog log(1, no_time);
  const auto reader = std::make_shared<CountingReader>();
  const std::int64_t seen = log.newest();
  add(log, event_of(EventKind::job_paused, "b"));
  EXPECT_TRUE(log.wake_after_change(seen, "a", reader));
  add(log, event_of(EventKind::job_paused, "a"));
  EXPECT_FALSE(log.wake_after_change(seen, "a", reader));
  for (std::size_t i = 0; i < EventLog::kMaxEvents; ++i) {
    add(log, event_of(EventKind::job_paused, "b"));
  }
  EXPECT_FALSE(log.wake_after_change(seen, "a", reader)) << "the change is no longer in memory";
}

TEST(EventLog, ForgottenWatcherIsNotWoken) {
  EventLog log(1, no_time);
  const auto reader = std::make_shared<CountingReader>();
  EXPECT_TRUE(log.wake_after_change(log.newest(), "a", reader));
  log.forget_reader("a", reader);
  log.forget_reader("b", reader);
  add(log, event_of(EventKind::job_done, "a"));
  EXPECT_EQ(reader->wake_count, 0);
  EXPECT_EQ(reader.use_count(), 1) << "the log does not keep it";
}

TEST(EventLog, ReadsFromSequenceInPages) {
  EventLog log(1, no_time);
  for (const char* text : {"a", "b", "c", "d"}) add(log, event_of(EventKind::job_done, "j", text));
  const auto first = log.read({}, 2);
  EXPECT_EQ(texts(first), (std::vector<std::string>{"a", "b"}));
  EXPECT_EQ(texts(log.read({first.back().sequence, "", ""}, 9)),
            (std::vector<std::string>{"c", "d"}));
  EventLog next(2, no_time);  // after the next start
  add(next, event_of(EventKind::job_done, "j"));
  EXPECT_GT(next.read({}, 1).front().sequence, log.read({}, 9).back().sequence);
}

TEST(EventLog, NewestSequenceGrowsAcrossRestarts) {
  EventLog log(1, no_time), next(2, no_time);
  const std::int64_t before = log.newest();
  add(log, {});  // a line
  EXPECT_EQ(log.newest(), before + 1);
  EXPECT_GT(next.newest(), log.newest());
}

TEST(EventLog, JobLinesAreInterleavedWithEvents) {
  EventLog log(1, no_time);
  add(log, event_of(EventKind::job_submitted, "j", "1"));
  add(log, event_of(EventKind::log_line, "j", "2"));
  add(log, event_of(EventKind::job_submitted, "other", "3"));
  add(log, event_of(EventKind::log_line, "other", "4"));
  add(log, event_of(EventKind::job_done, "j", "5"));
  EXPECT_EQ(texts(log.read({0, "j", ""}, 9)), (std::vector<std::string>{"1", "2", "5"}));
  EXPECT_EQ(texts(log.read({0, "j", ""}, 2)), (std::vector<std::string>{"1", "2"}));
  EXPECT_EQ(texts(log.read({}, 9)), (std::vector<std::string>{"1", "3", "5"}));
}

TEST(EventLog, EventIsVisibleOncePublished) {
  EventLog log(1, no_time);
  int wakes = 0;
  log.on_pending([&] { ++wakes; });
  log.add(event_of(EventKind::job_done, "j", "a"));
  log.add(event_of(EventKind::job_done, "j", "b"));
  EXPECT_EQ(wakes, 1);
  EXPECT_TRUE(log.read({}, 9).empty());
  EventLog::Pending pending = log.take_pending();
  EXPECT_FALSE(log.has_pending());
  log.add(event_of(EventKind::job_done, "j", "c"));
  log.put_back(pending);  // it could not be written
  pending = log.take_pending();
  EXPECT_EQ(texts(pending.events), (std::vector<std::string>{"a", "b", "c"}));
  const std::int64_t before = log.newest();
  const std::vector<Event> numbered = log.number(pending.events);
  EXPECT_EQ(numbered.back().sequence, before + 3);
  EXPECT_EQ(log.number(pending.events).back().sequence, before + 6) << "no number is given twice";
  EXPECT_EQ(log.newest(), before) << "none of them is visible";
  log.publish(numbered);
  EXPECT_EQ(log.newest(), before + 3);
  EXPECT_EQ(texts(log.read({}, 9)), (std::vector<std::string>{"a", "b", "c"}));
}

TEST(EventLog, EventsBeyondTheMaximumCountAsLost) {
  EventLog log(1, no_time);
  for (std::size_t i = 0; i <= EventLog::kMaxPending; ++i) {
    log.add(event_of(EventKind::job_done, "j", std::to_string(i)));
  }
  const EventLog::Pending pending = log.take_pending();
  EXPECT_TRUE(pending.has_lost);
  EXPECT_EQ(pending.events.size(), EventLog::kMaxPending);
  EXPECT_EQ(pending.events.front().text, "1");
}

TEST(EventLog, OlderEventsAreInTheStoreOnly) {
  EventLog log(2, no_time);
  std::vector<Event> stored;
  for (std::size_t i = 0; i < EventLog::kMaxEvents; ++i) {
    stored.push_back(event_of(EventKind::job_done, "j", std::to_string(i)));
    stored.back().sequence = 100 + static_cast<std::int64_t>(i);
  }
  log.load(stored, 50);
  EXPECT_EQ(log.complete_after(), 99);
  add(log, event_of(EventKind::job_done, "j", "new"));
  EXPECT_EQ(log.complete_after(), 100);
  EXPECT_EQ(log.read({.after = 100}, 1).front().sequence, 101);
  EventLog small(2, no_time);
  small.load({stored[7]}, 50);
  EXPECT_EQ(small.complete_after(), 50) << "all that are kept";
}

TEST(EventLog, OwnerSeesOwnJobsAndWorkers) {
  EventLog log(1, no_time);
  add(log, event_of(EventKind::job_done, "a", "ann's", "ann"));
  add(log, event_of(EventKind::job_done, "b", "bob's", "bob"));
  add(log, event_of(EventKind::worker_joined, "", "worker", ""));
  EXPECT_EQ(texts(log.read({0, "", "ann"}, 9)), (std::vector<std::string>{"ann's", "worker"}));
}

TEST(EventLog, LogLinesDoNotEvictEvents) {
  EventLog log(1, no_time);
  add(log, event_of(EventKind::job_submitted, "j", "submitted"));
  const std::size_t count = EventLog::kMaxLinesOfJob + 10;
  for (std::size_t i = 0; i < count; ++i) {
    add(log, event_of(EventKind::log_line, "j", std::to_string(i)));
  }
  const auto kept = texts(log.read({0, "j", ""}, 2 * count));
  ASSERT_EQ(kept.size(), EventLog::kMaxLinesOfJob + 1);
  EXPECT_EQ(kept.front(), "submitted");
  EXPECT_EQ(kept[1], "10");
  EXPECT_EQ(kept.back(), std::to_string(count - 1));
}

TEST(EventLog, TotalSizeIsLimited) {
  EventLog log(1, no_time);
  const std::size_t jobs = EventLog::kMaxLines / 1000 + 2;
  for (std::size_t job = 0; job < jobs; ++job) {
    for (int i = 0; i < 1000; ++i) add(log, event_of(EventKind::log_line, std::to_string(job)));
  }
  std::size_t sum = 0;
  for (std::size_t job = 0; job < jobs; ++job) {
    sum += log.read({0, std::to_string(job), ""}, 2000).size();
  }
  EXPECT_EQ(sum, EventLog::kMaxLines);
  EXPECT_TRUE(log.read({0, "0", ""}, 1).empty());  // the oldest went
}

TEST(EventLog, LongLineIsCutAtCharacterBoundary) {
  EventLog log(1, no_time);
  std::string umlauts(1, 'x');
  while (umlauts.size() < 2 * EventLog::kMaxTextBytes) umlauts += "\xC3\xA4";
  add(log, event_of(EventKind::job_failed, "j", umlauts));
  EXPECT_EQ(log.read({}, 1).front().text, umlauts.substr(0, EventLog::kMaxTextBytes - 1));
  EXPECT_EQ(cut_text("a\xE2\x82\xAC", 3), "a");
  EXPECT_EQ(cut_text("a\xE2\x82\xAC", 4), "a\xE2\x82\xAC");
}

class Events : public CoordinatorFixture {
 protected:
  std::vector<EventKind> kinds(const std::string& job = "") {
    pump();  // they are visible once they are durable
    std::vector<EventKind> kinds;
    for (const Event& event : coordinator->farm().events().read({0, job, ""}, 1000)) {
      kinds.push_back(event.kind);
    }
    return kinds;
  }
  absl::Status ban(const std::string& id) {
    absl::Status result = absl::UnknownError("no answer");
    coordinator->workers().ban_worker(id, [&](const auto& banned) {
      result = banned.status();
      banned_ = banned.value_or(std::vector<std::string>());
    });
    pump();
    return result;
  }
  absl::Status allow(const std::string& id) {
    absl::Status result = absl::UnknownError("no answer");
    coordinator->workers().allow_worker(id, [&](const absl::Status& status) { result = status; });
    pump();
    return result;
  }
  std::vector<std::string> banned_;  // by the last ban()
};

TEST_F(Events, JobLifecycleIsRecorded) {
  TestWorker worker = join("w");
  const std::string job = create_job("shot");
  finish_job(worker, job);
  EXPECT_EQ(kinds(),
            (std::vector{EventKind::worker_joined, EventKind::job_submitted, EventKind::job_running,
                         EventKind::frame_finished, EventKind::job_done}));
  EXPECT_TRUE(remove(job).ok());
  EXPECT_EQ(kinds().back(), EventKind::job_removed);
}

TEST_F(Events, BanNamesWorkersWithItsCertificate) {
  join("w1", 64, "pods");
  join("w2", 64, "pods");
  join("other", 64, "elsewhere");
  ASSERT_TRUE(ban("w2").ok());
  EXPECT_EQ(banned_, (std::vector<std::string>{"w1", "w2"}));
  join("alone");
  join("alone too");
  ASSERT_TRUE(ban("alone").ok());
  EXPECT_EQ(banned_, (std::vector<std::string>{"alone"}));
}

TEST_F(Events, BanHoldsForCertificateAfterRestart) {
  join("w", 64, "one");
  ASSERT_TRUE(ban("w").ok());
  start();
  join("w", 64, "one");  // the farm waits for workers that it knows
  TestWorker again = join("other", 64, "one");
  create_job("shot");
  collect(again);
  EXPECT_TRUE(again.units.empty());
  EXPECT_TRUE(allow("other").ok());
  collect(again);
  EXPECT_FALSE(again.units.empty());
}

TEST_F(Events, FailedUnitIncludesLastRendererOutput) {
  TestWorker worker = join("w");
  const std::string job = create_job("shot");
  collect(worker);
  const Leased& unit = worker.units.front();
  coordinator->workers().fail_unit(worker.session, unit.lease, unit.name.unit.tile,
                                   {"", "it broke", "first\nsecond\n"},
                                   absl::StatusCode::kInternal);
  pump();
  const auto events = texts(coordinator->farm().events().read({0, job, ""}, 100));
  ASSERT_GE(events.size(), 3u);
  const std::vector<std::string> last(events.end() - 3, events.end());
  EXPECT_NE(last[0].find("failed: it broke"), std::string::npos);
  EXPECT_EQ(last[1], "renderer: first");
  EXPECT_EQ(last[2], "renderer: second");
}

TEST_F(Events, WorkerLogsOnlyForLeasedJobs) {
  TestWorker worker = join("w");
  const std::string job = create_job("shot");
  const TestWorker stranger = join("late", 0);
  coordinator->workers().take_log_lines(stranger.session, {{job, "not mine"}});
  coordinator->workers().take_log_lines(worker.session, {{job, "mine"}, {"nosuch", "of no job"}});
  pump();
  const auto events = coordinator->farm().events().read({0, job, ""}, 100);
  EXPECT_EQ(events.back().text, "mine");
  EXPECT_EQ(events.back().worker_id, "w");
  for (const Event& event : events) EXPECT_NE(event.text, "not mine");
  finish_job(worker, job);
  coordinator->workers().take_log_lines(worker.session,
                                        {{job, "the last word"}});  // late, but accepted
  pump();
  EXPECT_EQ(coordinator->farm().events().read({0, job, ""}, 100).back().text, "the last word");
  start();
  worker = join("w");  // after a restart of the server
  coordinator->workers().take_log_lines(worker.session, {{job, "the very last"}});
  pump();
  const auto kept = texts(coordinator->farm().events().read({0, job, ""}, 100));
  EXPECT_EQ(kept.back(), "the very last");
  EXPECT_EQ(std::count(kept.begin(), kept.end(), "mine"), 0)
      << "lines of the last process are gone";
  EXPECT_EQ(kept.front(), "shot") << "its events are not";
}

TEST_F(Events, DrainedWorkerGetsNoLeases) {
  TestWorker worker = join("w");
  EXPECT_TRUE(absl::IsNotFound(coordinator->workers().drain_worker("nobody")));
  EXPECT_TRUE(coordinator->workers().drain_worker("w").ok());
  EXPECT_TRUE(coordinator->workers().take_outbox(worker.session).drain);
  EXPECT_FALSE(coordinator->workers().take_outbox(worker.session).drain);  // once
  create_job("shot");
  collect(worker);
  EXPECT_TRUE(worker.units.empty());
}

TEST_F(Events, BannedWorkerLosesUnitsAndResults) {
  TestWorker bad = join("bad");
  const std::string job = create_job("shot");
  collect(bad);
  ASSERT_FALSE(bad.units.empty());
  EXPECT_TRUE(absl::IsNotFound(ban("nobody")));
  EXPECT_TRUE(ban("bad").ok());
  TestWorker good = join("good");
  collect(good);
  EXPECT_EQ(good.units.size(), 6u);  // all units
  for (const Leased& unit : bad.units) deliver(bad, unit, bytes_of(unit));
  pump();
  collect(bad);
  ASSERT_EQ(bad.acknowledgements.size(), bad.units.size());
  for (const Acknowledgement& acknowledgement : bad.acknowledgements)
    EXPECT_EQ(acknowledgement.status, AckStatus::obsolete);
  EXPECT_EQ(view(job).committed_unit_count, 0);
  finish_job(good, job);
  EXPECT_EQ(view(job).state, JobState::done);
}

TEST_F(Events, BanSurvivesRestartUntilLifted) {
  join("bad");
  EXPECT_TRUE(ban("bad").ok());
  start();
  TestWorker worker = join("bad");
  now += std::chrono::seconds(6);  // known workers are not awaited any longer
  coordinator->workers().record_contact(worker.session);
  coordinator->tick();
  create_job("shot");
  collect(worker);
  EXPECT_TRUE(worker.units.empty());
  EXPECT_TRUE(allow("bad").ok());
  collect(worker);
  EXPECT_FALSE(worker.units.empty());
  EXPECT_TRUE(absl::IsNotFound(allow("nobody")));
  start();
  EXPECT_TRUE(store.workers().banned_workers()->empty());
}

// Durable events ----------------------------------------------------------------------------------

TEST_F(Events, AreTheSameAfterRestart) {
  TestWorker worker = join("w");
  const std::string job = create_job("shot");
  finish_job(worker, job);
  pump();
  const auto before = coordinator->farm().events().read({}, 1000);
  ASSERT_FALSE(before.empty());
  start();
  const auto after = coordinator->farm().events().read({}, 1000);
  ASSERT_GE(after.size(), before.size());
  for (std::size_t i = 0; i < before.size(); ++i) {
    EXPECT_EQ(after[i].sequence, before[i].sequence);
    EXPECT_EQ(after[i].text, before[i].text);
  }
  create_job("next");
  pump();
  EXPECT_GT(coordinator->farm().events().read({}, 1000).back().sequence, before.back().sequence);
}

/// Kills the server after each round of the writer: a job that is DONE in the store must have one
/// event of each kind, and what was visible must still be there.
TEST_F(Events, EveryChangeHasOneEventOverAnyCrash) {
  for (int rounds = 0; rounds < 12; ++rounds) {
    const std::string name = "shot" + std::to_string(rounds);
    TestWorker worker = join("w");
    coordinator->admission().create_job(remember(spec_of(name)), [](const auto&) {});
    for (int round = 0; round < rounds; ++round) {
      write_round();
      coordinator->run_film(false);
      deliver_all(worker);
    }
    const auto seen = coordinator->farm().events().read({}, 100'000);
    start();
    const auto kept = coordinator->farm().events().read({}, 100'000);
    ASSERT_GE(kept.size(), seen.size());
    for (std::size_t i = 0; i < seen.size(); ++i) ASSERT_EQ(kept[i].sequence, seen[i].sequence);
    worker = join("w");
    EXPECT_TRUE(create(spec_of(name)).ok()) << "the client repeats its request";
    const auto found = coordinator->queries().find_job(name);
    ASSERT_TRUE(found.ok()) << found.status();
    finish_job(worker, found->spec->id);
    const std::vector<EventKind> told = kinds(found->spec->id);
    for (const EventKind kind :
         {EventKind::job_submitted, EventKind::frame_finished, EventKind::job_done}) {
      EXPECT_EQ(std::count(told.begin(), told.end(), kind), 1)
          << "kind " << static_cast<int>(kind) << " after a crash in round " << rounds;
    }
  }
}

TEST_F(Events, FailedTransactionKeepsThemForTheNextOne) {
  join("w");
  pump();
  const std::size_t before = kinds().size();
  store.controls().fail_transactions_with(absl::ResourceExhaustedError("full"));
  coordinator->workers().drain_worker("w").IgnoreError();
  pump();
  EXPECT_EQ(coordinator->farm().events().read({}, 1000).size(), before);
  store.controls().fail_transactions_with(absl::OkStatus());
  now += std::chrono::minutes(1);
  coordinator->tick();
  pump();
  const auto events = kinds();
  EXPECT_EQ(std::count(events.begin(), events.end(), EventKind::worker_draining), 1);
}

}  // namespace
}  // namespace tessera::server
