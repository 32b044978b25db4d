#include "worker/agent/agent.h"

#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <memory>
#include <optional>
#include <thread>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "rpc/certificate_renewer.h"
#include "rpc/certificates/certificate_dates.h"
#include "rpc/protocol_version.h"
#include "telemetry/metrics/listener.h"
#include "tessera/v1/asset_service.grpc.pb.h"
#include "worker/agent/server/job_fetcher.h"
#include "worker/agent/server/job_log.h"
#include "worker/agent/server/server_channel.h"
#include "worker/agent/server/server_connection.h"
#include "worker/agent/signal_handler.h"
#include "worker/agent/supervisor/renderer_supervisor.h"
#include "worker/agent/units/agent_metrics.h"
#include "worker/agent/worker_id.h"
#include "worker/renderer/renderer.h"

namespace tessera::agent {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr milliseconds kTick{500};
constexpr seconds kCloseTimeout{2};

std::string host_name() {
  std::array<char, 256> name{};
  if (::gethostname(name.data(), name.size() - 1) != 0) return "unknown";
  return name.data();
}

/// Raises the soft limit of open descriptors: a scene may have more files than it allows.
void raise_descriptor_limit() {
  rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
  limit.rlim_cur = limit.rlim_max;
  ::setrlimit(RLIMIT_NOFILE, &limit);
}

/// Waits up to 1 s for a server on a Unix socket to listen. gRPC's back-off would wait 0.1 s or
/// more between attempts.
void wait_for_socket(const std::string& address) {
  if (!absl::StartsWith(address, "unix:")) return;
  sockaddr_un where{};
  where.sun_family = AF_UNIX;
  const std::string path = address.substr(5);
  if (path.size() >= sizeof where.sun_path) return;
  std::memcpy(where.sun_path, path.c_str(), path.size());
  const Descriptor probe(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  for (int attempt = 0; attempt < 500; ++attempt) {
    if (::connect(probe.get(), reinterpret_cast<const sockaddr*>(&where), sizeof where) == 0)
      return;
    std::this_thread::sleep_for(milliseconds(2));
  }
}

RendererSupervisorOptions supervisor_options(const AgentOptions& options, JobLog log) {
  RendererSupervisorOptions supervisor;
  supervisor.thread_count = options.thread_count;
  supervisor.unit_timeout = options.unit_timeout;
  supervisor.log = std::move(log);
  supervisor.block_rendered = options.faults.block_rendered;
  supervisor.arguments = {"renderer",
                          "--fd",
                          "3",
                          "--threads",
                          absl::StrCat(options.thread_count),
                          "--isa",
                          std::string(render::isa_name(options.isa)),
                          "--texel-bytes",
                          absl::StrCat(options.texel_bytes)};
  if (options.memory_bytes > 0) {
    supervisor.arguments.insert(supervisor.arguments.end(),
                                {"--memory-bytes", absl::StrCat(options.memory_bytes)});
  }
  const auto& fault_arguments = options.faults.renderer_arguments;
  supervisor.arguments.insert(supervisor.arguments.end(), fault_arguments.begin(),
                              fault_arguments.end());
  return supervisor;
}

/// Forks the first renderer. Requires that this process has one thread.
absl::StatusOr<RendererProcess::Child> fork_renderer(const AgentOptions& options) {
  RendererOptions renderer;
  renderer.thread_count = options.thread_count;
  renderer.memory_bytes = options.memory_bytes;
  renderer.texel_bytes = options.texel_bytes;
  renderer.isa = options.isa;
  renderer.before_unit = options.faults.before_unit;
  return RendererProcess::fork_off([&renderer] { return run_renderer(renderer); });
}

class Agent {
 public:
  Agent(AgentOptions options, RendererProcess::Child renderer,
        std::unique_ptr<ServerChannel> channel, std::unique_ptr<AssetCache> cache, UnitLog log,
        AgentMetrics& metrics)
      : options_(std::move(options)),
        channel_(std::move(channel)),
        cache_(std::move(cache)),
        log_(std::move(log)),
        metrics_(metrics),
        supervisor_(supervisor_options(options_, [this](auto... line) { log_job_line(line...); }),
                    std::move(renderer), queue_, log_, event_loop_, supervisor_callbacks()),
        connection_(*channel_, connection_options(), queue_, event_loop_, connection_callbacks()),
        fetcher_(*channel_, *cache_, metrics_, options_.token,
                 [this](std::string job_id, absl::StatusOr<JobInputs> files) {
                   // std::function requires copies, and JobInputs cannot be copied.
                   auto shared = std::make_shared<absl::StatusOr<JobInputs>>(std::move(files));
                   event_loop_.post([this, job_id = std::move(job_id), shared] {
                     supervisor_.job_fetched(job_id, std::move(*shared));
                   });
                 }) {
    if (!options_.certs.empty()) {
      renewer_ = std::make_unique<contract::CertificateRenewer>(renewer_options());
    }
  }

  absl::Status run() {
    const SignalHandler signals([this] { event_loop_.post([this] { drain("signal received"); }); });
    supervisor_.pump(Clock::now());  // starts the renderer while the server may be starting
    wait_for_socket(options_.server);
    while (!end_) {
      const Time now = Clock::now();
      supervisor_.pump(now);
      Time wake = now + kTick;
      if (supervisor_.ready() != nullptr) {
        connection_.pump(now);
        forward_log_lines(now);
        wake = std::min(wake, connection_.next_due());
      }
      update_gauges();
      check_certificates(now);
      if (draining_ && (queue_.empty() || now >= drain_deadline_)) break;
      event_loop_.run_until(wake);
    }
    close();
    return end_.value_or(absl::OkStatus());
  }

 private:
  RendererSupervisor::Callbacks supervisor_callbacks() {
    RendererSupervisor::Callbacks callbacks;
    callbacks.fetch_job = [this](const std::string& job_id) { fetcher_.fetch(job_id); };
    callbacks.failed = [this](v1::UnitFailure failure) {
      metrics_.errors.unit_failed.Increment();
      v1::WorkRequest request;
      *request.mutable_failure() = std::move(failure);
      connection_.send(std::move(request));
    };
    callbacks.units_returned = [this](const std::vector<UnitKey>& units) {
      return_units(units, true);
    };
    callbacks.scene_loaded = [this](v1::SceneLoaded loaded) {
      metrics_.scene_load_seconds.Observe(loaded.load_seconds() + loaded.build_seconds());
      v1::WorkRequest request;
      *request.mutable_scene_loaded() = std::move(loaded);
      connection_.send(std::move(request));
    };
    callbacks.unit_finished = [this](const RendererSupervisor::Rendered& unit) {
      metrics_.unit_seconds.Observe(unit.seconds);
      metrics_.cpu_seconds.Increment(unit.cpu_seconds);
      metrics_.block_bytes.Increment(static_cast<double>(unit.block_bytes));
    };  // run() delivers after every event
    callbacks.renderer_died = [this] { metrics_.errors.renderer_died.Increment(); };
    callbacks.failed_for_good = [this](absl::Status status) { end_ = std::move(status); };
    return callbacks;
  }

  ServerConnection::Options connection_options() {
    ServerConnection::Options options;
    options.token = options_.token;
    options.blocks_to_send = options_.faults.blocks_to_send;
    options.awaits_certificate = [this] {
      return renewal_.explains_refusal(std::chrono::system_clock::now());
    };
    options.log = options_.log;
    return options;
  }

  contract::CertificateRenewer::Options renewer_options() {
    contract::CertificateRenewer::Options options;
    options.folder = options_.certs;
    options.channel = [this] { return channel_->channel(); };
    options.renewed = [this] { event_loop_.post([this] { use_new_certificate(); }); };
    options.failed = [this](const absl::Status& status) {
      event_loop_.post([this, status] { note_failed_renewal(status); });
    };
    return options;
  }

  /// Connects again: the present connection has the old certificate, and ends with it.
  void use_new_certificate() {
    last_renewal_error_.clear();
    const absl::Status status = channel_->reopen();
    if (!status.ok()) {
      options_.log(LogLevel::warn,
                   absl::StrCat("cannot use the new certificate: ", std::string(status.message())));
      return;
    }
    options_.log(LogLevel::info, "the certificate has been renewed; connecting with the new one");
    renewal_ = contract::CertificateRenewal(options_.certs);
    connection_.reconnect();
  }

  void note_failed_renewal(const absl::Status& status) {
    const std::string message(status.message());
    if (std::exchange(last_renewal_error_, message) == message) return;
    options_.log(LogLevel::warn, absl::StrCat("the certificate cannot be renewed yet: ", message));
  }

  /// Warns once a day of certificates that end soon.
  void check_certificates(Time now) {
    if (now < certificates_due_) return;
    certificates_due_ = now + std::chrono::hours(24);
    const std::string warning =
        contract::expiry_warning(options_.certs, std::chrono::system_clock::now());
    if (!warning.empty()) options_.log(LogLevel::warn, warning);
  }

  ServerConnection::Callbacks connection_callbacks() {
    ServerConnection::Callbacks callbacks;
    callbacks.hello = [this] { return hello(); };
    callbacks.window = [this] {
      return draining_ ? CreditWindow{}
                       : credit_window(options_.thread_count, connection_.ack_latency_seconds(),
                                       supervisor_.unit_seconds(), supervisor_.block_bytes(),
                                       options_.buffer_bytes);
    };
    callbacks.rss_bytes = [this] {
      const std::int64_t bytes = resident_bytes(::getpid()) + supervisor_.renderer_rss_bytes();
      metrics_.resident_bytes.Set(static_cast<double>(bytes));
      return bytes;
    };
    callbacks.on_response = [this](const v1::WorkResponse& response) { handle(response); };
    callbacks.refused = [this](const absl::Status& status) {
      end_ = absl::PermissionDeniedError(
          absl::StrCat("refused by the server: ", std::string(status.message())));
    };
    return callbacks;
  }

  v1::WorkerHello hello() {
    v1::WorkerHello hello;
    hello.set_worker_id(options_.worker_id);
    hello.set_name(options_.name);
    hello.set_host(host_name());
    hello.set_protocol_version(contract::kProtocolVersion);
    hello.set_contract_version(supervisor_.ready()->contract_version());
    hello.set_numerics_sha256(supervisor_.ready()->numerics_sha256());
    hello.set_isa(supervisor_.ready()->isa());
    hello.set_thread_count(options_.thread_count);
    for (const std::string& tag : options_.tags) hello.add_tags(tag);
    hello.set_pool(options_.pool);
    return hello;
  }

  void handle(const v1::WorkResponse& response) {
    switch (response.event_case()) {
      case v1::WorkResponse::kLeases:
        for (const v1::JobDescription& job : response.leases().jobs()) fetcher_.describe(job);
        for (const v1::Lease& lease : response.leases().leases()) take(lease);
        break;
      case v1::WorkResponse::kRevocation: {
        std::vector<UnitKey> units;
        for (const v1::UnitId& id : response.revocation().units()) units.push_back(key_of(id));
        return_units(queue_.revoke(units));
        break;
      }
      case v1::WorkResponse::kAcknowledgements:
        for (const auto& acknowledgement : response.acknowledgements().acknowledgements()) {
          acknowledge(acknowledgement);
        }
        break;
      case v1::WorkResponse::kDrain:
        drain("requested by the server");
        break;
      case v1::WorkResponse::kJobEnded:
        log_job_line(LogLevel::info, response.job_ended().job_id(),
                     absl::StrCat("job ", response.job_ended().job_id(), " ended"));
        queue_.drop_job(response.job_ended().job_id());
        supervisor_.job_ended(response.job_ended().job_id());
        fetcher_.forget(response.job_ended().job_id());
        break;
      default:
        break;  // only a heartbeat
    }
  }

  void take(const v1::Lease& lease) {
    queue_.add_lease(lease);
    if (draining_) return_units(queue_.return_waiting());
  }

  void acknowledge(const v1::Acknowledgement& acknowledgement) {
    const UnitKey key = key_of(acknowledgement.unit());
    const auto offered = queue_.offered(key);
    if (!queue_.acknowledge(key)) return;
    if (offered) connection_.record_acknowledgement(*offered, Clock::now());
    if (acknowledgement.status() >= v1::Acknowledgement::ACK_STATUS_COMMITTED &&
        acknowledgement.status() <= v1::Acknowledgement::ACK_STATUS_REJECTED) {
      metrics_.acknowledgements[static_cast<std::size_t>(acknowledgement.status()) - 1]
          ->Increment();
    }
    const std::string name = v1::Acknowledgement::AckStatus_Name(acknowledgement.status())
                                 .substr(sizeof "ACK_STATUS_" - 1);
    log_.write(name.c_str(), key, acknowledgement.reason());
    const bool rejected = acknowledgement.status() == v1::Acknowledgement::ACK_STATUS_REJECTED;
    log_job_line(rejected ? LogLevel::warn : LogLevel::debug, key.job_id,
                 absl::StrCat("unit ", to_string(key), rejected ? " rejected: " : ": ",
                              rejected ? acknowledgement.reason() : name));
  }

  /// Logs a line, and forwards it to the server if it is about a job and at or above the log level.
  void log_job_line(LogLevel level, const std::string& job_id, const std::string& line) {
    options_.log(level, line);
    if (!job_id.empty() && level >= options_.log_level) log_forwarder_.add(level, job_id, line);
  }

  void forward_log_lines(Time now) {
    if (!connection_.connected()) return;
    auto lines = log_forwarder_.take(now);
    if (!lines) return;
    v1::WorkRequest request;
    *request.mutable_log_lines() = *std::move(lines);
    connection_.send(std::move(request));
  }

  /// Updates the gauges: the queue belongs to this thread, and metrics are read on another.
  void update_gauges() {
    const auto waiting = static_cast<double>(queue_.waiting().size());
    const auto started = static_cast<double>(queue_.started().size());
    metrics_.units.waiting.Set(waiting);
    metrics_.units.started.Set(started);
    metrics_.units.unacknowledged.Set(queue_.size() - waiting - started);
    metrics_.connected.Set(connection_.connected() ? 1 : 0);
    metrics_.ack_latency_seconds.Set(connection_.ack_latency_seconds());
  }

  void return_units(const std::vector<UnitKey>& units, bool lacks_files = false) {
    if (units.empty()) return;
    v1::WorkRequest request;
    request.mutable_returned()->set_lacks_files(lacks_files);
    for (const UnitKey& key : units) *request.mutable_returned()->add_units() = id_of(key);
    connection_.send(std::move(request));
  }

  void drain(const char* reason) {
    if (draining_) return;
    draining_ = true;
    drain_deadline_ = Clock::now() + options_.grace;
    options_.log(LogLevel::info, absl::StrCat("draining: ", reason));
    v1::WorkRequest request;
    request.mutable_draining();
    connection_.send(std::move(request));
    return_units(queue_.return_waiting());
  }

  void close() {
    connection_.finish();
    const Time limit = Clock::now() + kCloseTimeout;
    while (!connection_.closed()) {
      if (Clock::now() >= limit) connection_.cancel();
      event_loop_.run_until(Clock::now() + milliseconds(50));
    }
  }

  const AgentOptions options_;
  contract::CertificateRenewal renewal_{options_.certs};
  std::string last_renewal_error_;  // logged
  Time certificates_due_{};
  const std::unique_ptr<ServerChannel> channel_;
  const std::unique_ptr<AssetCache> cache_;
  UnitLog log_;
  AgentMetrics& metrics_;
  UnitQueue queue_;
  EventLoop event_loop_;
  JobLogForwarder log_forwarder_;
  bool draining_ = false;
  Time drain_deadline_{};
  std::optional<absl::Status> end_;
  RendererSupervisor supervisor_;
  ServerConnection connection_;
  // Last: their threads end before the members they post to.
  JobFetcher fetcher_;
  std::unique_ptr<contract::CertificateRenewer> renewer_;  // null without certificates
};

}  // namespace

absl::Status run_agent(const AgentOptions& given) {
  AgentOptions options = given;
  raise_descriptor_limit();
  if (options.name.empty()) options.name = host_name();
  auto cache = AssetCache::open(options.cache_folder, options.cache_bytes);
  if (!cache.ok()) return cache.status();
  UnitLog log;
  if (!options.unit_log.empty()) {
    auto opened = UnitLog::open(options.unit_log);
    if (!opened.ok()) return opened.status();
    log = *std::move(opened);
  }
  auto renderer = fork_renderer(options);
  if (!renderer.ok()) return renderer.status();
  WorkerId claimed;  // after the fork
  if (options.worker_id.empty()) {
    claimed = claim_worker_id(options.cache_folder, host_name());
    options.worker_id = claimed.id;
  }
  SignalHandler::block_signals();
  auto channel = ServerChannel::open(options.server, options.certs);  // starts threads
  if (!channel.ok()) return channel.status();
  AgentMetrics metrics;
  metrics.threads.Set(options.thread_count);
  std::unique_ptr<MetricsListener> listener;
  if (!options.metrics.empty()) {
    auto started =
        MetricsListener::start(options.metrics, [&metrics] { return metrics.collect(); });
    if (!started.ok()) return started.status();
    listener = *std::move(started);
    options.log(LogLevel::info, absl::StrCat("metrics: http://", listener->address(), "/metrics"));
  }
  return Agent(std::move(options), *std::move(renderer), *std::move(channel), *std::move(cache),
               std::move(log), metrics)
      .run();
}

}  // namespace tessera::agent
