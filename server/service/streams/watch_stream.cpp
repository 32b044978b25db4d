#include "server/service/streams/watch_stream.h"

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "absl/base/thread_annotations.h"
#include "server/service/messages/job_messages.h"
#include "server/service/quotas/refusal.h"
#include "server/service/streams/polling_stream.h"
#include "server/service/streams/stream_reader.h"
#include "server/sync/mutex.h"

namespace tessera::server {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kDefaultInterval{500}, kMinInterval{100}, kMaxInterval{60'000};
/// Polls per interval of a job without progress.
constexpr int kPollsPerInterval = 4;

milliseconds watch_interval(const v1::WatchJobRequest& request) {
  if (!request.has_interval()) return kDefaultInterval;
  const auto& interval = request.interval();
  const std::int64_t wanted =
      std::clamp<std::int64_t>(interval.seconds(), 0, 60) * 1000 + interval.nanos() / 1'000'000;
  return std::clamp(milliseconds(wanted), kMinInterval, kMaxInterval);
}

/// Sends the job's states as soon as they change, and its progress at intervals.
class WatchStream final : public PollingStream<v1::WatchJobResponse> {
 public:
  WatchStream(Coordinator& coordinator, const Access& access, const v1::WatchJobRequest& request,
              const absl::StatusOr<Caller>& caller)
      : coordinator_(coordinator),
        access_(access),
        caller_(caller.value_or(Caller{})),
        job_id_(request.job_id()),
        interval_(watch_interval(request)) {
    const MutexLock lock(mutex_);
    if (!caller.ok()) {
      refuse(*this, caller.status());
    } else {
      WatchStream::poll();
    }
  }

  void OnWriteDone(bool ok) override {
    const MutexLock lock(mutex_);
    if (ok && has_ended_) return finish(absl::OkStatus());
    if (ok) return wait_for_change();
    poll_unless_cancelled(ok);
  }

 private:
  void detach() override {
    reader_->detach();
    coordinator_.farm().events().forget_reader(job_id_, reader_);
  }

  void poll() override ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (absl::Status status = access_.recheck(caller_); !status.ok()) return finish(status);
    seen_ = coordinator_.farm().events().newest();
    const auto view = coordinator_.queries().job(job_id_);
    if (!view.ok()) return finish(view.status());
    const auto now = std::chrono::steady_clock::now();
    const bool is_new = !sent_ || sent_->state != view->state || sent_->reason != view->reason;
    const bool has_moved =
        sent_ && (sent_->committed_unit_count != view->committed_unit_count ||
                  sent_->leased_unit_count != view->leased_unit_count ||
                  sent_->finished_frame_count != view->finished_frame_count ||
                  sent_->worker_count != view->worker_count ||
                  sent_->estimated_error != view->estimated_error || sent_->spec != view->spec);
    if (!is_new && !(has_moved && now - sent_at_ >= interval_)) return wait_for_change();
    sent_ = *view;
    sent_at_ = now;
    has_ended_ = tessera::server::has_ended(view->state);
    *response_.mutable_job() = to_message(*view);
    StartWrite(&response_);
  }

  /// Waits until the state changes or progress is due.
  void wait_for_change() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (!coordinator_.farm().events().wake_after_change(seen_, job_id_, reader_)) {
      return wait(milliseconds(0));  // it has changed since poll()
    }
    const auto until_due = std::chrono::duration_cast<milliseconds>(
        sent_at_ + interval_ - std::chrono::steady_clock::now());
    wait(std::min(std::max(until_due, interval_ / kPollsPerInterval), kRecheck));
  }

  Coordinator& coordinator_;
  const Access& access_;
  const Caller caller_;
  const std::string job_id_;
  const milliseconds interval_;
  std::int64_t seen_ ABSL_GUARDED_BY(mutex_) = 0;  // newest event before the last poll
  bool has_ended_ ABSL_GUARDED_BY(mutex_) = false;
  std::optional<JobView> sent_ ABSL_GUARDED_BY(mutex_);
  std::chrono::steady_clock::time_point sent_at_ ABSL_GUARDED_BY(mutex_);
  v1::WatchJobResponse response_ ABSL_GUARDED_BY(mutex_);
  const std::shared_ptr<StreamReader<WatchStream>> reader_ =
      std::make_shared<StreamReader<WatchStream>>(*this);
};

}  // namespace

grpc::ServerWriteReactor<v1::WatchJobResponse>* watch_job(Coordinator& coordinator,
                                                          const Access& access,
                                                          const v1::WatchJobRequest& request,
                                                          const absl::StatusOr<Caller>& caller) {
  return new WatchStream(coordinator, access, request, caller);
}

}  // namespace tessera::server
