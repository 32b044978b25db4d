#include "server/service/streams/work_stream.h"

#include <grpcpp/alarm.h>

#include <algorithm>
#include <chrono>
#include <deque>
#include <memory>
#include <optional>
#include <set>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "rpc/rpc_status.h"
#include "server/service/access/numerics_check.h"
#include "server/service/access/protocol_check.h"
#include "server/service/messages/job_messages.h"
#include "server/service/messages/messages.h"
#include "server/service/streams/stream_link.h"
#include "server/sync/mutex.h"

namespace tessera::server {
namespace {

constexpr std::size_t kAcknowledgementsPerMessage = 4096;  // far below the maximum message size
constexpr std::size_t kLeasesPerMessage = 4096;
constexpr std::size_t kMaxDescribedAssets = 64;
constexpr std::size_t kMaxDescriptionBytes = 16 << 10;  // of a job
constexpr std::size_t kDescriptionBytesPerMessage = 256 << 10;
constexpr std::size_t kMaxLogBytes = 8 << 10;
constexpr int kMaxLogLines = 64;  // per message; further lines are ignored
/// Time for the pending write when the stream ends.
constexpr std::chrono::seconds kFinishTimeout{1};

std::vector<UnitName> unit_names(const google::protobuf::RepeatedPtrField<v1::UnitId>& units) {
  std::vector<UnitName> names;
  names.reserve(static_cast<std::size_t>(units.size()));
  for (const v1::UnitId& unit : units) names.push_back(from_message(unit));
  return names;
}

std::vector<LogLine> log_lines(const v1::LogLines& message) {
  const int count = std::min(message.lines_size(), kMaxLogLines);
  std::vector<LogLine> lines;
  lines.reserve(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) {
    lines.push_back({message.lines(i).job_id(), message.lines(i).message()});
  }
  return lines;
}

/// Returns seconds sent by a worker; 0 for an invalid duration.
double valid_seconds(double seconds) {
  constexpr double kMaxSeconds = 1e9;
  return seconds >= 0 && seconds <= kMaxSeconds ? seconds : 0;
}

void write_revocations(const std::vector<UnitName>& units, std::deque<v1::WorkResponse>& out) {
  for (std::size_t i = 0; i < units.size(); ++i) {
    if (i % kAcknowledgementsPerMessage == 0) out.emplace_back();
    *out.back().mutable_revocation()->add_units() = to_message(units[i]);
  }
}

/// Writes leases after the descriptions of their jobs. Large jobs are not described, nor those that
/// have ended, because the worker would keep their descriptions.
void write_leases(const Outbox& outbox, std::deque<v1::WorkResponse>& out) {
  const std::set<std::string_view> ended(outbox.ended_jobs.begin(), outbox.ended_jobs.end());
  std::size_t job_bytes = 0;  // of the last message
  for (const std::shared_ptr<const JobSpec>& spec : outbox.new_jobs) {
    if (ended.count(spec->id) > 0 || spec->assets.size() > kMaxDescribedAssets) continue;
    v1::JobDescription job = describe(*spec);
    const std::size_t bytes = job.ByteSizeLong();
    if (bytes > kMaxDescriptionBytes) continue;
    if (job_bytes == 0 || job_bytes + bytes > kDescriptionBytesPerMessage) {
      out.emplace_back();
      job_bytes = 0;
    }
    job_bytes += bytes;
    *out.back().mutable_leases()->add_jobs() = std::move(job);
  }
  for (std::size_t i = 0; i < outbox.leases.size(); ++i) {
    const bool is_full = i % kLeasesPerMessage == 0;
    if (is_full && (i > 0 || job_bytes == 0)) out.emplace_back();
    *out.back().mutable_leases()->add_leases() = to_message(outbox.leases[i]);
  }
}

/// Converts an outbox to messages, acknowledgements first, because they free memory of the worker.
void write_outbox(const Outbox& outbox, std::deque<v1::WorkResponse>& out) {
  for (std::size_t i = 0; i < outbox.acknowledgements.size(); ++i) {
    if (i % kAcknowledgementsPerMessage == 0) out.emplace_back();
    *out.back().mutable_acknowledgements()->add_acknowledgements() =
        to_message(outbox.acknowledgements[i]);
  }
  write_revocations(outbox.revoked, out);
  for (const std::string& job_id : outbox.ended_jobs) {
    out.emplace_back();
    out.back().mutable_job_ended()->set_job_id(job_id);
  }
  if (outbox.drain) out.emplace_back().mutable_drain();
  write_leases(outbox, out);
  write_revocations(outbox.withdrawn, out);
}

class WorkStream;

/// The coordinator's reference to a stream; outlives it and then does nothing.
class StreamConnection final : public WorkerConnection {
 public:
  explicit StreamConnection(WorkStream& stream) : link_(stream) {}
  void wake() override;
  void close(const absl::Status& reason) override;
  void cut();
  void detach() { link_.detach(); }

 private:
  StreamLink<WorkStream> link_;
};

class WorkStream final : public grpc::ServerBidiReactor<v1::WorkRequest, v1::WorkResponse> {
 public:
  WorkStream(const WorkStreamContext& services, grpc::CallbackServerContext& context,
             const absl::StatusOr<Caller>& caller)
      : services_(services),
        coordinator_(services.coordinator),
        context_(context),
        caller_(caller.value_or(Caller{})),
        connection_(std::make_shared<StreamConnection>(*this)) {
    if (caller.ok()) {
      StartRead(&request_);
      // Without a timeout a silent caller would keep its stream forever.
      hello_alarm_.Set(
          std::chrono::system_clock::now() + services_.hello_timeout,
          [connection = connection_](bool is_due) {
            if (is_due) {
              connection->close(absl::DeadlineExceededError("timed out waiting for Hello"));
            }
          });
    } else {
      finish(caller.status());
    }
  }

  void OnReadDone(bool ok) override {
    absl::Status status = ok ? services_.access.recheck(caller_) : absl::OkStatus();
    if (!ok || !status.ok()) return finish(status);
    const std::optional<Session> session = this->session();
    status = session ? take(*session) : begin();
    if (!status.ok()) return finish(status);
    if (!session) return;  // finish_admission() reads on
    const MutexLock lock(mutex_);
    if (!final_status_) StartRead(&request_);
  }

  void OnWriteDone(bool ok) override {
    const MutexLock lock(mutex_);
    is_writing_ = false;
    if (!out_.empty()) out_.pop_front();
    if (final_status_) {
      Finish(contract::to_rpc(*final_status_));
    } else if (ok) {
      write_next();
    }
  }

  void OnDone() override {
    connection_->detach();
    const std::optional<Session> session = this->session();  // waits for calls that hold the lock
    if (session) coordinator_.workers().disconnect(*session);
    delete this;
  }

  /// Sends pending messages unless a write is running, after which OnWriteDone continues.
  void pump() {
    const MutexLock lock(mutex_);
    if (!is_writing_) write_next();
  }

  void cut() { context_.TryCancel(); }

  void finish(const absl::Status& status) {
    const MutexLock lock(mutex_);
    if (final_status_) return;
    final_status_ = status;
    if (is_being_admitted_)
      return;  // finish_admission() ends the call; it needs this object until then
    if (is_writing_) {
      // OnWriteDone finishes the call; a write to a frozen peer would never end.
      finish_alarm_.Set(std::chrono::system_clock::now() + kFinishTimeout,
                        [connection = connection_](bool is_due) {
                          if (is_due) connection->cut();
                        });
    } else {
      Finish(contract::to_rpc(status));
    }
  }

 private:
  std::optional<Session> session() {
    const MutexLock lock(mutex_);
    return session_;
  }

  void write_next() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (final_status_ || !session_) return;
    if (out_.empty()) write_outbox(coordinator_.workers().take_outbox(*session_), out_);
    if (out_.empty()) return;
    is_writing_ = true;
    StartWrite(&out_.front());
  }

  absl::Status take(Session session) {
    switch (request_.event_case()) {
      case v1::WorkRequest::kHeartbeat:
        coordinator_.workers().heartbeat(session, unit_names(request_.heartbeat().started()),
                                         request_.heartbeat().rss_bytes());
        break;
      case v1::WorkRequest::kCredits:
        if (request_.credits().unit_count() < 1) {
          return absl::InvalidArgumentError("credits.unit_count: must be at least 1");
        }
        coordinator_.workers().grant_credits(session, request_.credits().unit_count());
        break;
      case v1::WorkRequest::kFailure:
        take_failure(session, request_.failure());
        break;
      case v1::WorkRequest::kReturned:
        coordinator_.workers().return_units(session, unit_names(request_.returned().units()),
                                            request_.returned().lacks_files());
        break;
      case v1::WorkRequest::kDraining:
        coordinator_.workers().begin_draining(session);
        break;
      case v1::WorkRequest::kSceneLoaded: {
        const v1::SceneLoaded& loaded = request_.scene_loaded();
        coordinator_.workers().scene_loaded(
            session, loaded.job_id(),
            {valid_seconds(loaded.load_seconds()), valid_seconds(loaded.build_seconds()),
             loaded.peak_rss_bytes(), valid_seconds(loaded.accelerator_build_seconds()),
             loaded.accelerator_bytes()});
        break;
      }
      case v1::WorkRequest::kLogLines:
        coordinator_.workers().take_log_lines(session, log_lines(request_.log_lines()));
        break;
      case v1::WorkRequest::kHello:
        return absl::InvalidArgumentError("hello: only allowed as the first message");
      case v1::WorkRequest::EVENT_NOT_SET:
        break;  // unknown event of a newer worker; counts as contact
    }
    coordinator_.workers().record_contact(session);
    return absl::OkStatus();
  }

  void take_failure(Session session, const v1::UnitFailure& failure) {
    coordinator_.workers().fail_unit(
        session, from_message(failure.lease()), failure.tile(),
        {"", cut_text(failure.message(), kMaxLogBytes), cut_text(failure.log_tail(), kMaxLogBytes)},
        static_cast<absl::StatusCode>(failure.code()));
  }

  absl::Status begin() {
    hello_alarm_.Cancel();
    if (!request_.has_hello()) {
      return absl::InvalidArgumentError("the first message must be Hello");
    }
    const v1::WorkerHello& message = request_.hello();
    absl::Status status = check_protocol("worker", message.protocol_version());
    if (status.ok()) status = check_numerics(message.contract_version(), message.numerics_sha256());
    if (!status.ok()) return status;
    auto hello = from_message(message);
    if (!hello.ok()) return hello.status();
    hello->certificate = caller_.certificate();
    {
      const MutexLock lock(mutex_);
      if (final_status_) return *final_status_;  // timed out just now; this may soon be destroyed
      is_being_admitted_ = true;  // only finish_admission() runs before the next read
    }
    services_.admission.admit(caller_, hello->worker_id, sent_token(context_),
                              [this, hello = *hello](const absl::StatusOr<std::string>& key) {
                                finish_admission(hello, key);
                              });
    return absl::OkStatus();
  }

  /// Sends Welcome to an admitted worker and reads on. On any thread.
  void finish_admission(const Hello& hello, const absl::StatusOr<std::string>& session_key) {
    absl::Status refusal = session_key.status();
    // A stream that has ended meanwhile must not replace a newer one of its worker.
    if (context_.IsCancelled()) refusal = absl::CancelledError("the worker has left");
    std::optional<WorkerRegistry::Joined> joined;
    if (refusal.ok()) joined = coordinator_.workers().join(hello, connection_);
    const MutexLock lock(mutex_);
    is_being_admitted_ = false;
    if (joined) session_ = joined->session;
    if (!joined && !final_status_) final_status_ = refusal;
    if (final_status_) return Finish(contract::to_rpc(*final_status_));
    write_welcome(*joined, *session_key);
    StartRead(&request_);
  }

  void write_welcome(const WorkerRegistry::Joined& joined, const std::string& session_key)
      ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    v1::Welcome& welcome = *out_.emplace_back().mutable_welcome();
    welcome.set_session_key(session_key);
    welcome.set_store_id(joined.store_id);
    welcome.mutable_heartbeat_interval()->set_seconds(joined.heartbeat_ms / 1000);
    welcome.mutable_heartbeat_interval()->set_nanos(joined.heartbeat_ms % 1000 * 1'000'000);
    welcome.mutable_timeout()->set_seconds(joined.timeout_ms / 1000);
    welcome.mutable_timeout()->set_nanos(joined.timeout_ms % 1000 * 1'000'000);
    write_next();
  }

  const WorkStreamContext services_;
  Coordinator& coordinator_;
  grpc::CallbackServerContext& context_;
  const Caller caller_;
  const std::shared_ptr<StreamConnection> connection_;  // owners: this and the coordinator
  grpc::Alarm hello_alarm_;                             // until the hello
  grpc::Alarm finish_alarm_;                            // limits the last write
  v1::WorkRequest request_;                             // of the pending read

  Mutex mutex_ ABSL_ACQUIRED_AFTER(lock_order::kStream)
      ABSL_ACQUIRED_BEFORE(lock_order::kFarm){lock_order::kStream};
  bool is_being_admitted_ ABSL_GUARDED_BY(mutex_) = false;  // between Hello and Welcome
  std::optional<Session> session_ ABSL_GUARDED_BY(mutex_);
  std::deque<v1::WorkResponse> out_ ABSL_GUARDED_BY(mutex_);  // the front message is being written
  bool is_writing_ ABSL_GUARDED_BY(mutex_) = false;
  std::optional<absl::Status> final_status_ ABSL_GUARDED_BY(mutex_);
};

void StreamConnection::wake() {
  link_.with([](WorkStream& stream) { stream.pump(); });
}

void StreamConnection::close(const absl::Status& reason) {
  link_.with([&](WorkStream& stream) { stream.finish(reason); });
}

void StreamConnection::cut() {
  link_.with([](WorkStream& stream) { stream.cut(); });
}

}  // namespace

grpc::ServerBidiReactor<v1::WorkRequest, v1::WorkResponse>* work_stream(
    const WorkStreamContext& services, grpc::CallbackServerContext& context,
    const absl::StatusOr<Caller>& caller) {
  return new WorkStream(services, context, caller);
}

}  // namespace tessera::server
