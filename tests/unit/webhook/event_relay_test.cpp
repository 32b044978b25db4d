// Handling of each response to a post: retry, skip, store the sequence.
#include "webhook/event_relay.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"

namespace tessera::client {
namespace {

/// Scripted poster that records its posts.
class ScriptedPoster final : public HttpPoster {
 public:
  explicit ScriptedPoster(std::vector<absl::Status> answers) : answers_(std::move(answers)) {}

  absl::Status post(const std::string& body) override {
    posted.push_back(nlohmann::json::parse(body));
    const std::size_t index = posted.size() - 1;
    if (before_answer) before_answer(posted.size());
    return index < answers_.size() ? answers_[index] : absl::OkStatus();
  }
  absl::Duration retry_after() const override { return asked; }
  void cancel() override {}

  absl::Duration asked = absl::ZeroDuration();
  std::vector<nlohmann::json> posted;
  std::function<void(std::size_t)> before_answer;  // gets the number of posts so far

 private:
  const std::vector<absl::Status> answers_;
};

v1::Event event(v1::Event::Kind kind, std::int64_t sequence) {
  v1::Event made;
  made.set_kind(kind);
  made.set_sequence(sequence);
  made.set_job_id("j1");
  return made;
}

EventRelay::Options quick(const std::string& state_file = "") {
  EventRelay::Options options;
  options.state_file = state_file;
  options.first_wait = options.max_wait = absl::Milliseconds(1);
  return options;
}

/// Path of a file that does not exist, in a private folder.
std::string fresh_file() {
  std::string file =
      absl::StrCat(testing::TempDir(), "webhook-",
                   testing::UnitTest::GetInstance()->current_test_info()->name(), "-", ::getpid());
  std::filesystem::remove(file);
  return file;
}

TEST(EventRelay, RetriesUntilAccepted) {
  const absl::Status busy = absl::UnavailableError("busy");
  ScriptedPoster poster({busy, busy, absl::OkStatus()});
  EventRelay relay(poster, quick(), no_log);
  EXPECT_TRUE(relay.forward(event(v1::Event::KIND_JOB_DONE, 4)).ok());
  EXPECT_TRUE(relay.forward(event(v1::Event::KIND_WORKER_LOST, 5)).ok());
  ASSERT_EQ(poster.posted.size(), 4);
  for (int i : {0, 1, 2}) EXPECT_EQ(poster.posted[static_cast<std::size_t>(i)]["sequence"], 4);
  EXPECT_EQ(poster.posted[3]["sequence"], 5);
  EXPECT_EQ(poster.posted[3]["schema"], "tessera.event/1");
  EXPECT_EQ(poster.posted[3]["kind"], "worker lost");
  EXPECT_EQ(poster.posted[3]["job"], "j1");
}

TEST(EventRelay, SkipsAndLogsRefusedEvents) {
  ScriptedPoster poster({absl::FailedPreconditionError("answers 400")});
  std::vector<std::string> logged;
  EventRelay relay(poster, quick(),
                   [&](LogLevel, const std::string& line) { logged.push_back(line); });
  EXPECT_TRUE(relay.forward(event(v1::Event::KIND_JOB_DONE, 4)).ok());
  EXPECT_EQ(poster.posted.size(), 1);
  ASSERT_EQ(logged.size(), 1);
  EXPECT_EQ(logged[0], "event 4 (job done): answers 400; skipped");
}

TEST(EventRelay, BackoffDoublesOrFollowsRetryAfter) {
  ScriptedPoster poster(std::vector<absl::Status>(5, absl::UnavailableError("busy")));
  std::vector<std::string> logged;
  EventRelay::Options options = quick();
  options.max_wait = absl::Milliseconds(4);
  EventRelay relay(poster, options,
                   [&](LogLevel, const std::string& line) { logged.push_back(line); });
  poster.before_answer = [&](std::size_t posts) {
    poster.asked = posts == 2 ? absl::Milliseconds(9) : absl::ZeroDuration();
    if (posts == 3) poster.asked = absl::Hours(1);  // longer than the limit
  };
  EXPECT_TRUE(relay.forward(event(v1::Event::KIND_JOB_DONE, 4)).ok());
  const std::string busy = "event 4 (job done): busy; retrying in ";
  EXPECT_EQ(logged,
            (std::vector<std::string>{busy + "1ms", busy + "9ms", busy + "40ms", busy + "4ms",
                                      busy + "4ms", "the receiver accepts events again"}));
}

TEST(EventRelay, PassesSelectedKindsOnly) {
  ScriptedPoster poster({});
  EventRelay all(poster, quick(), no_log);
  EXPECT_TRUE(all.forward(event(v1::Event::KIND_LOG_LINE, 1)).ok());
  EXPECT_TRUE(all.forward(event(v1::Event::KIND_UNIT_FAILED, 2)).ok());
  EventRelay::Options some = quick();
  some.events = {"job done", "job failed"};
  EventRelay chosen(poster, some, no_log);
  EXPECT_TRUE(chosen.forward(event(v1::Event::KIND_JOB_RUNNING, 3)).ok());
  EXPECT_TRUE(chosen.forward(event(v1::Event::KIND_JOB_FAILED, 4)).ok());
  ASSERT_EQ(poster.posted.size(), 2);
  EXPECT_EQ(poster.posted[0]["sequence"], 2);
  EXPECT_EQ(poster.posted[1]["sequence"], 4);
}

TEST(EventRelay, PersistsLastSequence) {
  const std::string file = fresh_file();
  ScriptedPoster poster({});
  EventRelay relay(poster, quick(file), no_log);
  EXPECT_EQ(*relay.last_sequence(), std::nullopt);
  EXPECT_TRUE(relay.forward(event(v1::Event::KIND_JOB_DONE, 1LL << 41)).ok());
  EXPECT_EQ(**EventRelay(poster, quick(file), no_log).last_sequence(), 1LL << 41);
  for (const char* content : {"", "seven\n", "-3\n"}) {
    std::ofstream(file) << content;
    EXPECT_TRUE(absl::IsInvalidArgument(relay.last_sequence().status())) << content;
  }
}

TEST(EventRelay, UnacceptedEventIsNotPersisted) {
  const std::string file = fresh_file();
  ScriptedPoster poster(std::vector<absl::Status>(10'000, absl::UnavailableError("busy")));
  EventRelay relay(poster, quick(file), no_log);
  poster.before_answer = [&](std::size_t posts) {
    if (posts == 3) relay.cancel();
  };
  EXPECT_TRUE(absl::IsCancelled(relay.forward(event(v1::Event::KIND_JOB_DONE, 4))));
  EXPECT_EQ(poster.posted.size(), 3);
  EXPECT_FALSE(std::filesystem::exists(file));
}

}  // namespace
}  // namespace tessera::client
