// The worker's two streams against a fake server, over a real socket.
#include "worker/agent/server/server_connection.h"

#include <grpcpp/server.h>
#include <grpcpp/server_builder.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "rpc/channel.h"

namespace tessera::agent {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

/// Scripted server that records requests.
class FakeServer : public v1::WorkerService::Service {
 public:
  std::string store_id = "store";
  milliseconds timeout{60'000};
  std::atomic<bool> plays_dead = false;
  grpc::Status refusal;               // of Work, before Welcome
  std::atomic<int> replacements = 0;  // streams that end after Welcome, replaced by a newer one

  grpc::Status Work(grpc::ServerContext* context,
                    grpc::ServerReaderWriter<v1::WorkResponse, v1::WorkRequest>* stream) override {
    v1::WorkRequest request;
    if (!stream->Read(&request)) return grpc::Status::OK;
    note([&] { hellos.push_back(request.hello()); });
    if (!refusal.ok()) return refusal;
    v1::WorkResponse welcome;
    welcome.mutable_welcome()->set_store_id(store_id);
    welcome.mutable_welcome()->mutable_heartbeat_interval()->set_nanos(50'000'000);
    *welcome.mutable_welcome()->mutable_timeout() = duration();
    note([&] {
      stream->Write(welcome);
      work_ = {context, stream};
    });
    if (replacements-- > 0) {
      note([&] { work_ = {}; });
      return {grpc::StatusCode::ABORTED, "replaced by a newer stream"};
    }
    while (stream->Read(&request)) {
      note([&] { requests.push_back(request); });
    }
    note([&] { work_ = {}; });
    return grpc::Status::OK;
  }

  grpc::Status Deliver(grpc::ServerContext*, grpc::ServerReader<v1::DeliverRequest>* stream,
                       v1::DeliverResponse*) override {
    v1::DeliverRequest request;
    std::string worker;
    v1::BlockHeader header;
    std::string bytes;
    while (stream->Read(&request)) {
      if (worker.empty()) worker = request.worker_id();
      for (const v1::BlockPart& part : request.parts()) {
        if (part.has_header()) header = part.header();
        bytes += part.chunk();
        EXPECT_LE(part.chunk().size(), 65536u);
        if (static_cast<std::int64_t>(bytes.size()) < header.size_bytes()) continue;
        note([&] { blocks.push_back({worker, header, std::exchange(bytes, {})}); });
      }
    }
    return grpc::Status::OK;
  }

  /// Answers unless the test makes the server unresponsive.
  grpc::Status DescribeJob(grpc::ServerContext* context, const v1::DescribeJobRequest*,
                           v1::DescribeJobResponse*) override {
    while (plays_dead && !context->IsCancelled()) std::this_thread::sleep_for(milliseconds(5));
    return {grpc::StatusCode::NOT_FOUND, "no such job"};
  }

  /// Sends a response on the open Work stream.
  void send(const v1::WorkResponse& response) {
    const std::lock_guard lock(mutex);
    ASSERT_NE(work_.second, nullptr);
    work_.second->Write(response);
  }
  void break_work() {
    const std::lock_guard lock(mutex);
    if (work_.first != nullptr) work_.first->TryCancel();
  }
  bool has_work() {
    const std::lock_guard lock(mutex);
    return work_.first != nullptr;
  }

  struct Block {
    std::string worker;
    v1::BlockHeader header;
    std::string bytes;
  };
  std::mutex mutex;  // guards what follows
  std::vector<v1::WorkerHello> hellos;
  std::vector<v1::WorkRequest> requests;
  std::vector<Block> blocks;

 private:
  template <typename Change>
  void note(const Change& change) {
    const std::lock_guard lock(mutex);
    change();
  }
  google::protobuf::Duration duration() const {
    google::protobuf::Duration span;
    span.set_seconds(timeout.count() / 1000);
    span.set_nanos(static_cast<int>(timeout.count() % 1000) * 1'000'000);
    return span;
  }
  std::pair<grpc::ServerContext*, grpc::ServerReaderWriter<v1::WorkResponse, v1::WorkRequest>*>
      work_ = {};
};

class ServerConnectionTest : public testing::Test {
 protected:
  ServerConnectionTest() {
    std::string name = std::filesystem::temp_directory_path() / "tessera-link-XXXXXX";
    folder_ = ::mkdtemp(name.data());
    address_ = "unix:" + folder_ + "/s";
    start_server();
    channel_ = *contract::open_channel(address_, "");
    server_channel_ = std::make_unique<ServerChannel>(channel_);
  }

  ~ServerConnectionTest() override {
    if (connection_) {
      connection_->cancel();
      run_until([this] { return connection_->closed(); });
    }
    stop_server();
    std::filesystem::remove_all(folder_);
  }

  void start_server() {
    grpc::ServerBuilder builder;
    builder.AddListeningPort(address_, grpc::InsecureServerCredentials());
    builder.RegisterService(&fake_);
    server_ = builder.BuildAndStart();
    ASSERT_NE(server_, nullptr);
  }
  void stop_server() {
    if (server_) server_->Shutdown(std::chrono::system_clock::now());
    server_.reset();
  }

  void open(const ServerConnection::Options& options = {}) {
    ServerConnection::Callbacks callbacks;
    callbacks.hello = [] {
      v1::WorkerHello hello;
      hello.set_worker_id("worker");
      return hello;
    };
    callbacks.window = [] { return CreditWindow{4, 4}; };
    callbacks.rss_bytes = [] { return std::int64_t{123}; };
    callbacks.on_response = [this](const v1::WorkResponse& response) {
      for (const auto& lease : response.leases().leases()) queue_.add_lease(lease);
      for (const auto& verdict : response.acknowledgements().acknowledgements()) {
        queue_.acknowledge(key_of(verdict.unit()));
      }
    };
    callbacks.refused = [this](const absl::Status& status) { refused_ = status; };
    connection_ = std::make_unique<ServerConnection>(*server_channel_, options, queue_, event_loop_,
                                                     std::move(callbacks));
  }

  /// Runs the agent's loop until `done` (called under the fake server's lock) returns true or 20 s
  /// have passed.
  bool run_until(const std::function<bool()>& done) {
    const Time limit = Clock::now() + seconds(20);
    while (Clock::now() < limit) {
      connection_->pump(Clock::now());
      {
        const std::lock_guard lock(fake_.mutex);
        if (done()) return true;
      }
      event_loop_.run_until(std::min(Clock::now() + milliseconds(20), connection_->next_due()));
    }
    return false;
  }

  void lease_and_render(std::int32_t tile, const std::string& block) {
    v1::Lease lease;
    lease.set_job_id("job");
    lease.set_first_tile(tile);
    lease.set_tile_count(1);
    lease.set_seal("seal");
    queue_.add_lease(lease);
    queue_.start(key(tile));
    queue_.finish(key(tile), block, contract::sha256(block), 0.25);
  }
  static UnitKey key(std::int32_t tile) { return {"job", {0, tile, 0}}; }

  v1::WorkResponse verdict(std::int32_t tile) {
    v1::WorkResponse response;
    auto* entry = response.mutable_acknowledgements()->add_acknowledgements();
    *entry->mutable_unit() = id_of(key(tile));
    entry->set_status(v1::Acknowledgement::ACK_STATUS_COMMITTED);
    return response;
  }

  FakeServer fake_;
  std::string folder_, address_;
  std::unique_ptr<grpc::Server> server_;
  std::shared_ptr<grpc::Channel> channel_;
  std::unique_ptr<ServerChannel> server_channel_;
  UnitQueue queue_;
  EventLoop event_loop_;
  absl::Status refused_;
  std::unique_ptr<ServerConnection> connection_;
};

TEST_F(ServerConnectionTest, HeartbeatsNameStartedUnits) {
  open();
  queue_.set_store("store");
  ASSERT_TRUE(run_until([this] { return fake_.hellos.size() == 1; }));
  v1::Lease lease;
  lease.set_job_id("job");
  lease.set_tile_count(1);
  ASSERT_TRUE(run_until([this] { return connection_->connected(); }));
  queue_.add_lease(lease);
  queue_.start(key(0));
  EXPECT_TRUE(run_until([this] {
    for (const v1::WorkRequest& request : fake_.requests) {
      if (request.heartbeat().started_size() == 1 && request.heartbeat().rss_bytes() == 123 &&
          key_of(request.heartbeat().started(0)) == key(0)) {
        return true;
      }
    }
    return false;
  }));
  EXPECT_EQ(fake_.hellos[0].credit_count(), 4);
}

TEST_F(ServerConnectionTest, BlocksOfAnySizeArriveWhole) {
  open();
  ASSERT_TRUE(run_until([this] { return connection_->connected(); }));
  const std::vector<std::string> blocks = {std::string(100, 'a'), std::string(200'000, 'b'),
                                           std::string(65'536, 'c'), std::string(5, 'd'),
                                           std::string(65'537, 'e')};
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    lease_and_render(static_cast<std::int32_t>(i), blocks[i]);
  }
  ASSERT_TRUE(run_until([&] { return fake_.blocks.size() == blocks.size(); }));
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    const FakeServer::Block& block = fake_.blocks[i];
    EXPECT_EQ(block.worker, "worker");
    EXPECT_EQ(block.header.tile(), static_cast<std::int32_t>(i));
    EXPECT_EQ(block.header.lease().seal(), "seal");
    EXPECT_EQ(block.header.cpu_seconds(), 0.25);
    EXPECT_EQ(block.bytes, blocks[i]);
    EXPECT_EQ(block.header.sha256(), contract::sha256(blocks[i]).binary());
  }
}

TEST_F(ServerConnectionTest, ResendsUnacknowledgedBlocks) {
  open();
  ASSERT_TRUE(run_until([this] { return connection_->connected(); }));
  lease_and_render(0, "first");
  lease_and_render(1, "second");
  ASSERT_TRUE(run_until([this] { return fake_.blocks.size() == 2; }));
  fake_.send(verdict(0));
  ASSERT_TRUE(run_until([this] { return queue_.size() == 1; }));
  fake_.break_work();
  ASSERT_TRUE(run_until([this] { return fake_.blocks.size() == 3; }));
  EXPECT_EQ(fake_.blocks[2].bytes, "second");
  ASSERT_EQ(fake_.hellos.size(), 2u);
  ASSERT_EQ(fake_.hellos[1].unacknowledged_size(), 1);
  EXPECT_EQ(key_of(fake_.hellos[1].unacknowledged(0)), key(1));
  EXPECT_EQ(fake_.hellos[1].store_id(), "store");
  ASSERT_EQ(fake_.hellos[1].leases_size(), 1);
}

TEST_F(ServerConnectionTest, RestartedServerGetsBlocks) {
  open();
  ASSERT_TRUE(run_until([this] { return connection_->connected(); }));
  stop_server();
  ASSERT_TRUE(run_until([this] { return !connection_->connected(); }));
  lease_and_render(0, "rendered while nobody was there");
  start_server();
  ASSERT_TRUE(run_until([this] { return fake_.blocks.size() == 1; }));
  EXPECT_EQ(fake_.blocks[0].bytes, "rendered while nobody was there");
}

TEST_F(ServerConnectionTest, BlockOfOtherStoreIsDropped) {
  open();
  ASSERT_TRUE(run_until([this] { return connection_->connected(); }));
  stop_server();
  ASSERT_TRUE(run_until([this] { return !connection_->connected(); }));
  lease_and_render(0, "old");
  fake_.store_id = "another";
  start_server();
  ASSERT_TRUE(run_until([this] { return connection_->connected(); }));
  EXPECT_TRUE(queue_.empty());
}

TEST_F(ServerConnectionTest, ReconnectsAfterDeadServer) {
  fake_.timeout = milliseconds(500);
  fake_.plays_dead = true;
  open();
  EXPECT_TRUE(run_until([this] { return fake_.hellos.size() >= 2; }));
  fake_.plays_dead = false;
}

TEST_F(ServerConnectionTest, ProbeKeepsIdleServer) {
  fake_.timeout = milliseconds(3'000);  // half of it is more than a busy machine delays a thread
  open();
  const Time end = Clock::now() + milliseconds(7'000);  // more than twice the limit
  ASSERT_TRUE(run_until([end] { return Clock::now() > end; }));
  EXPECT_EQ(fake_.hellos.size(), 1u);
}

TEST_F(ServerConnectionTest, RefusalIsFinal) {
  fake_.refusal = {grpc::StatusCode::FAILED_PRECONDITION, "other numerics"};
  open();
  ASSERT_TRUE(run_until([this] { return !refused_.ok(); }));
  EXPECT_EQ(std::string(refused_.message()), "other numerics");
  EXPECT_EQ(fake_.hellos.size(), 1u);
}

TEST_F(ServerConnectionTest, ReplacedStreamReconnects) {
  fake_.replacements = 1;  // by the late Hello of an earlier stream of this process
  open();
  ASSERT_TRUE(run_until([this] { return fake_.hellos.size() == 2 && connection_->connected(); }));
  EXPECT_TRUE(refused_.ok()) << refused_;
}

TEST_F(ServerConnectionTest, TwiceReplacedIsRefused) {
  fake_.replacements = 2;  // by another process with this ID
  open();
  ASSERT_TRUE(run_until([this] { return !refused_.ok(); }));
  EXPECT_TRUE(absl::IsAborted(refused_)) << refused_;
  EXPECT_NE(refused_.message().find("another process uses the worker ID"), std::string::npos);
  EXPECT_EQ(fake_.hellos.size(), 2u);
}

TEST_F(ServerConnectionTest, EndedCertificateIsAwaited) {
  fake_.refusal = {grpc::StatusCode::UNAUTHENTICATED, "the certificate has expired"};
  ServerConnection::Options options;
  options.awaits_certificate = [] { return true; };
  open(options);
  ASSERT_TRUE(run_until([this] { return fake_.hellos.size() == 2; })) << "it tries again";
  EXPECT_TRUE(refused_.ok());
}

TEST_F(ServerConnectionTest, SendsFaultHookBlocks) {
  ServerConnection::Options options;
  options.blocks_to_send = [](const UnitQueue::Block& block) { return std::vector{block, block}; };
  open(options);
  ASSERT_TRUE(run_until([this] { return connection_->connected(); }));
  lease_and_render(0, std::string(70'000, 'x'));
  ASSERT_TRUE(run_until([this] { return fake_.blocks.size() == 2; }));
  EXPECT_EQ(fake_.blocks[0].bytes, fake_.blocks[1].bytes);
}

TEST_F(ServerConnectionTest, AcknowledgementGivesCredits) {
  open();
  ASSERT_TRUE(run_until([this] { return connection_->connected(); }));
  v1::WorkResponse leases;
  auto* lease = leases.mutable_leases()->add_leases();
  lease->set_job_id("job");
  lease->set_tile_count(4);
  fake_.send(leases);
  ASSERT_TRUE(run_until([this] { return queue_.size() == 4; }));
  queue_.start(key(2));
  queue_.finish(key(2), "block", contract::sha256("block"), 0);
  ASSERT_TRUE(run_until([this] { return fake_.blocks.size() == 1; }));
  fake_.send(verdict(2));
  EXPECT_TRUE(run_until([this] {
    int granted = 0;
    for (const v1::WorkRequest& request : fake_.requests) granted += request.credits().unit_count();
    return granted == 1;
  }));
}

}  // namespace
}  // namespace tessera::agent
