#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "telemetry/metrics/listener.h"

namespace tessera {
namespace {

std::vector<prometheus::MetricFamily> nothing() {
  return {};
}

/// Returns the answer to GET `path`.
std::string get(const std::string& address, const std::string& path) {
  const int socket = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in peer{};
  peer.sin_family = AF_INET;
  peer.sin_port =
      htons(static_cast<std::uint16_t>(std::stoi(address.substr(address.find(':') + 1))));
  peer.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  std::string answer;
  if (::connect(socket, reinterpret_cast<const sockaddr*>(&peer), sizeof peer) == 0) {
    const std::string request = "GET " + path + " HTTP/1.0\r\n\r\n";
    ::send(socket, request.data(), request.size(), 0);
    char buffer[4096];
    for (ssize_t count = 0; (count = ::recv(socket, buffer, sizeof buffer, 0)) > 0;) {
      answer.append(buffer, static_cast<std::size_t>(count));
    }
  }
  ::close(socket);
  return answer;
}

TEST(MetricsListener, ProbesAnswerWithReason) {
  std::string fault;
  const auto listener =
      MetricsListener::start("127.0.0.1:0", nothing, {[] { return ""; }, [&] { return fault; }});
  ASSERT_TRUE(listener.ok()) << listener.status();
  const std::string address = (*listener)->address();
  EXPECT_TRUE(absl::StartsWith(get(address, "/livez"), "HTTP/1.1 200 "));
  EXPECT_TRUE(absl::StartsWith(get(address, "/readyz"), "HTTP/1.1 200 "));
  fault = "the disk is away";
  const std::string answer = get(address, "/readyz");
  EXPECT_TRUE(absl::StartsWith(answer, "HTTP/1.1 503 ")) << answer;
  EXPECT_TRUE(absl::EndsWith(answer, "\r\n\r\nthe disk is away\n")) << answer;
  EXPECT_TRUE(absl::StrContains(get(address, "/metrics"), "text/plain; version=0.0.4"));
  EXPECT_TRUE(absl::StrContains(get(address, "/"), " 404 ")) << get(address, "/");
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
