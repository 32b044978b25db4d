#include "telemetry/metrics/listener.h"

#include <CivetServer.h>
#include <prometheus/text_serializer.h>

#include <exception>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "rpc/channel.h"

namespace tessera {
namespace {

constexpr char kTextFormat[] = "text/plain; version=0.0.4; charset=utf-8";

/// Answers GET with a status and a text.
class Page final : public CivetHandler {
 public:
  struct Answer {
    int status = 200;
    const char* type = "text/plain; charset=utf-8";
    std::string text;
  };
  explicit Page(std::function<Answer()> answer) : answer_(std::move(answer)) {}

  bool handleGet(CivetServer* /*server*/, mg_connection* connection) override {
    const Answer answer = answer_();
    mg_printf(connection,
              "HTTP/1.1 %d %s\r\nContent-Type: %s\r\nContent-Length: %zu\r\n"
              "Cache-Control: no-store\r\nConnection: close\r\n\r\n",
              answer.status, mg_get_response_code_text(connection, answer.status), answer.type,
              answer.text.size());
    mg_write(connection, answer.text.data(), answer.text.size());
    return true;
  }

 private:
  const std::function<Answer()> answer_;
};

Page::Answer answer_of(const MetricsListener::Probe& probe) {
  Page::Answer answer;
  const std::string fault = probe();
  if (!fault.empty()) answer.status = 503;
  answer.text = (fault.empty() ? "ok" : fault) + "\n";
  return answer;
}

class HttpListener final : public MetricsListener {
 public:
  /// Throws CivetWeb's exception if it cannot listen.
  HttpListener(const std::string& host, const std::string& port, Collect collect, Probes probes)
      : server_(std::vector<std::string>{
            "listening_ports", absl::StrCat(host == "localhost" ? "127.0.0.1" : host, ":", port),
            "num_threads", "2"}),
        address_(absl::StrCat(host, ":", server_.getListeningPorts().at(0))) {
    add("/metrics", [collect = std::move(collect)] {
      return Page::Answer{200, kTextFormat, prometheus::TextSerializer().Serialize(collect())};
    });
    if (probes.live) add("/livez", [probe = std::move(probes.live)] { return answer_of(probe); });
    if (probes.ready)
      add("/readyz", [probe = std::move(probes.ready)] { return answer_of(probe); });
  }

  const std::string& address() const override { return address_; }

 private:
  void add(const std::string& path, std::function<Page::Answer()> answer) {
    pages_.push_back(std::make_unique<Page>(std::move(answer)));
    server_.addHandler(path + "$", pages_.back().get());
  }

  std::vector<std::unique_ptr<Page>> pages_;  // outlive the server's threads
  CivetServer server_;
  const std::string address_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<MetricsListener>> MetricsListener::start(const std::string& address,
                                                                        Collect collect,
                                                                        Probes probes) {
  const std::size_t colon = address.rfind(':');
  const std::string port = colon == std::string::npos ? "" : address.substr(colon + 1);
  if (absl::StartsWith(address, "unix:") || !contract::is_local_address(address) || port.empty() ||
      port.find_first_not_of("0123456789") != std::string::npos) {
    return absl::InvalidArgumentError(absl::StrCat(
        "--metrics ", address,
        ": must be a loopback address, 127.0.0.1:PORT or [::1]:PORT, because ",
        "metrics are served without a password; run Prometheus or an authenticating proxy on this "
        "machine"));
  }
  try {
    return std::make_unique<HttpListener>(address.substr(0, colon), port, std::move(collect),
                                          std::move(probes));
  } catch (const std::exception&) {  // CivetWeb's, without a reason
    return absl::UnavailableError(
        absl::StrCat("--metrics ", address, ": cannot listen (port in use?)"));
  }
}

}  // namespace tessera
