/// bench_coordinator_small_jobs: many clients create many small jobs, which simulated workers
/// finish. Prints jobs per second from the first CreateJob to the last finished job, and
/// percentiles of the latency of CreateJob and of the time from CreateJob's answer to the end of
/// the job.
#include <grpcpp/grpcpp.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "rpc/channel.h"
#include "tests/bench/coordinator/client_options.h"
#include "tests/bench/coordinator/scene_upload.h"

namespace {

namespace v1 = tessera::v1;
using Clock = std::chrono::steady_clock;

struct Options {
  std::string server, token, answers;
  int clients = 16, jobs = 10'000, queued = 0, open = 256;
  double rate = 0;
};

double seconds(Clock::duration span) {
  return std::chrono::duration<double>(span).count();
}

/// Prints the median, the 99th percentile and the maximum in milliseconds, as members of an object.
void print_percentiles(const char* name, std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const auto at = [&](double share) {
    const auto index = static_cast<std::size_t>(share * static_cast<double>(values.size()));
    return values.empty() ? 0.0 : 1e3 * values[std::min(index, values.size() - 1)];
  };
  printf("\"%s_ms\": {\"p50\": %.2f, \"p99\": %.2f, \"max\": %.2f}, ", name, at(0.5), at(0.99),
         at(1));
}

/// The jobs that are created and not yet finished, by ID. Thread-safe.
class OpenJobs {
 public:
  explicit OpenJobs(int limit) : limit_(limit) {}

  /// Waits until another job may be opened.
  void reserve() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return open_ < limit_; });
    ++open_;
  }
  void created(const std::string& id) {
    const std::lock_guard lock(mutex_);
    answers_.emplace_back(id, Clock::now());
    if (finished_early_.erase(id) > 0) {  // its event was faster than the answer
      turnaround_.push_back(0);
      return;
    }
    created_[id] = answers_.back().second;
  }
  /// Writes a line with ID and time in microseconds for each answer; returns false if that fails.
  bool write_answers(const std::string& path) const {
    std::ofstream file(path);
    for (const auto& [id, at] : answers_) {
      file << id << ' '
           << std::chrono::duration_cast<std::chrono::microseconds>(at.time_since_epoch()).count()
           << '\n';
    }
    return file.flush().good();
  }
  /// Counts a job that ended; ignores jobs of other clients.
  void finished(const std::string& id) {
    const std::lock_guard lock(mutex_);
    if (const auto found = created_.find(id); found != created_.end()) {
      turnaround_.push_back(seconds(Clock::now() - found->second));
      created_.erase(found);
    } else {
      finished_early_.insert({id, 0});
    }
    --open_;
    ++count_;
    last_ = Clock::now();
    changed_.notify_all();
  }
  /// Waits until this many jobs have ended; returns false after a minute without any.
  bool wait_for(std::int64_t count) {
    std::unique_lock lock(mutex_);
    for (std::int64_t seen = -1; count_ < count;) {
      if (seen == count_) return false;
      seen = count_;
      changed_.wait_for(lock, std::chrono::minutes(1), [&] { return count_ >= count; });
    }
    return true;
  }
  Clock::time_point last() const { return last_; }
  std::vector<double> turnaround() const { return turnaround_; }

 private:
  const int limit_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::map<std::string, Clock::time_point> created_;
  std::map<std::string, int> finished_early_;
  std::vector<std::pair<std::string, Clock::time_point>> answers_;
  std::vector<double> turnaround_;
  int open_ = 0;
  std::int64_t count_ = 0;
  Clock::time_point last_;
};

/// The request of job number `k` of a kind.
v1::CreateJobRequest job_request(const std::string& scene, const char* kind, int k) {
  return tessera::bench::job_request(
      "small", std::string(kind) + "-" + std::to_string(getpid()) + "-" + std::to_string(k),
      tessera::bench::small_settings(2), tessera::bench::asset_id(scene));
}

/// Creates a job and returns its ID; empty if that failed.
std::string create(v1::JobService::Stub& stub, const Options& options,
                   const v1::CreateJobRequest& request) {
  grpc::ClientContext context;
  tessera::contract::prepare_call(context, options.token, std::chrono::seconds(60));
  v1::CreateJobResponse response;
  const grpc::Status status = stub.CreateJob(&context, request, &response);
  if (!status.ok()) fprintf(stderr, "CreateJob: %s\n", status.error_message().c_str());
  return status.ok() ? response.job().id() : "";
}

/// Creates jobs that no worker can serve.
bool fill_queue(const Options& options, const std::shared_ptr<grpc::Channel>& channel,
                const std::string& scene) {
  std::atomic<int> next = 0;
  std::atomic<bool> failed = false;
  std::vector<std::thread> threads;
  for (int i = 0; i < options.clients; ++i) {
    threads.emplace_back([&] {
      const auto stub = v1::JobService::NewStub(channel);
      for (int k = next++; k < options.queued && !failed; k = next++) {
        auto request = job_request(scene, "queued", k);
        request.set_required_tag("nobody");
        if (create(*stub, options, request).empty()) failed = true;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  return !failed;
}

/// Reads the events of a request until the stream ends; `take` gets each of them.
template <typename Take>
void read_events(v1::JobService::Stub& stub, grpc::ClientContext& context,
                 const v1::WatchEventsRequest& request, Take take) {
  const auto reader = stub.WatchEvents(&context, request);
  v1::WatchEventsResponse message;
  while (reader->Read(&message)) {
    for (const v1::Event& event : message.events()) take(event);
  }
  reader->Finish();
}

/// Returns the sequence number of the newest event.
std::int64_t newest_event(v1::JobService::Stub& stub, const Options& options) {
  grpc::ClientContext context;
  tessera::contract::prepare_call(context, options.token, std::chrono::seconds(60));
  std::int64_t sequence = 0;
  read_events(stub, context, {}, [&](const v1::Event& event) { sequence = event.sequence(); });
  return sequence;
}

/// Reports the jobs that end after the event `sequence`, until the stream is cancelled.
void watch_events(v1::JobService::Stub& stub, grpc::ClientContext& context, std::int64_t sequence,
                  OpenJobs& open) {
  v1::WatchEventsRequest request;
  request.set_follow(true);
  request.set_after_sequence(sequence);
  read_events(stub, context, request, [&](const v1::Event& event) {
    if (event.kind() == v1::Event::KIND_JOB_DONE) open.finished(event.job_id());
  });
}

/// Results of all clients.
struct Outcome {
  std::vector<double> create;
  Clock::time_point start;
  bool complete = false;
};

Outcome run_clients(const Options& options, const std::string& scene, OpenJobs& open) {
  std::atomic<int> next = 0;
  std::atomic<int> failed = 0;
  std::mutex mutex;
  Outcome outcome;
  outcome.start = Clock::now();
  std::vector<std::thread> threads;
  for (int i = 0; i < options.clients; ++i) {
    threads.emplace_back([&] {
      const auto channel = tessera::contract::open_channel(options.server, "");
      const auto stub = v1::JobService::NewStub(*channel);
      std::vector<double> times;
      for (int k = next++; k < options.jobs; k = next++) {
        open.reserve();
        const auto request = job_request(scene, "small", k);
        auto start = Clock::now();
        if (options.rate > 0) {  // from when it was due, so that a slow server is seen by all
          const std::chrono::duration<double> due(k / options.rate);
          start = outcome.start + std::chrono::duration_cast<Clock::duration>(due);
          std::this_thread::sleep_until(start);
        }
        const std::string id = create(*stub, options, request);
        times.push_back(seconds(Clock::now() - start));
        if (id.empty()) {
          ++failed;
          break;
        }
        open.created(id);
      }
      const std::lock_guard lock(mutex);
      outcome.create.insert(outcome.create.end(), times.begin(), times.end());
    });
  }
  for (std::thread& thread : threads) thread.join();
  outcome.complete = failed == 0 && open.wait_for(options.jobs);
  return outcome;
}

int run(const Options& options) {
  const auto channel = tessera::contract::open_channel(options.server, "");
  if (!channel.ok()) {
    fprintf(stderr, "%s\n", std::string(channel.status().message()).c_str());
    return 2;
  }
  const std::string scene = "{\"asset\": {\"version\": \"2.0\"}}";
  if (!tessera::bench::upload(*channel, options.token, scene)) return 1;
  if (!fill_queue(options, *channel, scene)) return 1;

  OpenJobs open(options.open);
  const auto events = v1::JobService::NewStub(*channel);
  grpc::ClientContext context;
  context.AddMetadata(tessera::contract::kTokenKey, options.token);
  // Read before the clients start: the events of 100,000 queued jobs would delay those of the
  // others.
  const std::int64_t newest = newest_event(*events, options);
  std::thread watcher([&] { watch_events(*events, context, newest, open); });
  const Outcome outcome = run_clients(options, scene, open);
  context.TryCancel();
  watcher.join();

  printf("{\"jobs\": %d, \"clients\": %d, \"queued\": %d, \"complete\": %s, ", options.jobs,
         options.clients, options.queued, outcome.complete ? "true" : "false");
  print_percentiles("create", outcome.create);
  print_percentiles("turnaround", open.turnaround());
  const double wall = seconds(open.last() - outcome.start);
  printf("\"wall_seconds\": %.3f, \"jobs_per_second\": %.0f}\n", wall, options.jobs / wall);
  if (!options.answers.empty() && !open.write_answers(options.answers)) {
    fprintf(stderr, "%s: cannot be written\n", options.answers.c_str());
    return 1;
  }
  return outcome.complete ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {  // NOLINT(bugprone-exception-escape): a bench may die of one
  Options options;
  CLI::App app("Many small jobs for tests/bench/coordinator.");
  tessera::bench::add_server_options(app, options.server, options.token);
  app.add_option("--clients", options.clients, "clients that create jobs")->capture_default_str();
  app.add_option("--jobs", options.jobs, "jobs to create and finish")->capture_default_str();
  app.add_option("--queued", options.queued, "jobs created before, which no worker can serve")
      ->capture_default_str();
  app.add_option("--rate", options.rate, "jobs a second, at most; 0: as many as possible");
  app.add_option("--answers", options.answers,
                 "file for the ID of each job and the time of CreateJob's answer");
  app.add_option("--open", options.open, "most jobs created and not finished")
      ->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  return run(options);
}
