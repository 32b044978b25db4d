// The queue of connections before their handshake, with TCP connections over loopback.
#include "server/service/handshake_queue.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <unistd.h>

#include <string>
#include <vector>

namespace tessera::server {
namespace {

constexpr std::size_t kHalf = HandshakeQueue::kPlaces / 2;

class Handshakes : public ::testing::Test {
 protected:
  Handshakes() : listener_(::socket(AF_INET, SOCK_STREAM, 0)) {
    address_.sin_family = AF_INET;
    address_.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(::bind(listener_, generic(), sizeof address_), 0);
    socklen_t size = sizeof address_;
    EXPECT_EQ(::getsockname(listener_, reinterpret_cast<sockaddr*>(&address_), &size), 0);
    EXPECT_EQ(::listen(listener_, SOMAXCONN), 0);
  }
  ~Handshakes() override {
    for (const int client : clients_) ::close(client);
    for (const auto& connection : admitted_) ::close(connection.socket);
    ::close(listener_);
  }

  /// Adds a connection that claims to come from `address`; returns its client's end.
  int connect(const std::string& address = "10.0.0.1") {
    const int client = open_client();
    add(address);
    return client;
  }
  int open_client() {
    const int client = ::socket(AF_INET, SOCK_STREAM, 0);
    EXPECT_EQ(::connect(client, generic(), sizeof address_), 0);
    clients_.push_back(client);
    return client;
  }
  void add(const std::string& address) {
    sockaddr_storage peer{};
    if (auto& ip4 = reinterpret_cast<sockaddr_in&>(peer);
        ::inet_pton(AF_INET, address.c_str(), &ip4.sin_addr) == 1) {
      peer.ss_family = AF_INET;
    } else {
      peer.ss_family = AF_INET6;
      auto& ip6 = reinterpret_cast<sockaddr_in6&>(peer);
      EXPECT_EQ(::inet_pton(AF_INET6, address.c_str(), &ip6.sin6_addr), 1);
    }
    added_.push_back(::accept(listener_, nullptr, nullptr));
    queue_.add({listener_, added_.back(), peer});
  }
  void connect_many(std::size_t count, const std::string& address) {
    for (std::size_t i = 0; i < count; ++i) connect(address);
  }
  std::size_t admit(std::chrono::milliseconds after = std::chrono::milliseconds(0)) {
    const auto admitted = queue_.admit(HandshakeQueue::Time(std::chrono::hours(1000)) + after);
    admitted_.insert(admitted_.end(), admitted.begin(), admitted.end());
    return admitted.size();
  }
  std::size_t admitted_of(const char* address) const {
    std::size_t count = 0;
    for (const auto& connection : admitted_) {
      const auto& peer = reinterpret_cast<const sockaddr_in&>(connection.peer);
      count += peer.sin_addr.s_addr == ::inet_addr(address) ? 1 : 0;
    }
    return count;
  }
  void send(int client, std::size_t byte_count) {
    const std::string bytes(byte_count, 'x');
    EXPECT_EQ(::send(client, bytes.data(), bytes.size(), 0), static_cast<ssize_t>(bytes.size()));
  }

  HandshakeQueue queue_;
  std::vector<int> added_;  // sockets
  std::vector<HandshakeQueue::Connection> admitted_;

 private:
  const sockaddr* generic() const { return reinterpret_cast<const sockaddr*>(&address_); }

  int listener_;
  sockaddr_in address_{};
  std::vector<int> clients_;
};

TEST_F(Handshakes, OneAddressHasHalfOfThePlaces) {
  connect_many(kHalf + 10, "10.0.0.1");
  EXPECT_EQ(admit(), kHalf);
  EXPECT_EQ(admit(), 0u);
  connect_many(3, "10.0.0.2");
  EXPECT_EQ(admit(), 3u) << "the first address does not hold up the second";
}

TEST_F(Handshakes, AddressesTakeTurns) {
  connect_many(kHalf, "10.0.0.1");
  connect_many(kHalf, "10.0.0.2");
  connect_many(kHalf, "10.0.0.3");
  EXPECT_EQ(admit(), HandshakeQueue::kPlaces);
  EXPECT_NEAR(static_cast<double>(admitted_of("10.0.0.3")), HandshakeQueue::kPlaces / 3.0, 1);
}

TEST_F(Handshakes, NetworkOfIpv6HostIsOneAddress) {
  connect_many(kHalf, "2001:db8::1");
  connect_many(1, "2001:db8::2");
  EXPECT_EQ(admit(), kHalf);
  connect_many(1, "2001:db8:0:1::1");
  EXPECT_EQ(admit(), 1u);
}

TEST_F(Handshakes, SentCertificateFreesPlace) {
  const int first = connect(), second = connect();
  connect_many(kHalf - 2, "10.0.0.1");
  ASSERT_EQ(admit(), kHalf);
  connect_many(2, "10.0.0.1");
  EXPECT_EQ(admit(), 0u);
  send(first, HandshakeQueue::kHandshakeBytes);
  EXPECT_EQ(admit(), 1u);
  send(second, HandshakeQueue::kHandshakeBytes - 1);
  EXPECT_EQ(admit(), 0u);
  send(second, 1);
  EXPECT_EQ(admit(), 1u);
}

TEST_F(Handshakes, YoungestBeginsFirst) {
  connect_many(kHalf + 1, "10.0.0.1");
  admit();
  EXPECT_EQ(admitted_.front().socket, added_.back());
  EXPECT_EQ(admitted_.back().socket, added_[1]);
}

TEST_F(Handshakes, SilentOneFreesItsPlaceAfterTime) {
  connect_many(kHalf + 1, "10.0.0.1");
  ASSERT_EQ(admit(), kHalf);
  EXPECT_EQ(admit(HandshakeQueue::kPlaceTime - std::chrono::milliseconds(1)), 0u);
  EXPECT_EQ(admit(HandshakeQueue::kPlaceTime), 1u);
}

TEST_F(Handshakes, EndedOneFreesItsPlace) {
  connect_many(kHalf, "10.0.0.1");
  ASSERT_EQ(admit(), kHalf);
  open_client();
  const int socket = admitted_.back().socket;
  ::close(socket);
  admitted_.pop_back();
  add("10.0.0.1");  // has the number of the closed one
  EXPECT_EQ(admit(), 1u);
  EXPECT_EQ(admitted_.back().socket, socket);
}

TEST_F(Handshakes, ClientThatHasGivenUpIsNotServed) {
  const int first = connect();
  connect();
  ::shutdown(first, SHUT_RDWR);
  EXPECT_EQ(admit(), 1u);
  EXPECT_TRUE(queue_.empty());
}

TEST_F(Handshakes, OneOfTheBusiestAddressIsDropped) {
  connect_many(3, "10.0.0.1");
  connect_many(2, "10.0.0.2");
  EXPECT_TRUE(queue_.drop_one());
  EXPECT_EQ(admit(), 4u);
  EXPECT_EQ(admitted_of("10.0.0.1"), 2u);
  EXPECT_FALSE(queue_.drop_one());
}

}  // namespace
}  // namespace tessera::server
