#include "server/service/streams/report_stream.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "rpc/rpc_status.h"
#include "server/service/quotas/refusal.h"

namespace tessera::server {
namespace {

constexpr std::size_t kPartBytes = 1 << 20;

/// Returns the end of the part of `text` that begins at `begin`, between two UTF-8 characters.
std::size_t part_end(const std::string& text, std::size_t begin) {
  std::size_t end = std::min(text.size(), begin + kPartBytes);
  while (end < text.size() && end > begin + 1 &&
         (static_cast<unsigned char>(text[end]) & 0xC0) == 0x80) {
    --end;
  }
  return end;
}

/// Sends one part after the other; one write at a time, so it needs no lock.
class ReportStream final : public grpc::ServerWriteReactor<v1::GetJobReportResponse> {
 public:
  ReportStream(IoPool& io, const absl::StatusOr<Caller>& caller,
               std::function<absl::StatusOr<std::string>()> read)
      : caller_(caller.value_or(Caller{})) {
    if (caller.ok()) {
      io.post([this, reader = std::move(read)] { start(reader()); });
    } else {
      refuse(*this, caller.status());
    }
  }

  void OnWriteDone(bool ok) override {
    if (!ok) return Finish(contract::to_rpc(absl::CancelledError("client disconnected")));
    if (sent_bytes_ == text_.size()) return Finish(grpc::Status::OK);
    write_next();
  }

  void OnDone() override { delete this; }

 private:
  void start(absl::StatusOr<std::string> report) {
    if (!report.ok()) return Finish(contract::to_rpc(report.status()));
    text_ = *std::move(report);
    write_next();
  }

  void write_next() {
    const std::size_t end = part_end(text_, sent_bytes_);
    response_.set_report_json(text_.substr(sent_bytes_, end - sent_bytes_));
    sent_bytes_ = end;
    StartWrite(&response_);
  }

  const Caller caller_;  // holds its reservation in the stream limit
  std::string text_;
  std::size_t sent_bytes_ = 0;
  v1::GetJobReportResponse response_;
};

}  // namespace

grpc::ServerWriteReactor<v1::GetJobReportResponse>* send_report(
    IoPool& io, const absl::StatusOr<Caller>& caller,
    std::function<absl::StatusOr<std::string>()> read) {
  return new ReportStream(io, caller, std::move(read));
}

}  // namespace tessera::server
