#include "server/service/streams/frame_stream.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "rpc/rpc_status.h"
#include "server/service/messages/messages.h"
#include "server/service/quotas/refusal.h"

namespace tessera::server {
namespace {

constexpr std::size_t kChunkBytes = 1 << 20;

/// Sends the header, then chunks; one write or read at a time, so that it needs no lock.
class FrameStream final : public grpc::ServerWriteReactor<v1::FetchFrameResponse> {
 public:
  FrameStream(IoPool& io, Caller caller) : io_(io), caller_(std::move(caller)) {}

  void start(const absl::StatusOr<FrameFile>& file) {
    if (!file.ok()) return Finish(contract::to_rpc(file.status()));
    file_ = *file;
    if (!file_.path.empty()) {
      input_.open(file_.path, std::ios::binary);
      if (!input_) {
        return Finish(
            contract::to_rpc(absl::DataLossError(absl::StrCat("cannot read ", file_.path))));
      }
    }
    *response_.mutable_header() = to_message(file_);
    sent_tiles_ = static_cast<std::size_t>(response_.header().missing_tiles_size());
    StartWrite(&response_);
  }

  void OnWriteDone(bool ok) override {
    if (!ok) return Finish(contract::to_rpc(absl::CancelledError("client disconnected")));
    io_.post([this] { send_next(); });
  }

  void OnDone() override {
    std::error_code ignored;
    if (file_.is_temporary) std::filesystem::remove(file_.path, ignored);
    delete this;
  }

 private:
  void send_next() {
    if (sent_tiles_ < file_.missing_tiles.size()) {
      *response_.mutable_more_missing_tiles() = missing_tiles_from(file_, sent_tiles_);
      sent_tiles_ += static_cast<std::size_t>(response_.more_missing_tiles().tiles_size());
      return StartWrite(&response_);
    }
    const std::int64_t left = file_.size_bytes - sent_bytes_;
    if (left == 0) return Finish(grpc::Status::OK);
    const std::size_t size = std::min(static_cast<std::size_t>(left), kChunkBytes);
    std::string& chunk = *response_.mutable_chunk();
    if (file_.path.empty()) {
      chunk = file_.bytes.substr(static_cast<std::size_t>(sent_bytes_), size);
    } else {
      chunk.resize(size);
      if (!input_.read(chunk.data(), static_cast<std::streamsize>(size))) {
        return Finish(contract::to_rpc(
            absl::DataLossError(absl::StrCat(file_.path, " was truncated while it was sent"))));
      }
    }
    sent_bytes_ += static_cast<std::int64_t>(size);
    StartWrite(&response_);
  }

  IoPool& io_;
  const Caller caller_;  // holds its reservation in the stream limit
  FrameFile file_;
  std::ifstream input_;
  std::size_t sent_tiles_ = 0;
  std::int64_t sent_bytes_ = 0;
  v1::FetchFrameResponse response_;
};

}  // namespace

grpc::ServerWriteReactor<v1::FetchFrameResponse>* send_frame(Coordinator& coordinator, IoPool& io,
                                                             const v1::FetchFrameRequest& request,
                                                             const absl::StatusOr<Caller>& caller) {
  auto* stream = new FrameStream(io, caller.value_or(Caller{}));
  const auto query = from_message(request);
  if (!caller.ok()) {
    refuse(*stream, caller.status());
  } else if (!query.ok()) {
    stream->start(query.status());
  } else {
    coordinator.images().fetch_frame(*query, [stream](const auto& file) { stream->start(file); });
  }
  return stream;
}

}  // namespace tessera::server
