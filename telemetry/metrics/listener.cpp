#include "telemetry/metrics/listener.h"

#include <prometheus/collectable.h>
#include <prometheus/exposer.h>

#include <exception>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "rpc/channel.h"

namespace tessera {
namespace {

class Collector final : public prometheus::Collectable {
 public:
  explicit Collector(MetricsListener::Collect collect) : collect_(std::move(collect)) {}
  std::vector<prometheus::MetricFamily> Collect() const override { return collect_(); }

 private:
  const MetricsListener::Collect collect_;
};

class HttpListener final : public MetricsListener {
 public:
  /// Throws CivetWeb's exception if it cannot listen.
  HttpListener(const std::string& host, const std::string& port, Collect collect)
      : collector_(std::make_shared<Collector>(std::move(collect))),
        exposer_(absl::StrCat(host == "localhost" ? "127.0.0.1" : host, ":", port)),
        address_(absl::StrCat(host, ":", exposer_.GetListeningPorts().at(0))) {
    exposer_.RegisterCollectable(collector_);
  }

  const std::string& address() const override { return address_; }

 private:
  const std::shared_ptr<Collector> collector_;  // owners: this; the exposer looks it up
  prometheus::Exposer exposer_;
  const std::string address_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<MetricsListener>> MetricsListener::start(const std::string& address,
                                                                        Collect collect) {
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
    return std::make_unique<HttpListener>(address.substr(0, colon), port, std::move(collect));
  } catch (const std::exception&) {  // CivetWeb's, without a reason
    return absl::UnavailableError(
        absl::StrCat("--metrics ", address, ": cannot listen (port in use?)"));
  }
}

}  // namespace tessera
