#include "server/service/server.h"

#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/health_check_service_interface.h>
#include <sys/stat.h>

#include <algorithm>
#include <chrono>
#include <ctime>
#include <filesystem>
#include <optional>
#include <thread>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/synchronization/notification.h"
#include "absl/time/time.h"
#include "rpc/certificates/certificate_dates.h"
#include "rpc/channel.h"
#include "rpc/credentials.h"
#include "server/identity/authority.h"
#include "server/identity/join_tokens.h"
#include "server/service/accept_gate.h"
#include "server/service/access/access.h"
#include "server/service/access/token.h"
#include "server/service/access/worker_admission.h"
#include "server/service/asset_service.h"
#include "server/service/certificate_service.h"
#include "server/service/farm_service.h"
#include "server/service/job_service.h"
#include "server/service/quotas/call_context.h"
#include "server/service/worker_service.h"

namespace tessera::server {
namespace {

constexpr std::chrono::milliseconds kShutdownGrace{300};
constexpr absl::Duration kHealthPeriod = absl::Milliseconds(500);  // also of cutting streams
constexpr int kRenewalRetryS = 60;
constexpr std::chrono::seconds kExpiryPeriod{60};  // of looking when the certificate expires
constexpr char kUnixPrefix[] = "unix:";
/// A connection that has not finished its handshakes by then is closed.
constexpr int kHandshakeTimeoutMs = 10'000;
/// A connection without a call is closed; the next call opens another.
constexpr int kIdleTimeoutMs = 300'000;
/// After this time no new call is taken on a connection, so that callers use a certificate that has
/// been replaced. Calls in progress continue.
constexpr int kMaxAgeMs = 300'000;
// A peer that does not answer a ping has gone, and its calls end.
constexpr int kKeepalivePeriodMs = 10'000, kKeepaliveTimeoutMs = 20'000;
constexpr int kMinPingPeriodMs = 500;  // of clients' own pings; see rpc/channel.cpp

/// A socket is protected by its directory, which other users must not be able to enter.
absl::Status check_socket_folder(const std::string& address) {
  const std::filesystem::path path(address.substr(sizeof kUnixPrefix - 1));
  const std::string folder = path.has_parent_path() ? path.parent_path().string() : ".";
  struct stat info {};
  if (::stat(folder.c_str(), &info) != 0 || !S_ISDIR(info.st_mode)) {
    return absl::UnavailableError(absl::StrCat(folder, ": no such directory for the socket"));
  }
  if ((info.st_mode & (S_IRWXG | S_IRWXO)) != 0) {
    return absl::PermissionDeniedError(
        absl::StrCat(folder, " can be entered by other users; set its mode to 0700"));
  }
  return absl::OkStatus();
}

void limit_connections(grpc::ServerBuilder& builder) {
  builder.AddChannelArgument(GRPC_ARG_SERVER_HANDSHAKE_TIMEOUT_MS, kHandshakeTimeoutMs);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONNECTION_IDLE_MS, kIdleTimeoutMs);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONNECTION_AGE_MS, kMaxAgeMs);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, kKeepalivePeriodMs);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, kKeepaliveTimeoutMs);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS,
                             kMinPingPeriodMs);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MAX_PING_STRIKES, 0);  // no maximum
}

/// Credentials and access rules of the listening address.
struct Endpoint {
  std::shared_ptr<grpc::ServerCredentials> credentials;
  Access access;
  std::optional<JoinTokens> join_tokens;
  std::string certs = {};  // directory of the certificates; empty: none
};

absl::StatusOr<Endpoint> unix_socket_endpoint(const std::string& address) {
  if (absl::Status status = check_socket_folder(address); !status.ok()) return status;
  return Endpoint{grpc::InsecureServerCredentials(), Access(""), std::nullopt};
}

absl::StatusOr<Endpoint> tls_endpoint(Coordinator& coordinator, const ListenOptions& options) {
  auto credentials = contract::server_credentials(options.certs);
  if (!credentials.ok()) return credentials.status();
  FarmMetrics& metrics = coordinator.farm().metrics();
  return Endpoint{*std::move(credentials),
                  Access(std::make_unique<Revocations>(options.certs + "/revoked"), options.quotas,
                         [&metrics](const QuotaKind& kind) { metrics.quota_refused(kind.name); }),
                  JoinTokens(options.store), options.certs};
}

absl::StatusOr<Endpoint> loopback_endpoint(const ListenOptions& options) {
  if (!contract::is_local_address(options.address)) {
    return absl::InvalidArgumentError(absl::StrCat(
        "--listen ", options.address, ": other machines can reach this address, so it needs ",
        "certificates: create them with `tessera-server init-certs certs --host ",
        "NAME-OR-IP-OF-THIS-MACHINE` and add --certs certs"));
  }
  auto token = load_or_create_token(absl::StrCat(options.store, "/token"));
  if (!token.ok()) return token.status();
  return Endpoint{grpc::InsecureServerCredentials(), Access(*std::move(token)), std::nullopt};
}

absl::StatusOr<Endpoint> make_endpoint(Coordinator& coordinator, const ListenOptions& options) {
  if (absl::StartsWith(options.address, kUnixPrefix)) return unix_socket_endpoint(options.address);
  return options.certs.empty() ? loopback_endpoint(options) : tls_endpoint(coordinator, options);
}

class GrpcFarmServer final : public FarmServer {
 public:
  GrpcFarmServer(Coordinator& coordinator, Endpoint endpoint, Log log)
      : health_(coordinator.health()),
        metrics_(coordinator.farm().metrics()),
        log_(std::move(log)),
        credentials_(std::move(endpoint.credentials)),
        certs_(std::move(endpoint.certs)),
        access_(std::move(endpoint.access)),
        admission_(coordinator, std::move(endpoint.join_tokens)),
        jobs_(coordinator, access_),
        assets_(coordinator, access_),
        workers_(coordinator, access_, admission_),
        farm_(coordinator, access_),
        certificates_(access_, certs_) {}

  ~GrpcFarmServer() override { stop(); }

  absl::Status listen(const std::string& address) {
    grpc::EnableDefaultHealthCheckService(true);
    grpc::reflection::InitProtoReflectionServerBuilderPlugin();
    grpc::ServerBuilder builder;
    std::unique_ptr<AcceptGate::Acceptor> acceptor;
    const bool is_unix = absl::StartsWith(address, kUnixPrefix);
    if (is_unix) {
      builder.AddListeningPort(address, credentials_);
    } else {
      auto gate = AcceptGate::bind(address);
      if (!gate.ok()) return gate.status();
      gate_ = *std::move(gate);
      using Type = grpc::ServerBuilder::experimental_type::ExternalConnectionType;
      acceptor = builder.experimental().AddExternalConnectionAcceptor(Type::FROM_FD, credentials_);
    }
    if (!is_unix) limit_connections(builder);
    builder.SetMaxReceiveMessageSize(contract::kMaxMessageBytes);
    builder.SetMaxSendMessageSize(contract::kMaxMessageBytes);
    builder.AddChannelArgument(GRPC_ARG_MAX_CONCURRENT_STREAMS, calls_per_connection());
    builder.AddChannelArgument(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
    builder.SetContextAllocator(std::make_unique<CallContexts>());
    builder.RegisterService(&jobs_);
    builder.RegisterService(&assets_);
    builder.RegisterService(&workers_);
    builder.RegisterService(&farm_);
    builder.RegisterService(&certificates_);
    server_ = builder.BuildAndStart();
    if (!server_) {
      return absl::UnavailableError(absl::StrCat("cannot listen on ", address, ": is it in use?"));
    }
    health_.set_accepting(true);
    watcher_ = std::thread([this] { watch_over(); });
    address_ = address;
    if (gate_ != nullptr) {
      address_ = absl::StrCat(address.substr(0, address.rfind(':')), ":", gate_->port());
      gate_->start(std::move(acceptor), access_.connections(),
                   [log = log_](const std::string& text) { log(LogLevel::warn, text); });
    }
    return absl::OkStatus();
  }

  const std::string& address() const override { return address_; }

  void stop() override {
    if (!server_) return;
    health_.set_accepting(false);
    stopping_.Notify();
    watcher_.join();
    gate_.reset();
    server_->Shutdown(std::chrono::system_clock::now() + kShutdownGrace);
    server_.reset();
  }

 private:
  /// Returns how many calls a connection may have in progress: as many as any client's streams, so
  /// that a client needs only one.
  int calls_per_connection() const {
    constexpr double kLeast = 8, kMost = 100;
    if (access_.limits() == nullptr) return static_cast<int>(kLeast);
    const double streams = access_.limits()->quotas().largest(&ClientQuota::streams);
    return static_cast<int>(streams == 0 ? kMost : std::clamp(streams, kLeast, kMost));
  }

  /// Until the server stops, passes the state of health to the health service and ends streams
  /// and connections of callers who are not allowed to have them.
  void watch_over() {
    grpc::HealthCheckServiceInterface* service = server_->GetHealthCheckService();
    do {
      const bool is_ready = health_.why_unready().empty();
      service->SetServingStatus("liveness", health_.why_dead().empty());
      service->SetServingStatus("readiness", is_ready);
      service->SetServingStatus("", is_ready);
      access_.cut_refused();
      renew_certificate();
      note_expiry();
    } while (!stopping_.WaitForNotificationWithTimeout(kHealthPeriod));
  }

  /// Renews the server's own certificate when it is due. New connections use it.
  void renew_certificate() {
    const auto now = std::chrono::steady_clock::now();
    if (certs_.empty() || now < renewal_due_) return;
    const auto renewal = renew_server(certs_, std::time(nullptr));
    renewal_due_ = now + std::chrono::seconds(renewal.ok() ? renewal->again_s : kRenewalRetryS);
    if (!renewal.ok()) {
      log_(LogLevel::warn, absl::StrCat("the server's certificate cannot be renewed: ",
                                        std::string(renewal.status().message())));
    } else if (renewal->is_renewed) {
      log_(LogLevel::info, "the server's certificate has been renewed");
      expiry_due_ = now;
    }
  }

  /// Tells the metrics when the certificate expires. An operator may replace its file at any time.
  void note_expiry() {
    const auto now = std::chrono::steady_clock::now();
    if (certs_.empty() || now < expiry_due_) return;
    expiry_due_ = now + kExpiryPeriod;
    const auto end = contract::certificate_end(certs_ + "/tls.crt");
    if (!end.ok()) return;  // without its file it is used until it expires
    metrics_.certificate_expiry.Add({}).Set(
        static_cast<double>(std::chrono::system_clock::to_time_t(*end)));
  }

  Health& health_;
  FarmMetrics& metrics_;
  absl::Notification stopping_;
  std::thread watcher_;
  std::chrono::steady_clock::time_point renewal_due_{}, expiry_due_{};  // of the watcher
  const Log log_;
  const std::shared_ptr<grpc::ServerCredentials> credentials_;
  const std::string certs_;
  const Access access_;
  WorkerAdmission admission_;
  JobService jobs_;
  AssetService assets_;
  WorkerService workers_;
  FarmService farm_;
  CertificateService certificates_;
  std::unique_ptr<AcceptGate> gate_;  // null on a Unix socket
  std::unique_ptr<grpc::Server> server_;
  std::string address_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<FarmServer>> FarmServer::start(Coordinator& coordinator,
                                                              const ListenOptions& options) {
  auto endpoint = make_endpoint(coordinator, options);
  if (!endpoint.ok()) return endpoint.status();
  auto server = std::make_unique<GrpcFarmServer>(coordinator, *std::move(endpoint), options.log);
  if (absl::Status status = server->listen(options.address); !status.ok()) return status;
  return server;
}

}  // namespace tessera::server
