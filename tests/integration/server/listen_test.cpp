#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <thread>

#include "server/service/access/token.h"
#include "server/service/server.h"
#include "tests/support/memory_store/memory_store.h"
#include "tests/support/scratch_folder.h"

namespace tessera::server {
namespace {

class ListenTest : public testing::Test {
 protected:
  void SetUp() override {
    options_.clock = [this] { return std::chrono::steady_clock::now() + offset_.load(); };
    options_.wall_us = [] { return std::int64_t{0}; };
    options_.random = [] { return std::uint64_t{1}; };
    coordinator_ = Coordinator::open(store_, options_).value();
  }
  absl::StatusOr<std::unique_ptr<FarmServer>> listen(const std::string& address) {
    return FarmServer::start(*coordinator_, {address, folder_, ""});
  }

  /// Returns whether the server serves `service`, by the gRPC health protocol, as soon as it says
  /// so.
  static bool becomes(const std::shared_ptr<grpc::Channel>& channel, const std::string& service,
                      bool is_serving) {
    for (int attempt = 0; attempt < 100; ++attempt) {
      if (is_served(channel, service) == is_serving) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
    return false;
  }
  /// Calls Health.Check with the bytes of its messages, for which Debian has no generated code.
  static bool is_served(const std::shared_ptr<grpc::Channel>& channel, const std::string& service) {
    grpc::GenericStub stub(channel);
    grpc::CompletionQueue queue;
    grpc::ClientContext context;
    const grpc::Slice request("\x0a" + std::string(1, static_cast<char>(service.size())) + service);
    const auto call = stub.PrepareUnaryCall(&context, "/grpc.health.v1.Health/Check",
                                            grpc::ByteBuffer(&request, 1), &queue);
    call->StartCall();
    grpc::ByteBuffer response;
    grpc::Status status;
    call->Finish(&response, &status, nullptr);
    void* tag = nullptr;
    bool ok = false;
    queue.Next(&tag, &ok);
    grpc::Slice bytes;
    if (!status.ok() || !response.DumpToSingleSlice(&bytes).ok()) return false;
    const std::string_view text(reinterpret_cast<const char*>(bytes.begin()), bytes.size());
    return text == "\x08\x01";  // SERVING
  }

  std::atomic<std::chrono::seconds> offset_{std::chrono::seconds(0)};
  ScratchFolder scratch_;
  const std::string& folder_ = scratch_.path();
  MemoryStore store_{folder_};
  FarmOptions options_;
  std::unique_ptr<Coordinator> coordinator_;
};

TEST_F(ListenTest, InsecurePublicAddressIsRefused) {
  for (const char* address : {"0.0.0.0:0", "192.168.1.7:7411", "[::]:0", "example.org:80", "*:0"}) {
    const auto server = listen(address);
    EXPECT_TRUE(absl::IsInvalidArgument(server.status())) << address;
    EXPECT_NE(server.status().message().find("tessera-server init-certs"), std::string::npos);
  }
}

TEST_F(ListenTest, ReportsPortAndCreatesPrivateToken) {
  const auto server = listen("127.0.0.1:0");
  ASSERT_TRUE(server.ok()) << server.status();
  EXPECT_NE((*server)->address(), "127.0.0.1:0");
  struct stat info {};
  ASSERT_EQ(::stat((folder_ + "/token").c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777u, 0600u);
  const std::string token = load_or_create_token(folder_ + "/token").value();
  EXPECT_EQ(token.size(), 64u);
  EXPECT_EQ(load_or_create_token(folder_ + "/token").value(), token) << "it is kept";
}

TEST_F(ListenTest, ReadableTokenFileIsRefused) {
  ASSERT_TRUE(load_or_create_token(folder_ + "/token").ok());
  std::filesystem::permissions(folder_ + "/token", std::filesystem::perms::others_read,
                               std::filesystem::perm_options::add);
  EXPECT_TRUE(absl::IsPermissionDenied(listen("127.0.0.1:0").status()));
}

TEST_F(ListenTest, PortInUseIsRefused) {
  const auto first = listen("127.0.0.1:0");
  ASSERT_TRUE(first.ok()) << first.status();
  const absl::Status second = listen((*first)->address()).status();
  EXPECT_TRUE(absl::IsUnavailable(second)) << second;
  EXPECT_NE(second.message().find((*first)->address()), std::string::npos) << second;
  EXPECT_NE(second.message().find("in use"), std::string::npos) << second;
}

TEST_F(ListenTest, HostNameIsResolved) {
  const auto server = listen("localhost:0");
  ASSERT_TRUE(server.ok()) << server.status();
  const std::string port = (*server)->address().substr((*server)->address().rfind(':'));
  const auto channel = grpc::CreateChannel("127.0.0.1" + port, grpc::InsecureChannelCredentials());
  EXPECT_TRUE(
      channel->WaitForConnected(std::chrono::system_clock::now() + std::chrono::seconds(20)));
}

TEST_F(ListenTest, HealthFollowsSignsOfLife) {
  const auto server = listen("unix:" + folder_ + "/s");
  ASSERT_TRUE(server.ok()) << server.status();
  const auto channel =
      grpc::CreateChannel((*server)->address(), grpc::InsecureChannelCredentials());
  for (const char* service : {"", "liveness", "readiness"}) {
    EXPECT_TRUE(becomes(channel, service, true)) << service;
  }
  EXPECT_FALSE(is_served(channel, "other"));
  offset_ = Health::kWriterLimit + std::chrono::seconds(2);
  coordinator_->tick();  // the timer runs, the writer does not
  EXPECT_TRUE(becomes(channel, "readiness", false));
  EXPECT_TRUE(becomes(channel, "", false));
  EXPECT_TRUE(is_served(channel, "liveness"));
  while (coordinator_->run_writer(false)) {
  }
  EXPECT_TRUE(becomes(channel, "readiness", true));
  offset_ = 2 * (Health::kWriterLimit + Health::kTimerLimit);
  EXPECT_TRUE(becomes(channel, "liveness", false));
  EXPECT_NE(coordinator_->health().why_dead(), "");
  (*server)->stop();
  EXPECT_EQ(coordinator_->health().why_unready().find("timer"), 4u);
}

TEST_F(ListenTest, UnixSocketNeedsPrivateFolder) {
  EXPECT_TRUE(listen("unix:" + folder_ + "/s").ok());
  std::filesystem::permissions(folder_, std::filesystem::perms::others_exec,
                               std::filesystem::perm_options::add);
  EXPECT_TRUE(absl::IsPermissionDenied(listen("unix:" + folder_ + "/s").status()));
  EXPECT_TRUE(absl::IsUnavailable(listen("unix:/no/such/folder/s").status()));
}

}  // namespace
}  // namespace tessera::server
