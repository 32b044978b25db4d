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
#include <random>
#include <thread>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "rpc/channel.h"
#include "telemetry/metrics/listener.h"
#include "tessera/v1/asset_service.grpc.pb.h"
#include "worker/agent/units/agent_metrics.h"
#include "worker/agent/server/job_log.h"
#include "worker/agent/supervisor/renderer_supervisor.h"
#include "worker/renderer/renderer.h"
#include "worker/agent/server/server_connection.h"
#include "worker/agent/signal_handler.h"

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

std::string random_id() {
  std::random_device random;
  std::string id = "w-";
  constexpr std::array<char, 17> kDigits = {"0123456789abcdef"};
  for (int i = 0; i < 16; ++i) id += kDigits[random() % 16];
  return id;
}

/// A scene may have more files than the usual soft limit of open descriptors.
void raise_descriptor_limit() {
  rlimit limit{};
  if (::getrlimit(RLIMIT_NOFILE, &limit) != 0) return;
  limit.rlim_cur = limit.rlim_max;
  ::setrlimit(RLIMIT_NOFILE, &limit);
}

/// Waits a little for a server that is being started on a Unix socket: gRPC's own back-off would
/// waste a tenth of a second.
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

RenderDeskOptions desk_options(const AgentOptions& options, JobLog log) {
  RenderDeskOptions desk;
  desk.thread_count = options.thread_count;
  desk.unit_timeout = options.unit_timeout;
  desk.log = std::move(log);
  desk.lie_every = options.lie_every;
  desk.arguments = {"renderer",
                    "--fd",
                    "3",
                    "--threads",
                    absl::StrCat(options.thread_count),
                    "--isa",
                    std::string(render::isa_name(options.isa)),
                    "--texel-bytes",
                    absl::StrCat(options.texel_bytes)};
  if (options.memory_bytes > 0) {
    desk.arguments.insert(desk.arguments.end(),
                          {"--memory-bytes", absl::StrCat(options.memory_bytes)});
  }
  if (!options.accelerator.empty()) {
    desk.arguments.insert(desk.arguments.end(), {"--accelerator", options.accelerator});
  }
  if (options.crash_on) {
    const contract::Unit& unit = *options.crash_on;
    desk.arguments.insert(desk.arguments.end(),
                          {"--crash-on", absl::StrCat(unit.frame, ":", unit.tile, ":", unit.pass)});
  }
  return desk;
}

/// The first renderer, while this process has one thread.
absl::StatusOr<RendererProcess::Child> fork_renderer(const AgentOptions& options) {
  RendererOptions renderer;
  renderer.thread_count = options.thread_count;
  renderer.memory_bytes = options.memory_bytes;
  renderer.texel_bytes = options.texel_bytes;
  renderer.isa = options.isa;
  renderer.accelerator = options.accelerator;
  renderer.crash_on = options.crash_on;
  return RendererProcess::fork_off([&renderer] { return run_renderer(renderer); });
}

class Agent {
 public:
  Agent(AgentOptions options, RendererProcess::Child renderer,
        const std::shared_ptr<grpc::Channel>& channel, std::unique_ptr<AssetCache> cache,
        UnitLog log, AgentMetrics& metrics)
      : options_(std::move(options)),
        workers_(v1::WorkerService::NewStub(channel)),
        assets_(v1::AssetService::NewStub(channel)),
        cache_(std::move(cache)),
        log_(std::move(log)),
        metrics_(metrics),
        desk_(desk_options(options_, [this](auto... line) { say(line...); }), std::move(renderer),
              queue_, log_, mailbox_, desk_outlet()),
        link_(*workers_, {options_.token, options_.deliver_twice, options_.forge, options_.log},
              queue_, mailbox_, link_outlet()),
        fetcher_(*workers_, *assets_, *cache_, metrics_, options_.token,
                 [this](std::string job_id, absl::StatusOr<JobInputs> files) {
                   // std::function wants copies; the files cannot be copied.
                   auto shared = std::make_shared<absl::StatusOr<JobInputs>>(std::move(files));
                   mailbox_.post([this, job_id = std::move(job_id), shared] {
                     desk_.job_fetched(job_id, std::move(*shared));
                   });
                 }) {}

  absl::Status run() {
    const SignalHandler termination([this] { mailbox_.post([this] { leave("a signal"); }); });
    desk_.pump(Clock::now());  // the renderer starts while the server may still be starting
    wait_for_socket(options_.server);
    while (!end_) {
      const Time now = Clock::now();
      desk_.pump(now);
      Time wake = now + kTick;
      if (desk_.ready() != nullptr) {
        link_.pump(now);
        relay_lines(now);
        wake = std::min(wake, link_.next_due());
      }
      take_stock();
      if (leaving_ && (queue_.empty() || now >= leave_by_)) break;
      mailbox_.run_until(wake);
    }
    close();
    return end_.value_or(absl::OkStatus());
  }

 private:
  RendererSupervisor::Callbacks desk_outlet() {
    RendererSupervisor::Callbacks outlet;
    outlet.want_job = [this](const std::string& job_id) { fetcher_.fetch(job_id); };
    outlet.failed = [this](v1::UnitFailure failure) {
      metrics_.errors.unit_failed.Increment();
      v1::WorkRequest request;
      *request.mutable_failure() = std::move(failure);
      link_.send(std::move(request));
    };
    outlet.given_up = [this](const std::vector<UnitKey>& units) { answer_revocation(units); };
    outlet.scene_loaded = [this](v1::SceneLoaded loaded) {
      metrics_.scene_load_seconds.Observe(loaded.load_seconds() + loaded.build_seconds());
      v1::WorkRequest request;
      *request.mutable_scene_loaded() = std::move(loaded);
      link_.send(std::move(request));
    };
    outlet.unit_finished = [this](const RendererSupervisor::Rendered& unit) {
      metrics_.unit_seconds.Observe(unit.seconds);
      metrics_.cpu_seconds.Increment(unit.cpu_seconds);
      metrics_.block_bytes.Increment(static_cast<double>(unit.block_bytes));
    };  // the loop delivers after every event
    outlet.renderer_died = [this] { metrics_.errors.renderer_died.Increment(); };
    outlet.broken = [this](absl::Status status) { end_ = std::move(status); };
    return outlet;
  }

  ServerConnection::Callbacks link_outlet() {
    ServerConnection::Callbacks outlet;
    outlet.hello = [this] { return hello(); };
    outlet.window = [this] {
      return leaving_
                 ? CreditWindow{}
                 : credit_window(options_.thread_count, link_.round_trip_seconds(),
                                 desk_.unit_seconds(), desk_.block_bytes(), options_.buffer_bytes);
    };
    outlet.rss_bytes = [this] {
      const std::int64_t bytes = resident_bytes(::getpid()) + desk_.renderer_rss_bytes();
      metrics_.resident_bytes.Set(static_cast<double>(bytes));
      return bytes;
    };
    outlet.on_response = [this](const v1::WorkResponse& response) { obey(response); };
    outlet.refused = [this](const absl::Status& status) {
      end_ = absl::Status(status.code(), absl::StrCat("the server refused this worker: ",
                                                      std::string(status.message())));
    };
    return outlet;
  }

  v1::WorkerHello hello() {
    v1::WorkerHello hello;
    hello.set_worker_id(options_.worker_id);
    hello.set_name(options_.name);
    hello.set_host(host_name());
    hello.set_contract_version(desk_.ready()->contract_version());
    hello.set_numerics_sha256(desk_.ready()->numerics_sha256());
    hello.set_isa(desk_.ready()->isa());
    hello.set_thread_count(options_.thread_count);
    for (const std::string& tag : options_.tags) hello.add_tags(tag);
    return hello;
  }

  void obey(const v1::WorkResponse& response) {
    switch (response.event_case()) {
      case v1::WorkResponse::kLeases:
        for (const v1::Lease& lease : response.leases().leases()) take(lease);
        break;
      case v1::WorkResponse::kRevocation: {
        std::vector<UnitKey> units;
        for (const v1::UnitId& id : response.revocation().units()) units.push_back(key_of(id));
        answer_revocation(queue_.revoke(units));
        break;
      }
      case v1::WorkResponse::kAcknowledgements:
        for (const auto& verdict : response.acknowledgements().acknowledgements()) {
          acknowledge(verdict);
        }
        break;
      case v1::WorkResponse::kDrain:
        leave("the server's wish");
        break;
      case v1::WorkResponse::kJobEnded:
        say(LogLevel::info, response.job_ended().job_id(),
            absl::StrCat("job ", response.job_ended().job_id(), " has ended"));
        queue_.drop_job(response.job_ended().job_id());
        desk_.job_ended(response.job_ended().job_id());
        break;
      default:
        break;  // a sign of life
    }
  }

  void take(const v1::Lease& lease) {
    queue_.add_lease(lease);
    if (leaving_) answer_revocation(queue_.hand_back_waiting());
  }

  void acknowledge(const v1::Acknowledgement& verdict) {
    const UnitKey key = key_of(verdict.unit());
    const auto offered = queue_.offered(key);
    if (!queue_.acknowledge(key)) return;
    if (offered) link_.note_verdict(*offered, Clock::now());
    if (verdict.status() >= v1::Acknowledgement::ACK_STATUS_COMMITTED &&
        verdict.status() <= v1::Acknowledgement::ACK_STATUS_REJECTED) {
      metrics_.verdicts[static_cast<std::size_t>(verdict.status()) - 1]->Increment();
    }
    const std::string name = v1::Acknowledgement::AckStatus_Name(verdict.status());
    log_.write(name.substr(sizeof "ACK_STATUS_" - 1).c_str(), key, verdict.reason());
    const bool rejected = verdict.status() == v1::Acknowledgement::ACK_STATUS_REJECTED;
    say(rejected ? LogLevel::warn : LogLevel::debug, key.job_id,
        absl::StrCat("unit ", to_string(key), rejected ? " is rejected: " : ": ",
                     rejected ? verdict.reason() : name));
  }

  /// Logs a line, and keeps it for the server if it is about a job and worth being logged here.
  void say(LogLevel level, const std::string& job_id, const std::string& line) {
    options_.log(level, line);
    if (!job_id.empty() && level >= options_.log_level) relay_.add(level, job_id, line);
  }

  void relay_lines(Time now) {
    if (!link_.connected()) return;
    auto lines = relay_.take(now);
    if (!lines) return;
    v1::WorkRequest request;
    *request.mutable_log_lines() = *std::move(lines);
    link_.send(std::move(request));
  }

  /// Sets the gauges: the queue belongs to this thread, which is not the one that is asked.
  void take_stock() {
    const auto waiting = static_cast<double>(queue_.waiting().size());
    const auto started = static_cast<double>(queue_.started().size());
    metrics_.units.waiting.Set(waiting);
    metrics_.units.started.Set(started);
    metrics_.units.unacknowledged.Set(queue_.size() - waiting - started);
    metrics_.connected.Set(link_.connected() ? 1 : 0);
    metrics_.ack_latency_seconds.Set(link_.round_trip_seconds());
  }

  void answer_revocation(const std::vector<UnitKey>& units) {
    if (units.empty()) return;
    v1::WorkRequest request;
    for (const UnitKey& key : units) *request.mutable_returned()->add_units() = id_of(key);
    link_.send(std::move(request));
  }

  void leave(const char* why) {
    if (leaving_) return;
    leaving_ = true;
    leave_by_ = Clock::now() + options_.grace;
    options_.log(LogLevel::info, absl::StrCat("leaving on ", why));
    v1::WorkRequest request;
    request.mutable_draining();
    link_.send(std::move(request));
    answer_revocation(queue_.hand_back_waiting());
  }

  void close() {
    link_.finish();
    const Time limit = Clock::now() + kCloseTimeout;
    while (!link_.closed()) {
      if (Clock::now() >= limit) link_.cancel();
      mailbox_.run_until(Clock::now() + milliseconds(50));
    }
  }

  const AgentOptions options_;
  const std::unique_ptr<v1::WorkerService::Stub> workers_;
  const std::unique_ptr<v1::AssetService::Stub> assets_;
  const std::unique_ptr<AssetCache> cache_;
  UnitLog log_;
  AgentMetrics& metrics_;
  UnitQueue queue_;
  EventLoop mailbox_;
  JobLogForwarder relay_;
  bool leaving_ = false;
  Time leave_by_{};
  std::optional<absl::Status> end_;
  RendererSupervisor desk_;
  ServerConnection link_;
  JobFetcher fetcher_;  // last: its thread ends before what it posts to
};

}  // namespace

absl::Status run_agent(const AgentOptions& given) {
  AgentOptions options = given;
  raise_descriptor_limit();
  if (options.worker_id.empty()) options.worker_id = random_id();
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
  SignalHandler::block_signals();
  auto channel = contract::open_channel(options.server, options.certs);  // starts threads
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
  return Agent(std::move(options), *std::move(renderer), *channel, *std::move(cache),
               std::move(log), metrics)
      .run();
}

}  // namespace tessera::agent
