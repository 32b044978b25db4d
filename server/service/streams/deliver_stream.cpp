#include "server/service/streams/deliver_stream.h"

#include <memory>
#include <mutex>

#include "rpc/rpc_status.h"
#include "server/service/messages/block_assembly.h"

namespace tessera::server {
namespace {

class DeliverStream;

/// Lets the coordinator call a stream that may have ended.
struct DeliverHandle {
  std::mutex mutex;
  DeliverStream* stream = nullptr;
};

/// Reads while there is room, else waits for the coordinator's callback.
class DeliverStream final : public grpc::ServerReadReactor<v1::DeliverRequest> {
 public:
  DeliverStream(Coordinator& coordinator, const absl::StatusOr<Caller>& caller)
      : coordinator_(coordinator),
        caller_(caller.value_or(Caller{})),
        blocks_(coordinator, caller_.certificate()),
        handle_(std::make_shared<DeliverHandle>()) {
    handle_->stream = this;
    if (caller.ok()) {
      StartRead(&request_);
    } else {
      Finish(contract::to_rpc(caller.status()));
    }
  }

  void OnReadDone(bool ok) override {
    const absl::Status status = ok ? blocks_.take(request_) : absl::OkStatus();
    const std::lock_guard lock(handle_->mutex);
    if (!ok || !status.ok() || is_cancelled_) {
      is_finished_ = true;
      Finish(contract::to_rpc(status));
      return;
    }
    is_waiting_ = true;
    const auto resume = [handle = handle_] {
      const std::lock_guard resume_lock(handle->mutex);
      if (handle->stream != nullptr) handle->stream->resume();
    };
    if (coordinator_.intake().has_room_or_call(resume)) this->resume();
  }

  void OnCancel() override {
    const std::lock_guard lock(handle_->mutex);
    is_cancelled_ = true;
    if (!is_waiting_ || is_finished_) return;  // the pending read fails and ends the call
    is_waiting_ = false;
    is_finished_ = true;
    Finish(contract::to_rpc(absl::CancelledError("worker disconnected")));
  }

  void OnDone() override {
    const std::shared_ptr<DeliverHandle> handle = handle_;
    const std::lock_guard lock(handle->mutex);
    handle->stream = nullptr;
    delete this;
  }

 private:
  /// Requires the handle's lock.
  void resume() {
    if (!is_waiting_) return;
    is_waiting_ = false;
    StartRead(&request_);
  }

  Coordinator& coordinator_;
  const Caller caller_;  // holds its place in the table of open streams
  BlockAssembly blocks_;
  v1::DeliverRequest request_;
  const std::shared_ptr<DeliverHandle> handle_;  // owners: this and pending callbacks
  bool is_waiting_ = false;                      // waits for room; no read is pending
  bool is_cancelled_ = false, is_finished_ = false;
};

}  // namespace

grpc::ServerReadReactor<v1::DeliverRequest>* deliver_stream(Coordinator& coordinator,
                                                            const absl::StatusOr<Caller>& caller) {
  return new DeliverStream(coordinator, caller);
}

}  // namespace tessera::server
