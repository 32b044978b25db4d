#include "server/service/streams/event_stream.h"

#include <chrono>
#include <mutex>

#include "absl/strings/str_cat.h"
#include "server/service/messages/messages.h"
#include "server/service/streams/polling_stream.h"

namespace tessera::server {
namespace {

constexpr std::chrono::milliseconds kEventPoll{100};
constexpr std::size_t kEventsPerMessage = 256;

/// Polls with a timer and sends new events.
class EventStream final : public PollingStream<v1::WatchEventsResponse> {
 public:
  EventStream(Coordinator& coordinator, const Access& access, const v1::WatchEventsRequest& request,
              const absl::StatusOr<Caller>& caller)
      : coordinator_(coordinator),
        access_(access),
        caller_(caller.value_or(Caller{})),
        follow_(request.follow()),
        query_{request.after_sequence(), request.job_id(), caller_.visible_owner()} {
    const std::lock_guard lock(mutex_);
    const std::int64_t newest = coordinator_.events().newest();
    if (!caller.ok()) {
      finish(caller.status());
    } else if (query_.after > newest) {
      finish(absl::OutOfRangeError(absl::StrCat("after_sequence ", query_.after,
                                                " is newer than the last event ", newest,
                                                "; was the store replaced?")));
    } else {
      EventStream::poll();
    }
  }

  void OnWriteDone(bool ok) override {
    const std::lock_guard lock(mutex_);
    poll_unless_cancelled(ok);
  }

 private:
  void poll() override {
    if (absl::Status status = access_.recheck(caller_); !status.ok()) return finish(status);
    const std::vector<Event> events = coordinator_.events().read(query_, kEventsPerMessage);
    if (events.empty()) return follow_ ? wait(kEventPoll) : finish(absl::OkStatus());
    query_.after = events.back().sequence;
    response_.Clear();
    for (const Event& event : events) *response_.add_events() = to_message(event);
    StartWrite(&response_);
  }

  Coordinator& coordinator_;
  const Access& access_;
  const Caller caller_;
  const bool follow_;
  EventLog::Query query_;
  v1::WatchEventsResponse response_;
};

}  // namespace

grpc::ServerWriteReactor<v1::WatchEventsResponse>* watch_events(
    Coordinator& coordinator, const Access& access, const v1::WatchEventsRequest& request,
    const absl::StatusOr<Caller>& caller) {
  return new EventStream(coordinator, access, request, caller);
}

}  // namespace tessera::server
