/// bench_rpc_mix: tenants with certificates call every RPC of clients at a fixed rate, with jobs of
/// mixed sizes, an operator those of admins, and a worker those that it makes besides its streams.
/// Prints the latencies of each RPC as one line of JSON.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <mutex>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "client/api/farm_client.h"
#include "rpc/channel.h"
#include "server/identity/authority.h"
#include "tests/bench/coordinator/rpc_figures.h"
#include "tests/bench/coordinator/scene_upload.h"
#include "tests/bench/coordinator/worker_calls.h"

namespace {

namespace v1 = tessera::v1;
using tessera::bench::Figures;
using tessera::bench::WorkerCalls;
using tessera::client::FarmClient;
using Clock = std::chrono::steady_clock;

struct Options {
  std::string server, certs, scratch;
  int tenants = 5, queued = 0;
  double rate = 100, seconds = 20;
};

/// A client and its jobs. One thread.
class Tenant {
 public:
  Tenant(const Options& options, int number, FarmClient& client, Figures& figures)
      : client_(client),
        figures_(figures),
        random_(static_cast<unsigned>(number)),
        name_("t" + std::to_string(number)),
        path_(options.scratch + "/scene-" + name_ + ".gltf") {}

  /// Uploads a scene of its own.
  bool prepare() { return upload_scene(); }

  /// Creates a job that no worker serves.
  bool queue() {
    auto request = job_request(1);
    request.set_required_tag("nobody");
    return client_.create_job(request).ok();
  }

  /// Creates a job of which workers have rendered a part, and pauses it. Returns its ID; empty if
  /// that failed.
  std::string pause_begun_job() {
    auto request = job_request(256);  // large, so that it is not done before it is paused
    request.set_max_worker_count(1);
    const auto created = client_.create_job(request);
    if (!created.ok()) return "";
    const std::string job = created->job().id();
    const auto last = client_.watch_job(
        job, std::chrono::milliseconds(100),
        [](const v1::Job& now) { return now.progress().committed_unit_count() == 0; });
    return last.ok() && client_.pause_job(job).ok() ? job : "";
  }
  const v1::AssetId& scene() const { return scene_; }

  /// Calls an RPC; common ones more often.
  void call() {
    using Call = std::pair<double, std::function<void(Tenant&)>>;
    static const std::vector<Call> calls = {
        {25, &Tenant::create},      {25, &Tenant::get},       {10, &Tenant::list},
        {6, &Tenant::upload},       {6, &Tenant::fetch},      {5, &Tenant::report},
        {4, &Tenant::pause_resume}, {4, &Tenant::update},     {3, &Tenant::cancel_retry},
        {4, &Tenant::remove},       {3, &Tenant::deliveries}, {3, &Tenant::events},
        {2, &Tenant::usage},        {2, &Tenant::quotas},     {3, &Tenant::watch},
        {2, &Tenant::extend}};
    static const std::vector<double> shares = [] {
      std::vector<double> weights;
      for (const Call& one : calls) weights.push_back(one.first);
      return weights;
    }();
    std::discrete_distribution<std::size_t> choose(shares.begin(), shares.end());
    calls[choose(random_)].second(*this);
  }

 private:
  template <typename Call>
  bool timed(const char* rpc, const Call& call) {
    return tessera::bench::timed(figures_, rpc, call);
  }

  v1::CreateJobRequest job_request(int tiles_across) {
    return tessera::bench::job_request(
        "mixed", name_ + "-" + std::to_string(getpid()) + "-" + std::to_string(++count_),
        tessera::bench::small_settings(tiles_across), scene_);
  }

  bool upload_scene() {
    const std::string text = "{\"asset\": {\"version\": \"2.0\"}, \"extras\": \"" + path_ +
                             std::to_string(++count_) + "\"}";
    std::ofstream(path_) << text;
    scene_ = tessera::bench::asset_id(text);
    timed("FindMissingAssets", [&] { return client_.find_missing_assets({scene_}); });
    return timed("UploadAsset", [&] { return client_.upload_asset(scene_, path_); });
  }
  void upload() { upload_scene(); }

  /// Half of the jobs have 1 unit, a quarter 4, an eighth 16, an eighth 64.
  void create() {
    static constexpr int kSizes[] = {1, 1, 1, 1, 2, 2, 4, 8};
    const auto request = job_request(kSizes[random_() % std::size(kSizes)]);
    timed("CreateJob", [&] {
      auto made = client_.create_job(request);
      if (made.ok()) jobs_.push_back(made->job().id());
      return made;
    });
  }

  std::string some_job() { return jobs_.empty() ? "" : jobs_[random_() % jobs_.size()]; }
  /// An older one, which is probably done.
  std::string old_job() { return jobs_.size() < 8 ? "" : jobs_[random_() % (jobs_.size() / 2)]; }

  void get() {
    if (const auto job = some_job(); !job.empty()) {
      timed("GetJob", [&] { return client_.get_job(job); });
    }
  }
  void list() {
    v1::ListJobsRequest request;
    request.set_page_size(100);
    timed("ListJobs", [&] { return client_.list_jobs(request); });
  }
  void fetch() {
    const std::string job = old_job();
    if (job.empty()) return;
    v1::FetchFrameRequest request;
    request.set_job_id(job);
    request.set_allow_partial(true);
    const FarmClient::FrameSink sink{[](const v1::FrameHeader&) { return absl::OkStatus(); },
                                     [](std::string_view) { return absl::OkStatus(); }};
    timed("FetchFrame", [&] { return client_.fetch_frame(request, sink); });
  }
  void report() {
    if (const auto job = old_job(); !job.empty()) {
      timed("GetJobReport", [&] { return client_.get_report(job); });
    }
  }
  void deliveries() {
    if (const auto job = old_job(); !job.empty()) {
      timed("ListDeliveries", [&] { return client_.list_deliveries(job); });
    }
  }
  void events() {
    v1::WatchEventsRequest request;
    request.set_after_sequence(last_event_);
    timed("WatchEvents", [&] {
      return client_.watch_events(request, [&](const v1::Event& event) {
        last_event_ = event.sequence();
        return true;
      });
    });
  }
  void usage() {
    timed("ListUsage", [&] { return client_.list_usage({}); });
  }
  void quotas() {
    timed("ListQuotas", [&] { return client_.list_quotas(); });
  }
  /// Until the job's first state arrives.
  void watch() {
    if (const auto job = some_job(); !job.empty()) {
      timed("WatchJob", [&] {
        return client_.watch_job(job, std::chrono::milliseconds(100),
                                 [](const v1::Job&) { return false; });
      });
    }
  }
  void extend() {
    if (const auto job = old_job(); !job.empty()) {
      timed("ExtendJob", [&] { return client_.extend_job(job, 8, 0); });
    }
  }
  /// These three are called for jobs that were just created, and so are probably not done.
  void pause_resume() {
    const std::string job = fresh_job();
    if (job.empty()) return;
    if (!timed("PauseJob", [&] { return client_.pause_job(job); })) return;
    timed("ResumeJob", [&] { return client_.resume_job(job); });
  }
  void update() {
    v1::UpdateJobRequest request;
    request.set_job_id(fresh_job());
    request.set_priority(static_cast<std::int32_t>(random_() % 5));
    if (!request.job_id().empty()) {
      timed("UpdateJob", [&] { return client_.update_job(request); });
    }
  }
  void cancel_retry() {
    const std::string job = fresh_job();
    if (job.empty()) return;
    if (!timed("CancelJob", [&] { return client_.cancel_job(job); })) return;
    timed("RetryJob", [&] { return client_.retry_job(job); });
  }
  std::string fresh_job() {
    create();
    return jobs_.empty() ? "" : jobs_.back();
  }
  void remove() {
    if (jobs_.size() < 16) return;
    const std::string job = jobs_.front();
    if (timed("RemoveJob", [&] { return client_.remove_job(job); })) {
      jobs_.erase(jobs_.begin());
    }
  }

  FarmClient& client_;
  Figures& figures_;
  std::mt19937 random_;
  const std::string name_, path_;
  v1::AssetId scene_;
  std::vector<std::string> jobs_;
  std::int64_t last_event_ = 0;
  int count_ = 0;
};

/// An admin, who calls RPCs in turn. One thread.
class Operator {
 public:
  Operator(FarmClient& client, Figures& figures) : client_(client), figures_(figures) {}

  /// Finds the workers whose streams its calls end: their names begin with "spare".
  bool prepare() {
    const auto workers = client_.list_workers();
    if (!workers.ok()) return false;
    for (const v1::Worker& worker : *workers) {
      (worker.name().rfind("spare", 0) == 0 ? spare_ : used_).push_back(worker.id());
    }
    return !used_.empty();
  }

  void call() {
    const int turn = turn_++;
    switch (turn % 8) {
      case 0:
        timed("SetLimit", [&] { return client_.set_limit("licence", turn); });
        return;
      case 1:
        timed("ListLimits", [&] { return client_.list_limits(); });
        timed("RemoveLimit", [&] { return client_.remove_limit("licence"); });
        return;
      case 2:
        timed("SetBudget", [&] { return client_.set_budget(budget(turn)); });
        return;
      case 3:
        timed("ListBudgets", [&] { return client_.list_budgets(); });
        timed("RemoveBudget",
              [&] { return client_.remove_budget(v1::Budget::SCOPE_OWNER, "nobody"); });
        return;
      case 4:
        timed("ListWorkers", [&] { return client_.list_workers(); });
        return;
      case 6:
        timed("SetShare", [&] { return client_.set_share("nobody", 1 + turn); });
        timed("ListShares", [&] { return client_.list_shares(); });
        timed("ResetShare", [&] { return client_.reset_share("nobody"); });
        return;
      case 5:
        timed("SetAsideWorker", [&] { return client_.set_aside_worker(used(turn), "a test"); });
        timed("BringBackWorker", [&] { return client_.bring_back_worker(used(turn)); });
        timed("MoveWorker", [&] { return client_.move_worker(used(turn), "night"); });
        timed("MoveWorker", [&] { return client_.move_worker(used(turn), ""); });
        return;
      default:
        end_spare();
    }
  }

 private:
  template <typename Call>
  bool timed(const char* rpc, const Call& call) {
    return tessera::bench::timed(figures_, rpc, call);
  }
  static v1::Budget budget(int turn) {
    v1::Budget budget;
    budget.set_scope(v1::Budget::SCOPE_OWNER);
    budget.set_name("nobody");
    budget.set_cpu_seconds(1000 + turn);
    budget.set_period(v1::Budget::PERIOD_MONTH);
    budget.set_action(v1::Budget::ACTION_WARN);
    budget.set_warning_fraction(0.5);
    return budget;
  }
  const std::string& used(int turn) const {
    return used_[static_cast<std::size_t>(turn) % used_.size()];
  }
  /// Drains a worker, or bans and allows it.
  void end_spare() {
    if (spare_.empty()) return;
    const std::string worker = spare_.back();
    spare_.pop_back();
    if (spare_.size() % 2 == 0) {
      timed("DrainWorker", [&] { return client_.drain_worker(worker); });
      return;
    }
    timed("BanWorker", [&] { return client_.ban_worker(worker).status(); });
    timed("AllowWorker", [&] { return client_.allow_worker(worker); });
  }

  FarmClient& client_;
  Figures& figures_;
  std::vector<std::string> used_, spare_;  // workers
  int turn_ = 0;
};

/// Opens a channel with a new certificate of a worker, of which half of the validity has passed.
absl::StatusOr<std::shared_ptr<grpc::Channel>> open_aged_channel(const Options& options) {
  const std::string folder = options.certs + "/worker-aged";
  const std::int64_t now_s = std::time(nullptr);
  if (absl::Status status = tessera::server::issue(options.certs, tessera::server::Role::worker,
                                                   "aged", folder, {now_s - 3600, now_s + 3000});
      !status.ok()) {
    return status;
  }
  return tessera::contract::open_channel(options.server, folder);
}

int run(const Options& options) {
  Figures figures, ignored;
  std::vector<std::unique_ptr<FarmClient>> clients;
  std::vector<std::thread> threads;
  std::mutex failed_mutex;
  bool failed = false;
  for (int i = 0; i <= options.tenants; ++i) {
    tessera::client::Connection connection;
    connection.server = options.server;
    connection.certs =
        options.certs + (i < options.tenants ? "/client-t" + std::to_string(i) : "/admin-operator");
    auto client = FarmClient::connect(connection);
    if (!client.ok()) {
      fprintf(stderr, "%s\n", std::string(client.status().message()).c_str());
      return 2;
    }
    clients.push_back(*std::move(client));
  }
  const auto for_all = [&](const std::function<bool(int)>& work) {
    for (int i = 0; i < options.tenants; ++i) {
      threads.emplace_back([&, i] {
        if (work(i)) return;
        const std::lock_guard lock(failed_mutex);
        failed = true;
      });
    }
    for (std::thread& thread : threads) thread.join();
    threads.clear();
  };
  for_all([&](int i) {
    Tenant tenant(options, i + 1000, *clients[static_cast<std::size_t>(i)], ignored);
    bool is_ok = tenant.prepare();
    for (int k = i; is_ok && k < options.queued; k += options.tenants) is_ok = tenant.queue();
    return is_ok;
  });
  if (failed) return 1;
  const auto channel = tessera::contract::open_channel(options.server, options.certs + "/worker-w");
  const auto aged = open_aged_channel(options);
  Tenant owner(options, 2000, *clients.front(), ignored);
  const std::string begun =
      channel.ok() && aged.ok() && owner.prepare() ? owner.pause_begun_job() : "";
  if (begun.empty()) return 1;
  const auto start = Clock::now();
  std::thread worker_thread([&] {
    WorkerCalls worker({*channel, *aged}, begun, owner.scene(), figures);
    for (int k = 0; k < 10 * options.seconds; ++k) {
      std::this_thread::sleep_until(start + std::chrono::milliseconds(100 * k + 50));
      worker.call();
    }
  });
  std::thread operator_thread([&] {
    Operator admin(*clients.back(), figures);
    bool is_ok = admin.prepare();
    for (int k = 0; is_ok && k < 10 * options.seconds; ++k) {
      std::this_thread::sleep_until(start + std::chrono::milliseconds(100 * k));
      admin.call();
    }
    const std::lock_guard lock(failed_mutex);
    failed = failed || !is_ok;
  });
  for_all([&](int i) {
    Tenant tenant(options, i, *clients[static_cast<std::size_t>(i)], figures);
    if (!tenant.prepare()) return false;
    const std::chrono::duration<double> period(options.tenants / options.rate);
    for (int k = 0; k * period.count() < options.seconds; ++k) {
      std::this_thread::sleep_until(
          start + std::chrono::duration_cast<Clock::duration>(period * (k + i / 7.0)));
      tenant.call();
    }
    return true;
  });
  operator_thread.join();
  worker_thread.join();
  figures.print();
  return failed ? 1 : 0;
}

}  // namespace

int main(int argc, char** argv) {  // NOLINT(bugprone-exception-escape): a bench may die of one
  Options options;
  CLI::App app("A mix of calls of several tenants for tests/bench/coordinator/mix.sh.");
  app.add_option("--server", options.server, "HOST:PORT")->required();
  app.add_option("--certs", options.certs, "directory with client-t0, client-t1, …, worker-w")
      ->required();
  app.add_option("--scratch", options.scratch, "directory for scenes")->required();
  app.add_option("--tenants", options.tenants, "clients")->capture_default_str();
  app.add_option("--queued", options.queued, "jobs created before, which no worker serves");
  app.add_option("--rate", options.rate, "steps a second of all tenants together: one or two calls")
      ->capture_default_str();
  app.add_option("--seconds", options.seconds, "duration")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  return run(options);
}
