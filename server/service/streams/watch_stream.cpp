#include "server/service/streams/watch_stream.h"

#include <algorithm>
#include <chrono>
#include <optional>
#include <string>

#include "absl/base/thread_annotations.h"
#include "server/service/messages/job_messages.h"
#include "server/service/quotas/refusal.h"
#include "server/service/streams/polling_stream.h"
#include "server/sync/mutex.h"

namespace tessera::server {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kDefaultInterval{500}, kMinInterval{100}, kMaxInterval{60'000};
/// Progress is sent less often. Short jobs are polled more often, so that waiting for a poll adds
/// at most an eighth to their time.
constexpr milliseconds kMinPoll{4}, kMaxPoll{50};
constexpr int kShareOfTime = 8;

milliseconds watch_interval(const v1::WatchJobRequest& request) {
  if (!request.has_interval()) return kDefaultInterval;
  const auto& interval = request.interval();
  const std::int64_t wanted =
      std::clamp<std::int64_t>(interval.seconds(), 0, 60) * 1000 + interval.nanos() / 1'000'000;
  return std::clamp(milliseconds(wanted), kMinInterval, kMaxInterval);
}

/// Polls the job with a timer and sends changes.
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
  void poll() override ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (absl::Status status = access_.recheck(caller_); !status.ok()) return finish(status);
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

  void wait_for_change() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const auto watched =
        std::chrono::duration_cast<milliseconds>(std::chrono::steady_clock::now() - start_);
    wait(std::clamp(watched / kShareOfTime, kMinPoll, kMaxPoll));
  }

  Coordinator& coordinator_;
  const Access& access_;
  const Caller caller_;
  const std::string job_id_;
  const milliseconds interval_;
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  bool has_ended_ ABSL_GUARDED_BY(mutex_) = false;
  std::optional<JobView> sent_ ABSL_GUARDED_BY(mutex_);
  std::chrono::steady_clock::time_point sent_at_ ABSL_GUARDED_BY(mutex_);
  v1::WatchJobResponse response_ ABSL_GUARDED_BY(mutex_);
};

}  // namespace

grpc::ServerWriteReactor<v1::WatchJobResponse>* watch_job(Coordinator& coordinator,
                                                          const Access& access,
                                                          const v1::WatchJobRequest& request,
                                                          const absl::StatusOr<Caller>& caller) {
  return new WatchStream(coordinator, access, request, caller);
}

}  // namespace tessera::server
