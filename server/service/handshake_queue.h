#pragma once

#include <sys/socket.h>
#include <sys/types.h>

#include <chrono>
#include <cstddef>
#include <map>
#include <string>
#include <vector>

namespace tessera::server {

/// Accepted connections that wait for their TLS handshake, and those in it.
///
/// A handshake takes milliseconds of CPU time, and a client gives up after seconds. If thousands
/// that connect at once were all served at once, none would be in time, and all would try again.
/// So only kPlaces are in it at a time. The addresses of waiting connections take turns, and one
/// address has at most half of the places, so that a flood from one does not hold up the others.
/// Not thread-safe.
class HandshakeQueue {
 public:
  using Time = std::chrono::steady_clock::time_point;
  static constexpr std::size_t kPlaces = 256;
  /// Time after which a handshake frees its place. At most 128 a second can begin beyond those that
  /// end, which is less than one core serves.
  static constexpr std::chrono::milliseconds kPlaceTime{2000};
  /// A client that has sent so many bytes has sent its certificate, so that most of the work is
  /// done. Its first message has 250 to 520 bytes; larger ones, with keys against quantum
  /// computers, free their places early.
  static constexpr std::size_t kHandshakeBytes = 1000;

  struct Connection {
    int listener = -1, socket = -1;
    sockaddr_storage peer{};
  };

  HandshakeQueue() = default;
  ~HandshakeQueue();  // closes the waiting connections
  HandshakeQueue(const HandshakeQueue&) = delete;
  HandshakeQueue& operator=(const HandshakeQueue&) = delete;

  void add(const Connection& connection);
  /// Takes the connections out of the queue for which there are places, of each address the
  /// youngest first: those that have waited for long would not be in time. Closes connections that
  /// their clients have given up.
  std::vector<Connection> admit(Time now);
  /// Closes the youngest waiting connection of the address that has most. Returns whether there was
  /// one.
  bool drop_one();
  bool empty() const { return waiting_.empty(); }

 private:
  struct Place {
    int socket = -1;
    std::string address;
    Time since;
  };
  std::size_t places_of(const std::string& address) const;

  // By address, without the port; of IPv6, the /64 network, because a host may use all of it.
  std::map<std::string, std::vector<Connection>> waiting_;  // oldest first; no empty ones
  std::vector<Place> places_;
  std::string last_admitted_;  // address
};

}  // namespace tessera::server
