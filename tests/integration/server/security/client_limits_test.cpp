#include "server/service/quotas/client_limits.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <thread>
#include <vector>

#include "absl/strings/str_cat.h"
#include "tests/integration/server/support/secure_farm.h"

namespace tessera::server {
namespace {

using std::chrono::milliseconds;
using std::chrono::minutes;

const ClientLimits::Time start_time{std::chrono::hours(1000)};

ClientQuotas quotas_of(double calls, double upload_bytes) {
  ClientQuota quota;
  quota.calls = calls;
  quota.upload_gb = upload_bytes / 1e9;
  return {quota, {}};
}

TEST(ClientLimits, CallRateIsLimitedPerClient) {
  ClientLimits limits(quotas_of(50, 0));
  int taken = 0;
  for (int ms = 0; ms < 60'000; ms += 10) {  // 100 per second, for a minute
    taken += limits.count_call("ann", start_time + milliseconds(ms)).ok() ? 1 : 0;
  }
  EXPECT_NEAR(taken, 50 + 3000, 2);  // a burst of 50, then 50 per second
  const ClientLimits::Time end = start_time + milliseconds(59'995);
  EXPECT_TRUE(absl::IsResourceExhausted(limits.count_call("ann", end)));
  EXPECT_TRUE(limits.count_call("bob", end).ok());
  EXPECT_TRUE(limits.count_call("ann", end + minutes(1)).ok());
}

TEST(ClientLimits, LowRateAllowsTenCallsAtOnce) {
  ClientLimits limits(quotas_of(1, 0));
  for (int i = 0; i < 10; ++i) EXPECT_TRUE(limits.count_call("ann", start_time).ok()) << i;
  EXPECT_TRUE(absl::IsResourceExhausted(limits.count_call("ann", start_time)));
  EXPECT_DOUBLE_EQ(limits.used("ann", quota_kind(&ClientQuota::calls), start_time), 1);
}

TEST(ClientLimits, RefusedClientKeepsItsRate) {
  constexpr milliseconds kCall{1}, kLongestPause{800};  // of the refusal and the client together
  ClientLimits limits(quotas_of(100, 0));
  int taken = 0;
  for (milliseconds now{0}; now < minutes(1);) {
    const bool is_taken = limits.count_call("ann", start_time + now).ok();
    taken += is_taken ? 1 : 0;
    now += is_taken ? kCall : kLongestPause;
  }
  // The burst, and the rate, but for what came free in a pause at the end.
  EXPECT_GE(taken, 100 + 60 * 100 - 81);
}

TEST(ClientLimits, UploadedBytesAreLimitedPerHour) {
  ClientLimits limits(quotas_of(0, 3600));  // a byte per second
  EXPECT_TRUE(limits.count_upload("ann", 3000, start_time).ok());
  EXPECT_TRUE(absl::IsResourceExhausted(limits.count_upload("ann", 1000, start_time)));
  EXPECT_TRUE(limits.count_upload("bob", 3600, start_time).ok());
  EXPECT_TRUE(absl::IsResourceExhausted(limits.count_upload("ann", 1000, start_time + minutes(6))));
  EXPECT_TRUE(limits.count_upload("ann", 1000, start_time + minutes(7)).ok());
  EXPECT_TRUE(
      absl::IsResourceExhausted(limits.count_upload("bob", 3601, start_time + minutes(600))));
}

TEST(ClientLimits, ZeroMeansUnlimited) {
  ClientLimits limits(quotas_of(0, 0));
  for (int i = 0; i < 10'000; ++i) EXPECT_TRUE(limits.count_call("ann", start_time).ok());
  EXPECT_TRUE(limits.count_upload("ann", std::int64_t{1} << 50, start_time).ok());
}

TEST(ClientLimits, ClosedStreamFreesItsReservation) {
  ClientLimits limits;
  std::vector<std::shared_ptr<const void>> reservations;
  for (int i = 0; i < 8; ++i) reservations.push_back(*limits.reserve_stream("ann", false));
  EXPECT_TRUE(absl::IsResourceExhausted(limits.reserve_stream("ann", false).status()));
  EXPECT_TRUE(limits.reserve_stream("bob", false).ok());
  reservations.pop_back();
  EXPECT_TRUE(limits.reserve_stream("ann", false).ok());
}

class GreedyClient : public SecureFarm {
 protected:
  GreedyClient() { quotas_ = quotas_of(1, static_cast<double>(2 * sizeof kScene - 4)); }
};

TEST_F(GreedyClient, ExcessCallsOfOneClientAreRefused) {
  const auto ann = channel("ann");
  std::atomic<int> refused = 0;
  std::vector<std::thread> callers;  // a refusal is answered late
  for (int i = 0; i < 40; ++i) {
    callers.emplace_back([&] {
      refused += try_call(ann).error_code() == grpc::StatusCode::RESOURCE_EXHAUSTED ? 1 : 0;
    });
  }
  for (std::thread& caller : callers) caller.join();
  EXPECT_GE(refused, 20);
  EXPECT_TRUE(try_call("bob").ok());
  EXPECT_TRUE(try_call("root").ok());
}

TEST_F(GreedyClient, RefusalOfExcessCallIsAnsweredLate) {
  const auto ann = channel("ann");
  grpc::Status status;
  auto begun = std::chrono::steady_clock::now();
  for (int i = 0; i < 40 && status.ok(); ++i) {
    begun = std::chrono::steady_clock::now();
    status = try_call(ann);
  }
  EXPECT_EQ(status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_GE(std::chrono::steady_clock::now() - begun, milliseconds(250));  // 0.25 to 0.75 s
  EXPECT_EQ(status.error_message().find("quota calls: client ann is limited to 1 calls per"), 0u);
  EXPECT_NE(status.error_message().find(" calls per second and would use 1."), std::string::npos)
      << status.error_message();
}

TEST_F(GreedyClient, ExcessUploadsAreRefused) {
  EXPECT_TRUE(upload_scene("ann").ok());
  EXPECT_TRUE(upload_scene("ann").ok()) << "uploading an existing asset is free";
  const std::string other(sizeof kScene - 1, 'x');
  EXPECT_EQ(upload("ann", other).error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_TRUE(upload("bob", other).ok());
}

TEST_F(SecureFarm, PriorityAboveMaximumNeedsAdmin) {
  for (const char* name : {"ann", "root"}) {
    ASSERT_TRUE(upload_scene(name).ok());
    for (const int priority : {50, 51}) {
      v1::CreateJobRequest request = request_of(absl::StrCat(name, "-", priority));
      request.set_priority(priority);
      v1::CreateJobResponse response;
      const grpc::Status status = create(name, request, response);
      const bool is_refused = std::string(name) == "ann" && priority > 50;
      EXPECT_EQ(status.error_code(),
                is_refused ? grpc::StatusCode::PERMISSION_DENIED : grpc::StatusCode::OK)
          << name << " " << priority << ": " << status.error_message();
    }
  }
}

/// Opens connections that send nothing, or only the start of a handshake.
TEST_F(SecureFarm, SilentConnectionsDoNotBlockClients) {
  const std::string address = server_->address();
  sockaddr_in where{};
  where.sin_family = AF_INET;
  where.sin_port =
      htons(static_cast<std::uint16_t>(std::stoi(address.substr(address.rfind(':') + 1))));
  where.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  std::vector<int> silent;
  for (int i = 0; i < 300; ++i) {
    silent.push_back(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
    ASSERT_EQ(::connect(silent.back(), reinterpret_cast<const sockaddr*>(&where), sizeof where), 0);
    if (i % 2 == 0) {
      ASSERT_EQ(::write(silent.back(), "\x16\x03\x01", 3), 3);  // the start of a TLS ClientHello
    }
  }
  const auto begun = std::chrono::steady_clock::now();
  EXPECT_TRUE(try_call("ann").ok());
  EXPECT_LT(std::chrono::steady_clock::now() - begun, std::chrono::seconds(20));
  for (const int socket : silent) ::close(socket);
}

}  // namespace
}  // namespace tessera::server
