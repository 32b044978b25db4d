#include "server/service/streams/deliver_stream.h"

#include <memory>

#include "absl/base/thread_annotations.h"
#include "rpc/rpc_status.h"
#include "server/service/messages/block_assembly.h"
#include "server/sync/mutex.h"

namespace tessera::server {
namespace {

class DeliverStream;

/// State of a stream; lets the coordinator call a stream that may have ended.
struct DeliverHandle {
  Mutex mutex ABSL_ACQUIRED_AFTER(lock_order::kStream)
      ABSL_ACQUIRED_BEFORE(lock_order::kFarm){lock_order::kStream};
  DeliverStream* stream ABSL_GUARDED_BY(mutex) = nullptr;
  bool is_waiting ABSL_GUARDED_BY(mutex) = false;  // for room; no read is pending
  bool is_cancelled ABSL_GUARDED_BY(mutex) = false;
  bool is_finished ABSL_GUARDED_BY(mutex) = false;
};

/// Reads while there is room, else waits for the coordinator's callback.
class DeliverStream final : public grpc::ServerReadReactor<v1::DeliverRequest> {
 public:
  DeliverStream(Coordinator& coordinator, const absl::StatusOr<Caller>& caller)
      : coordinator_(coordinator),
        caller_(caller.value_or(Caller{})),
        blocks_(coordinator, caller_.certificate()),
        handle_(std::make_shared<DeliverHandle>()) {
    {
      const MutexLock lock(handle_->mutex);
      handle_->stream = this;
    }
    if (caller.ok()) {
      StartRead(&request_);
    } else {
      Finish(contract::to_rpc(caller.status()));
    }
  }

  void OnReadDone(bool ok) override {
    const absl::Status status = ok ? blocks_.take(request_) : absl::OkStatus();
    const MutexLock lock(handle_->mutex);
    if (!ok || !status.ok() || handle_->is_cancelled) {
      handle_->is_finished = true;
      Finish(contract::to_rpc(status));
      return;
    }
    handle_->is_waiting = true;
    const auto resume_later = [handle = handle_] {
      const MutexLock resume_lock(handle->mutex);
      if (handle->stream != nullptr) DeliverStream::resume(*handle);
    };
    if (coordinator_.intake().has_room_or_call(resume_later)) resume(*handle_);
  }

  void OnCancel() override {
    const MutexLock lock(handle_->mutex);
    handle_->is_cancelled = true;
    // Unless it waits, the pending read fails and ends the call.
    if (!handle_->is_waiting || handle_->is_finished) return;
    handle_->is_waiting = false;
    handle_->is_finished = true;
    Finish(contract::to_rpc(absl::CancelledError("worker disconnected")));
  }

  void OnDone() override {
    {
      const MutexLock lock(handle_->mutex);
      handle_->stream = nullptr;
    }
    delete this;
  }

 private:
  /// Reads on if the stream waits for room.
  static void resume(DeliverHandle& handle) ABSL_EXCLUSIVE_LOCKS_REQUIRED(handle.mutex) {
    if (!handle.is_waiting) return;
    handle.is_waiting = false;
    handle.stream->StartRead(&handle.stream->request_);
  }

  Coordinator& coordinator_;
  const Caller caller_;  // holds its place in the table of open streams
  BlockAssembly blocks_;
  v1::DeliverRequest request_;
  const std::shared_ptr<DeliverHandle> handle_;  // owners: this and pending callbacks
};

}  // namespace

grpc::ServerReadReactor<v1::DeliverRequest>* deliver_stream(Coordinator& coordinator,
                                                            const absl::StatusOr<Caller>& caller) {
  return new DeliverStream(coordinator, caller);
}

}  // namespace tessera::server
