#include "worker/agent/server/worker_streams.h"

#include <chrono>
#include <utility>

#include "rpc/channel.h"
#include "rpc/rpc_status.h"

namespace tessera::agent {
namespace {

constexpr std::chrono::milliseconds kNoDeadline{0};  // heartbeats detect dead streams

}  // namespace

// A hold keeps the reactor alive while messages may be written outside its callbacks. It is
// released when writing is over: after finish(), or when the stream is broken.

WorkStream::WorkStream(v1::WorkerService::Stub& stub, const std::string& token, Listener listener)
    : listener_(std::move(listener)) {
  contract::prepare_call(context_, token, kNoDeadline);
  stub.async()->Work(&context_, this);
  AddHold();
  StartRead(&response_);
  StartCall();
}

void WorkStream::send(v1::WorkRequest request) {
  const std::lock_guard lock(mutex_);
  if (broken_ || finishing_) return;
  queue_.push_back(std::move(request));
  if (queue_.size() == 1) write_next();
}

void WorkStream::finish() {
  const std::lock_guard lock(mutex_);
  if (broken_ || finishing_) return;
  finishing_ = true;
  if (queue_.empty()) write_next();
}

void WorkStream::write_next() {
  if (!queue_.empty()) {
    StartWrite(&queue_.front());
  } else if (finishing_) {
    StartWritesDone();
    release_hold();
  }
}

void WorkStream::release_hold() {
  if (std::exchange(holding_, false)) RemoveHold();
}

void WorkStream::OnReadDone(bool ok) {
  if (ok) {
    listener_.on_response(std::move(response_));
    response_.Clear();
    StartRead(&response_);
    return;
  }
  const std::lock_guard lock(mutex_);
  broken_ = true;
  release_hold();
}

void WorkStream::OnWriteDone(bool ok) {
  const std::lock_guard lock(mutex_);
  queue_.pop_front();
  if (ok && !broken_) write_next();
  // If not ok, the read fails as well and ends the stream.
}

void WorkStream::OnDone(const grpc::Status& status) {
  const auto on_closed = std::move(listener_.on_closed);  // it may destroy this object
  on_closed(contract::from_rpc(status));
}

DeliverStream::DeliverStream(v1::WorkerService::Stub& stub, const std::string& token,
                             Listener listener)
    : listener_(std::move(listener)) {
  contract::prepare_call(context_, token, kNoDeadline);
  stub.async()->Deliver(&context_, &response_, this);
  AddHold();
  StartCall();
}

bool DeliverStream::has_room() {
  const std::lock_guard lock(mutex_);
  return !broken_ && !finishing_ && queue_.size() < kMaxQueued;
}

void DeliverStream::send(v1::DeliverRequest request) {
  const std::lock_guard lock(mutex_);
  if (broken_ || finishing_) return;
  queue_.push_back(std::move(request));
  if (queue_.size() == 1) write_next();
}

void DeliverStream::finish() {
  const std::lock_guard lock(mutex_);
  if (broken_ || finishing_) return;
  finishing_ = true;
  if (queue_.empty()) write_next();
}

void DeliverStream::write_next() {
  if (!queue_.empty()) {
    StartWrite(&queue_.front());
  } else if (finishing_) {
    StartWritesDone();
    release_hold();
  }
}

void DeliverStream::release_hold() {
  if (std::exchange(holding_, false)) RemoveHold();
}

void DeliverStream::cancel() {
  context_.TryCancel();
  const std::lock_guard lock(mutex_);
  broken_ = true;
  release_hold();
}

void DeliverStream::OnWriteDone(bool ok) {
  bool room = false;
  {
    const std::lock_guard lock(mutex_);
    queue_.pop_front();
    if (ok && !broken_) {
      write_next();
      room = !finishing_ && queue_.size() + 1 == kMaxQueued;
    } else {
      broken_ = true;
      release_hold();
    }
  }
  if (room) listener_.on_room();
}

void DeliverStream::OnDone(const grpc::Status& status) {
  const auto on_closed = std::move(listener_.on_closed);  // it may destroy this object
  on_closed(contract::from_rpc(status));
}

KeepaliveProbe::KeepaliveProbe(v1::WorkerService::Stub& stub, const std::string& token,
                               std::chrono::milliseconds timeout,
                               std::function<void(bool)> on_answer) {
  contract::prepare_call(context_, token, timeout);
  stub.async()->DescribeJob(
      &context_, &request_, &response_,
      [on_answer = std::move(on_answer)](const grpc::Status& status) {
        // Any answer of the server counts, including an error; these codes come from the channel.
        on_answer(status.error_code() != grpc::StatusCode::UNAVAILABLE &&
                  status.error_code() != grpc::StatusCode::DEADLINE_EXCEEDED &&
                  status.error_code() != grpc::StatusCode::CANCELLED);
      });
}

}  // namespace tessera::agent
