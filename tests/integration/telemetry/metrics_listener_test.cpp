#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "telemetry/metrics/listener.h"

namespace tessera {
namespace {

std::vector<prometheus::MetricFamily> nothing() {
  return {};
}

TEST(MetricsListener, NonLoopbackAddressIsRefused) {
  for (const std::string address :
       {"0.0.0.0:0", "[::]:0", "192.0.2.1:0", "farm.example:0", "127.example:0", ":0",
        "unix:/tmp/metrics", "unix:/tmp/metrics:0"}) {
    const auto listener = MetricsListener::start(address, nothing);
    EXPECT_TRUE(absl::IsInvalidArgument(listener.status())) << address;
    EXPECT_TRUE(absl::StrContains(listener.status().message(), "127.0.0.1:PORT")) << address;
  }
}

TEST(MetricsListener, InvalidPortIsRefused) {
  for (const std::string address : {"localhost", "127.0.0.1:", "127.0.0.1:http", "127.0.0.1:1,0"}) {
    EXPECT_FALSE(MetricsListener::start(address, nothing).ok()) << address;
  }
}

TEST(MetricsListener, ReportsPortAndRefusesBusyOne) {
  const auto first = MetricsListener::start("localhost:0", nothing);
  ASSERT_TRUE(first.ok()) << first.status();
  const std::string address = (*first)->address();
  EXPECT_TRUE(absl::StartsWith(address, "localhost:"));
  EXPECT_FALSE(absl::EndsWith(address, ":0"));
  const auto second = MetricsListener::start(address, nothing);
  EXPECT_TRUE(absl::IsUnavailable(second.status())) << second.status();
}

}  // namespace
}  // namespace tessera
