// HttpPoster over real sockets, against a scripted receiver.
#include "webhook/http_poster.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstdlib>
#include <future>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"

namespace tessera::client {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

/// Accepts one loopback connection after another and answers each request with the next of the
/// answers; after the last one it sends nothing.
class Receiver {
 public:
  explicit Receiver(std::vector<std::string> answers) : answers_(std::move(answers)) {
    ::unsetenv("http_proxy");  // libcurl would use it as a proxy
    listener_ = ::socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    EXPECT_EQ(::bind(listener_, reinterpret_cast<sockaddr*>(&address), size), 0);
    ::listen(listener_, 4);
    ::getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size);
    port_ = ntohs(address.sin_port);
    thread_ = std::thread([this] { serve(); });
  }
  ~Receiver() {
    ::shutdown(listener_, SHUT_RDWR);
    if (const int connection = connection_; connection >= 0) ::shutdown(connection, SHUT_RDWR);
    thread_.join();
    ::close(listener_);
  }
  Receiver(const Receiver&) = delete;
  Receiver& operator=(const Receiver&) = delete;

  std::string url() const { return absl::StrCat("http://127.0.0.1:", port_, "/hook?key=hush"); }
  /// Complete requests; read them after all posts have ended.
  const std::vector<std::string>& requests() const { return requests_; }
  int connections() const { return connections_; }

 private:
  void serve() {
    while (true) {
      const int connection = ::accept(listener_, nullptr, nullptr);
      if (connection < 0) return;
      connection_ = connection;
      ++connections_;
      while (answer_one(connection)) {
      }
      connection_ = -1;
      ::close(connection);
    }
  }

  /// Reads a request and answers it; returns false when the peer has closed.
  bool answer_one(int connection) {
    std::string request;
    std::size_t body_at = std::string::npos, length = 0;
    while (body_at == std::string::npos || request.size() < body_at + length) {
      char buffer[4096];
      const ssize_t size = ::read(connection, buffer, sizeof buffer);
      if (size <= 0) return false;
      request.append(buffer, static_cast<std::size_t>(size));
      const std::size_t end = request.find("\r\n\r\n");
      const std::size_t at = request.find("Content-Length: ");
      if (end == std::string::npos || at == std::string::npos) continue;
      body_at = end + 4;
      length = std::stoul(request.substr(at + std::string("Content-Length: ").size()));
    }
    requests_.push_back(request);
    if (answered_ == answers_.size()) return true;  // waits until the peer closes
    const std::string answer =
        absl::StrCat("HTTP/1.1 ", answers_[answered_++], "\r\nContent-Length: 0\r\n\r\n");
    return ::write(connection, answer.data(), answer.size()) > 0;
  }

  std::vector<std::string> answers_, requests_;
  std::size_t answered_ = 0;
  int listener_ = -1;
  std::atomic<int> connection_ = -1, connections_ = 0;
  std::uint16_t port_ = 0;
  std::thread thread_;
};

std::unique_ptr<HttpPoster> poster_to(const Receiver& receiver, const std::string& secret = "",
                                      absl::Duration request_timeout = absl::Seconds(30)) {
  return *HttpPoster::create({receiver.url(), secret, request_timeout});
}

std::string body_of(const std::string& request) {
  return request.substr(request.find("\r\n\r\n") + 4);
}

TEST(HttpPoster, PostsSignedDocumentsOverOneConnection) {
  Receiver receiver({"200 OK", "204 No Content"});
  const auto poster = poster_to(receiver, "Jefe");
  // RFC 4231, case 2.
  EXPECT_TRUE(poster->post("what do ya want for nothing?").ok());
  EXPECT_TRUE(poster->post("{}").ok());
  ASSERT_EQ(receiver.requests().size(), 2);
  const std::string& first = receiver.requests()[0];
  EXPECT_TRUE(absl::StartsWith(first, "POST /hook?key=hush HTTP/1.1\r\n")) << first;
  EXPECT_TRUE(absl::StrContains(first, "Content-Type: application/json\r\n"));
  EXPECT_TRUE(absl::StrContains(
      first,
      "Tessera-Signature: "
      "sha256=5bdcc146bf60754e6a042426089575c75a003f089d2739839dec58b964ec3843\r\n"));
  EXPECT_EQ(body_of(first), "what do ya want for nothing?");
  EXPECT_EQ(body_of(receiver.requests()[1]), "{}");
  EXPECT_EQ(receiver.connections(), 1);
}

TEST(HttpPoster, WithoutSecretSendsNoSignature) {
  Receiver receiver({"200 OK"});
  EXPECT_TRUE(poster_to(receiver)->post("{}").ok());
  EXPECT_FALSE(absl::StrContains(receiver.requests()[0], "Tessera-Signature"));
}

TEST(HttpPoster, ClassifiesRetryableStatusCodes) {
  for (const char* answer : {"408 Request Timeout", "425 Too Early", "429 Too Many Requests",
                             "500 Internal Server Error", "503 Service Unavailable"}) {
    Receiver receiver({answer});
    const absl::Status status = poster_to(receiver)->post("{}");
    EXPECT_TRUE(absl::IsUnavailable(status)) << answer << ": " << status;
    EXPECT_FALSE(absl::StrContains(status.message(), "hush")) << "the address's secret is shown";
    EXPECT_TRUE(absl::StrContains(status.message(), "http://127.0.0.1:")) << status;
  }
  for (const char* answer : {"400 Bad Request", "404 Not Found", "410 Gone"}) {
    Receiver receiver({answer});
    const absl::Status status = poster_to(receiver)->post("{}");
    EXPECT_TRUE(absl::IsFailedPrecondition(status)) << answer << ": " << status;
  }
}

TEST(HttpPoster, DoesNotFollowRedirects) {
  Receiver other({"200 OK"});
  Receiver receiver({absl::StrCat("307 Temporary Redirect\r\nLocation: ", other.url())});
  EXPECT_TRUE(absl::IsFailedPrecondition(poster_to(receiver)->post("{}")));
  EXPECT_TRUE(other.requests().empty());
}

TEST(HttpPoster, ParsesRetryAfter) {
  const std::string busy = "429 Too Many Requests\r\nRetry-After: 7";
  auto receiver = std::make_unique<Receiver>(std::vector<std::string>{busy, "200 OK", busy});
  const auto poster = poster_to(*receiver);
  EXPECT_FALSE(poster->post("{}").ok());
  EXPECT_EQ(poster->retry_after(), absl::Seconds(7));
  EXPECT_TRUE(poster->post("{}").ok());
  EXPECT_EQ(poster->retry_after(), absl::ZeroDuration());
  EXPECT_FALSE(poster->post("{}").ok());
  receiver.reset();
  EXPECT_FALSE(poster->post("{}").ok());
  EXPECT_EQ(poster->retry_after(), absl::ZeroDuration()) << "nobody was asked";
}

TEST(HttpPoster, TimesOut) {
  Receiver receiver({});
  const auto start = steady_clock::now();
  EXPECT_TRUE(absl::IsUnavailable(poster_to(receiver, "", absl::Milliseconds(200))->post("{}")));
  EXPECT_LT(steady_clock::now() - start, std::chrono::seconds(20));
}

TEST(HttpPoster, RefusedConnectionIsUnavailable) {
  const auto poster = *HttpPoster::create({"http://127.0.0.1:1/hush", ""});
  EXPECT_TRUE(absl::IsUnavailable(poster->post("{}")));
}

TEST(HttpPoster, CancelEndsPendingPost) {
  Receiver receiver({});
  const auto poster = poster_to(receiver);
  auto posted = std::async(std::launch::async, [&] { return poster->post("{}"); });
  std::this_thread::sleep_for(milliseconds(100));
  poster->cancel();
  ASSERT_EQ(posted.wait_for(std::chrono::seconds(20)), std::future_status::ready);
  EXPECT_TRUE(absl::IsCancelled(posted.get()));
  EXPECT_TRUE(absl::IsCancelled(poster->post("{}")));
}

TEST(HttpPoster, RejectsNonHttpAddresses) {
  for (const char* url : {"ftp://host/", "file:///etc/passwd", "no address", ""}) {
    EXPECT_TRUE(absl::IsInvalidArgument(HttpPoster::create({url, ""}).status())) << url;
  }
}

}  // namespace
}  // namespace tessera::client
