// Consumers of events with a cursor.
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "rpc/channel.h"
#include "server/service/access/access.h"
#include "server/service/job_service.h"
#include "tests/support/memory_store/memory_store.h"
#include "tests/support/scratch_folder.h"

namespace tessera::server {
namespace {

class NoConnection final : public WorkerConnection {
 public:
  void wake() override {}
  void close(const absl::Status& /*reason*/) override {}
};

class EventCursor : public testing::Test {
 protected:
  void SetUp() override { start(); }
  void TearDown() override { stop(); }
  void start() {
    stop();
    store_.controls().reboot();
    FarmOptions options;
    options.clock = [] { return std::chrono::steady_clock::now(); };
    options.wall_us = [] { return std::int64_t{0}; };
    coordinator_ = Coordinator::open(store_, options).value();
    access_ = std::make_unique<Access>("");
    jobs_ = std::make_unique<JobService>(*coordinator_, *access_);
    grpc::ServerBuilder builder;
    builder.RegisterService(jobs_.get());
    server_ = builder.BuildAndStart();
  }
  void stop() {
    if (server_) server_->Shutdown(std::chrono::system_clock::now());
    server_.reset();
    jobs_.reset();
    coordinator_.reset();
  }
  /// Lets a worker connect so many times; each is an event.
  void happen(int count) {
    Hello hello;
    hello.worker_id = hello.name = "w";
    for (int i = 0; i < count; ++i) {
      coordinator_->workers().join(hello, std::make_shared<NoConnection>());
      while (coordinator_->run_writer(false) || coordinator_->run_answers(false)) {
      }
    }
  }
  grpc::Status read(std::int64_t after, std::vector<std::int64_t>& sequences) {
    grpc::ClientContext context;
    contract::prepare_call(context, "", std::chrono::seconds(20));
    v1::WatchEventsRequest request;
    request.set_after_sequence(after);
    const auto stream =
        v1::JobService::NewStub(server_->InProcessChannel({}))->WatchEvents(&context, request);
    v1::WatchEventsResponse response;
    while (stream->Read(&response)) {
      for (const v1::Event& event : response.events()) sequences.push_back(event.sequence());
    }
    return stream->Finish();
  }

  ScratchFolder folder_;
  MemoryStore store_{folder_.path()};
  std::unique_ptr<Coordinator> coordinator_;
  std::unique_ptr<Access> access_;
  std::unique_ptr<JobService> jobs_;
  std::unique_ptr<grpc::Server> server_;
};

TEST_F(EventCursor, SeesEachEventOnceOverRestart) {
  constexpr std::size_t kCount = EventLog::kMaxEvents + 500;
  happen(static_cast<int>(kCount));
  for (const bool is_restarted : {false, true}) {
    if (is_restarted) start();
    std::vector<std::int64_t> all;
    ASSERT_TRUE(read(0, all).ok());
    ASSERT_EQ(all.size(), kCount) << "the oldest are in the store only";
    for (std::size_t i = 1; i < all.size(); ++i) ASSERT_LT(all[i - 1], all[i]);
    std::vector<std::int64_t> rest;
    ASSERT_TRUE(read(all[300], rest).ok());
    EXPECT_EQ(rest, std::vector<std::int64_t>(all.begin() + 301, all.end()));
    rest.clear();
    ASSERT_TRUE(read(all[kCount - 2], rest).ok());
    EXPECT_EQ(rest, std::vector<std::int64_t>{all.back()});
  }
}

TEST_F(EventCursor, TooOldAndTooNewAreErrors) {
  store_.events().keep(50);
  happen(120);
  std::vector<std::int64_t> all;
  ASSERT_TRUE(read(0, all).ok());
  const std::int64_t dropped = store_.events().last_dropped();
  std::vector<std::int64_t> none;
  const grpc::Status old = read(dropped - 1, none);
  EXPECT_EQ(old.error_code(), grpc::StatusCode::DATA_LOSS);
  EXPECT_NE(old.error_message().find("no longer kept"), std::string::npos);
  EXPECT_TRUE(none.empty());
  std::vector<std::int64_t> kept;
  ASSERT_TRUE(read(dropped, kept).ok());
  EXPECT_EQ(kept.size(), 50u);
  EXPECT_EQ(read(kept.back() + 1, none).error_code(), grpc::StatusCode::OUT_OF_RANGE);
}

TEST_F(EventCursor, FollowerGetsEventsAtOnce) {
  grpc::ClientContext context;
  contract::prepare_call(context, "", std::chrono::seconds(20));
  v1::WatchEventsRequest request;
  request.set_follow(true);
  const auto stream =
      v1::JobService::NewStub(server_->InProcessChannel({}))->WatchEvents(&context, request);
  v1::WatchEventsResponse response;
  for (int i = 0; i < 5; ++i) {
    happen(1);
    const auto since = std::chrono::steady_clock::now();
    ASSERT_TRUE(stream->Read(&response));
    // Without being woken it looks once a second.
    const auto delay = std::chrono::steady_clock::now() - since;
    EXPECT_TRUE(i == 0 || delay < std::chrono::milliseconds(500)) << "event " << i;
    std::this_thread::sleep_for(std::chrono::milliseconds(150));  // it waits again
  }
  context.TryCancel();
  EXPECT_FALSE(stream->Read(&response));
  stream->Finish();
}

TEST_F(EventCursor, FollowersMissNothingOnBusyFarm) {
  constexpr int kFollowers = 8, kCount = 3000;
  std::vector<std::vector<std::int64_t>> seen(kFollowers);
  std::vector<std::thread> followers;
  for (auto& sequences : seen) {
    followers.emplace_back([&] {
      grpc::ClientContext context;
      contract::prepare_call(context, "", std::chrono::seconds(60));
      v1::WatchEventsRequest request;
      request.set_follow(true);
      const auto stream =
          v1::JobService::NewStub(server_->InProcessChannel({}))->WatchEvents(&context, request);
      v1::WatchEventsResponse response;
      while (sequences.size() < kCount && stream->Read(&response)) {
        for (const v1::Event& event : response.events()) sequences.push_back(event.sequence());
      }
      context.TryCancel();
      stream->Finish();
    });
  }
  happen(kCount);
  for (std::thread& follower : followers) follower.join();
  std::vector<std::int64_t> all;
  ASSERT_TRUE(read(0, all).ok());
  ASSERT_EQ(all.size(), static_cast<std::size_t>(kCount));
  for (const auto& sequences : seen) EXPECT_EQ(sequences, all);
}

}  // namespace
}  // namespace tessera::server
