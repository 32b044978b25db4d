// The table of connections, over pairs of sockets in place of accepted ones.
#include "server/service/quotas/client_connections.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <unistd.h>

#include <array>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"

namespace tessera::server {
namespace {

using std::chrono::milliseconds;

const ClientConnections::Time first_time{std::chrono::hours(1000)};

class ConnectionCount : public ::testing::Test {
 protected:
  ~ConnectionCount() override {
    for (const auto& pair : pairs_) {
      for (const int end : pair) ::close(end);
    }
  }

  /// Adds a connection from a port of 10.0.0.1; returns its number, for close_end().
  std::size_t accept(int port, milliseconds age = milliseconds(0)) {
    std::array<int, 2> pair{};
    EXPECT_EQ(::socketpair(AF_UNIX, SOCK_STREAM, 0, pair.data()), 0);
    pairs_.push_back(pair);
    sockaddr_storage peer{};
    auto& address = reinterpret_cast<sockaddr_in&>(peer);
    address.sin_family = AF_INET;
    ::inet_pton(AF_INET, "10.0.0.1", &address.sin_addr);
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    connections_.add(pair[0], peer, first_time - age);
    return pairs_.size() - 1;
  }
  std::size_t use(const std::string& client, int port, double limit) {
    return connections_.use(client, absl::StrCat("ipv4:10.0.0.1:", port), limit, first_time);
  }
  void close_end(std::size_t number) {
    ::close(pairs_[number][0]);
    pairs_[number][0] = ::dup(STDERR_FILENO);  // the number names another file
  }
  bool is_open(std::size_t number) const {
    char byte = 0;
    return ::recv(pairs_[number][1], &byte, 1, MSG_DONTWAIT) != 0;
  }

  ClientConnections connections_;
  std::vector<std::array<int, 2>> pairs_;
};

TEST_F(ConnectionCount, EachClientIsCountedApart) {
  for (const int port : {1, 2, 3, 4}) accept(port);
  EXPECT_EQ(use("ann", 1, 2), 1u);
  EXPECT_EQ(use("ann", 1, 2), 0u) << "counted before";
  EXPECT_EQ(use("ann", 2, 2), 2u);
  EXPECT_EQ(use("ann", 3, 2), 3u) << "over the limit";
  EXPECT_EQ(use("bob", 4, 2), 1u);
  EXPECT_EQ(use("ann", 9, 2), 0u) << "an unknown one";
  EXPECT_EQ(connections_.count("ann"), 2u);
  EXPECT_EQ(connections_.count("carl"), 0u);
}

TEST_F(ConnectionCount, ReusedDescriptorIsNotCounted) {
  const std::size_t first = accept(1);
  accept(2);
  use("ann", 1, 1);
  close_end(first);
  EXPECT_EQ(connections_.count("ann"), 0u);
  EXPECT_EQ(use("ann", 2, 1), 1u);
}

TEST_F(ConnectionCount, RefusedOneIsCutAfterItsAnswer) {
  const std::size_t first = accept(1), second = accept(2);
  use("ann", 1, 1);
  EXPECT_EQ(use("ann", 2, 1), 2u);
  EXPECT_EQ(connections_.cut_refused(first_time + milliseconds(499)), 0u);
  EXPECT_TRUE(is_open(second));
  EXPECT_EQ(connections_.cut_refused(first_time + milliseconds(500)), 1u);
  EXPECT_FALSE(is_open(second));
  EXPECT_TRUE(is_open(first));
}

TEST_F(ConnectionCount, RefusedOneMayTakeFreedPlace) {
  const std::size_t first = accept(1), second = accept(2);
  use("ann", 1, 1);
  use("ann", 2, 1);
  close_end(first);
  EXPECT_EQ(use("ann", 2, 1), 1u);
  EXPECT_EQ(connections_.cut_refused(first_time + milliseconds(5000)), 0u);
  EXPECT_TRUE(is_open(second));
}

TEST_F(ConnectionCount, OldestSilentOneIsCut) {
  const std::size_t used = accept(1, milliseconds(9000)), old = accept(2, milliseconds(8000)),
                    younger = accept(3, milliseconds(7000)), fresh = accept(4, milliseconds(1000));
  use("tessera://worker/w1", 1, 0);
  EXPECT_TRUE(connections_.cut_silent(first_time));
  EXPECT_FALSE(is_open(old));
  EXPECT_TRUE(is_open(younger));
  EXPECT_TRUE(connections_.cut_silent(first_time));
  EXPECT_FALSE(connections_.cut_silent(first_time));
  EXPECT_TRUE(is_open(used));
  EXPECT_TRUE(is_open(fresh)) << "it may be in its handshake";
}

TEST_F(ConnectionCount, AddressesHaveTheFormOfPeers) {
  std::array<int, 2> pair{};
  ASSERT_EQ(::socketpair(AF_UNIX, SOCK_STREAM, 0, pair.data()), 0);
  pairs_.push_back(pair);
  for (const auto& [text, peer] :
       {std::pair("::1", "ipv6:%5B::1%5D:7"), std::pair("fe80::1", "ipv6:%5Bfe80::1%25eth0%5D:7"),
        std::pair("::ffff:10.0.0.2", "ipv4:10.0.0.2:7")}) {
    sockaddr_storage address{};
    auto& ip6 = reinterpret_cast<sockaddr_in6&>(address);
    ip6.sin6_family = AF_INET6;
    ip6.sin6_port = htons(7);
    ASSERT_EQ(::inet_pton(AF_INET6, text, &ip6.sin6_addr), 1);
    connections_.add(pair[0], address, first_time);
    EXPECT_EQ(connections_.use("ann", peer, 1, first_time), 1u) << peer;
  }
}

}  // namespace
}  // namespace tessera::server
