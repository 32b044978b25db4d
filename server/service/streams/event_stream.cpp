#include "server/service/streams/event_stream.h"

#include <algorithm>
#include <chrono>
#include <memory>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/strings/str_cat.h"
#include "server/service/messages/messages.h"
#include "server/service/quotas/refusal.h"
#include "server/service/streams/polling_stream.h"
#include "server/service/streams/stream_reader.h"
#include "server/sync/mutex.h"

namespace tessera::server {
namespace {

/// Pause after a message, so that the events of a busy farm are sent many at a time.
constexpr std::chrono::milliseconds kPause{100};
constexpr std::size_t kEventsPerMessage = 256;

/// Sends new events when there are some. Those that are no longer in memory are read from the
/// store, on a thread for files.
class EventStream final : public PollingStream<v1::WatchEventsResponse> {
 public:
  EventStream(Coordinator& coordinator, const Access& access, IoPool& io,
              const v1::WatchEventsRequest& request, const absl::StatusOr<Caller>& caller)
      : coordinator_(coordinator),
        access_(access),
        io_(io),
        caller_(caller.value_or(Caller{})),
        follow_(request.follow()),
        query_{request.after_sequence(), request.job_id(), caller_.visible_owner()} {
    if (!caller.ok()) {
      refuse(*this, caller.status());
      return;
    }
    coordinator_.queries().after_answers([this] {
      const MutexLock lock(mutex_);
      start();
    });
  }

  void OnWriteDone(bool ok) override {
    const MutexLock lock(mutex_);
    const bool has_more = response_.events_size() == static_cast<int>(kEventsPerMessage);
    if (!ok || !follow_ || has_more) return poll_unless_cancelled(ok);
    wait(kPause);
  }

 private:
  void detach() override {
    reader_->detach();
    coordinator_.farm().events().forget_reader(reader_);
  }

  void start() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    const std::int64_t newest = coordinator_.farm().events().newest();
    if (query_.after <= newest) return poll_unless_cancelled(true);
    finish(absl::OutOfRangeError(absl::StrCat("after_sequence ", query_.after,
                                              " is newer than the last event ", newest,
                                              "; was the store replaced?")));
  }

  void poll() override ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    if (absl::Status status = access_.recheck(caller_); !status.ok()) return finish(status);
    const std::int64_t dropped = coordinator_.queries().last_dropped_event();
    if (query_.after != 0 && query_.after < dropped) {
      return finish(absl::DataLossError(
          absl::StrCat("events between ", query_.after, " and ", dropped,
                       " are no longer kept; 0 starts with the oldest one that is")));
    }
    if (query_.after < coordinator_.farm().events().complete_after()) {
      return io_.post([this, query = query_] { read_stored(query); });
    }
    const std::int64_t newest = coordinator_.farm().events().newest();
    const auto events = coordinator_.farm().events().read(query_, kEventsPerMessage);
    if (!events.empty()) return send(events);
    if (!follow_) return finish(absl::OkStatus());
    query_.after = std::max(query_.after, newest);  // the others are not for this stream
    const bool waits = coordinator_.farm().events().wake_after(newest, reader_);
    wait(waits ? kRecheck : kPause);
  }

  /// Reads events up to those that are in memory.
  void read_stored(const EventQuery& query) {
    const std::int64_t end = coordinator_.farm().events().complete_after();
    auto stored = coordinator_.queries().stored_events(query, kEventsPerMessage);
    const MutexLock lock(mutex_);
    if (!stored.ok()) return finish(stored.status());
    std::erase_if(*stored, [end](const Event& event) { return event.sequence > end; });
    const bool is_page = stored->size() == kEventsPerMessage;
    const std::int64_t last = is_page ? stored->back().sequence : end;
    auto events = coordinator_.farm().events().with_lines(*std::move(stored), query, last);
    if (events.size() > kEventsPerMessage) events.resize(kEventsPerMessage);
    if (!events.empty()) return send(events);
    query_.after = end;
    poll_unless_cancelled(true);
  }

  /// Requires events.
  void send(const std::vector<Event>& events) ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
    query_.after = events.back().sequence;
    response_.Clear();
    for (const Event& event : events) *response_.add_events() = to_message(event);
    StartWrite(&response_);
  }

  Coordinator& coordinator_;
  const Access& access_;
  IoPool& io_;
  const Caller caller_;
  const bool follow_;
  EventQuery query_ ABSL_GUARDED_BY(mutex_);
  v1::WatchEventsResponse response_ ABSL_GUARDED_BY(mutex_);
  const std::shared_ptr<StreamReader<EventStream>> reader_ =
      std::make_shared<StreamReader<EventStream>>(*this);
};

}  // namespace

grpc::ServerWriteReactor<v1::WatchEventsResponse>* watch_events(
    Coordinator& coordinator, const Access& access, IoPool& io,
    const v1::WatchEventsRequest& request, const absl::StatusOr<Caller>& caller) {
  return new EventStream(coordinator, access, io, request, caller);
}

}  // namespace tessera::server
