#include "tests/bench/coordinator/simulated_worker.h"

#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <fstream>
#include <string>
#include <utility>

#include "contract/version.h"
#include "rpc/channel.h"
#include "rpc/protocol_version.h"
#include "rpc/settings_message.h"

namespace tessera::bench {
namespace {

constexpr std::size_t kChunkBytes = 64 << 10;

std::int64_t now_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(
             std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

}  // namespace

double Latencies::quantile_ms(double share) {
  const std::lock_guard lock(mutex_);
  if (microseconds_.empty()) return 0;
  std::sort(microseconds_.begin(), microseconds_.end());
  const auto index = static_cast<std::size_t>(share * static_cast<double>(microseconds_.size()));
  return 1e-3 * static_cast<double>(microseconds_[std::min(index, microseconds_.size() - 1)]);
}

bool FirstLeases::write(const std::string& path) {
  const std::lock_guard lock(mutex_);
  std::ofstream file(path);
  for (const auto& [job, us] : leased_us_) file << job << ' ' << us << '\n';
  return file.flush().good();
}

FilmShelf::FilmShelf(const std::shared_ptr<grpc::Channel>& channel, std::string token)
    : stub_(v1::WorkerService::NewStub(channel)), token_(std::move(token)) {}

void FilmShelf::set_token(const std::string& token) {
  const std::lock_guard lock(mutex_);
  token_ = token;
}

void FilmShelf::describe(const v1::JobDescription& job) {
  auto settings = contract::from_message(job.settings());
  if (!settings.ok()) return;
  const std::lock_guard lock(mutex_);
  films_.try_emplace(job.job_id(), std::make_unique<SimulatedFilm>(*settings));
}

const SimulatedFilm* FilmShelf::film(const std::string& job_id) {
  const std::lock_guard lock(mutex_);
  if (const auto found = films_.find(job_id); found != films_.end()) return found->second.get();
  grpc::ClientContext context;
  contract::prepare_call(context, token_, std::chrono::seconds(20));
  v1::DescribeJobRequest request;
  v1::DescribeJobResponse response;
  request.set_job_id(job_id);
  std::unique_ptr<SimulatedFilm> film;
  if (stub_->DescribeJob(&context, request, &response).ok()) {
    if (auto settings = contract::from_message(response.settings()); settings.ok()) {
      film = std::make_unique<SimulatedFilm>(*settings);
    }
  }
  return films_.emplace(job_id, std::move(film)).first->second.get();
}

/// The control stream. Writes go through a queue, one at a time. Heartbeats start writes outside
/// gRPC's reactions; the hold keeps the call alive until then.
class SimulatedWorker::WorkStream
    : public grpc::ClientBidiReactor<v1::WorkRequest, v1::WorkResponse> {
 public:
  explicit WorkStream(SimulatedWorker& worker) : worker_(worker) {}

  void open(v1::WorkerService::Stub& stub, const std::string& token) {
    context_.AddMetadata(contract::kTokenKey, token);
    stub.async()->Work(&context_, this);
    AddHold();  // until the last read
    StartRead(&incoming_);
    StartCall();
  }
  void send(v1::WorkRequest message) {
    const std::lock_guard lock(mutex_);
    if (over_) return;
    queue_.push_back(std::move(message));
    if (queue_.size() == 1) StartWrite(&queue_.front());
  }
  void OnWriteDone(bool ok) override {
    const std::lock_guard lock(mutex_);
    queue_.pop_front();
    if (ok && !queue_.empty()) StartWrite(&queue_.front());
  }
  void OnReadDone(bool ok) override {
    if (ok) {
      worker_.on_event(incoming_);
      StartRead(&incoming_);
      return;
    }
    {
      const std::lock_guard lock(mutex_);
      over_ = true;
    }
    RemoveHold();
  }
  void OnDone(const grpc::Status& status) override {
    ++worker_.counters_.closed;
    if (!status.ok() && !worker_.options_.reconnects) {
      fprintf(stderr, "Work: %s\n", status.error_message().c_str());
    }
    worker_.on_stream_ended(/*is_work=*/true);  // may destroy this stream
  }

 private:
  SimulatedWorker& worker_;
  grpc::ClientContext context_;
  v1::WorkResponse incoming_;
  std::mutex mutex_;
  std::deque<v1::WorkRequest> queue_;
  bool over_ = false;  // no more writes are allowed
};

/// The bulk stream: takes the next message from the worker when the previous one is written.
class SimulatedWorker::DeliverStream : public grpc::ClientWriteReactor<v1::DeliverRequest> {
 public:
  explicit DeliverStream(SimulatedWorker& worker) : worker_(worker) {}

  void open(v1::WorkerService::Stub& stub, const std::string& token, const std::string& id) {
    context_.AddMetadata(contract::kTokenKey, token);
    stub.async()->Deliver(&context_, &response_, this);
    AddHold();  // it stays open while idle
    StartCall();
    is_open_ = true;
    outgoing_.set_worker_id(id);
    writing_ = true;
    StartWrite(&outgoing_);
  }
  void wake() {
    const std::lock_guard lock(mutex_);
    if (is_open_ && !writing_) write_next();
  }
  /// Ends the stream if it is open.
  void end() {
    const std::lock_guard lock(mutex_);
    if (!std::exchange(is_open_, false)) return;
    context_.TryCancel();
    RemoveHold();
  }
  void OnWriteDone(bool ok) override {
    const std::lock_guard lock(mutex_);
    writing_ = false;
    if (ok && is_open_) write_next();
  }
  void OnDone(const grpc::Status& status) override {
    if (!status.ok() && !worker_.options_.reconnects) {
      fprintf(stderr, "Deliver: %s\n", status.error_message().c_str());
    }
    worker_.on_stream_ended(/*is_work=*/false);  // may destroy this stream
  }

 private:
  void write_next() {
    outgoing_.Clear();
    writing_ = worker_.next_delivery(outgoing_);
    if (writing_) StartWrite(&outgoing_);
  }

  SimulatedWorker& worker_;
  grpc::ClientContext context_;
  v1::DeliverResponse response_;
  v1::DeliverRequest outgoing_;
  std::mutex mutex_;
  bool is_open_ = false, writing_ = false;
};

SimulatedWorker::SimulatedWorker(std::shared_ptr<grpc::Channel> channel,
                                 SimulatedWorkerOptions options, FilmShelf& shelf,
                                 Counters& counters)
    : channel_(std::move(channel)),
      stub_(v1::WorkerService::NewStub(channel_)),
      options_(std::move(options)),
      shelf_(shelf),
      counters_(counters) {}

SimulatedWorker::~SimulatedWorker() = default;

void SimulatedWorker::start() {
  {
    const std::lock_guard lock(mutex_);
    open_streams_ = 1;
    pending_.clear();
    sent_us_.clear();
    open_block_.clear();
    outstanding_ = granted_us_ = 0;
    open_offset_ = 0;
  }
  work_ = std::make_unique<WorkStream>(*this);
  deliver_ = std::make_unique<DeliverStream>(*this);
  work_->open(*stub_, session_key_.empty() ? options_.token : session_key_);
  v1::WorkRequest message;
  v1::WorkerHello& hello = *message.mutable_hello();
  hello.set_worker_id(options_.id);
  hello.set_name(options_.id);
  hello.set_host("simulated");
  hello.set_protocol_version(contract::kProtocolVersion);
  hello.set_contract_version(contract::kRenderContract);
  hello.set_numerics_sha256(options_.numerics);
  hello.set_isa("none");
  hello.set_thread_count(1);
  hello.set_credit_count(options_.credits);
  work_->send(std::move(message));
}

void SimulatedWorker::on_stream_ended(bool is_work) {
  if (!options_.reconnects) return;
  if (is_work) deliver_->end();
  const std::lock_guard lock(mutex_);
  if (is_work && std::exchange(is_welcome_, false)) --counters_.connected;
  if (--open_streams_ == 0) reconnect_us_ = now_us() + 1000 * backoff_.next().count();
}

void SimulatedWorker::reconnect_if_due() {
  {
    const std::lock_guard lock(mutex_);
    if (reconnect_us_ == 0 || now_us() < reconnect_us_) return;
    reconnect_us_ = 0;
  }
  start();
}

void SimulatedWorker::send_heartbeat() {
  v1::WorkRequest message;
  message.mutable_heartbeat()->set_rss_bytes(1 << 20);
  work_->send(std::move(message));
}

void SimulatedWorker::on_event(const v1::WorkResponse& event) {
  if (event.has_welcome()) {
    const std::string& key = event.welcome().session_key();
    if (!key.empty()) shelf_.set_token(key);
    {
      const std::lock_guard lock(mutex_);
      session_key_ = key;
      is_welcome_ = true;
      ++open_streams_;
      backoff_.reset();
    }
    deliver_->open(*stub_, key.empty() ? options_.token : key, options_.id);
    ++counters_.welcomed;
    ++counters_.connected;
  } else if (event.has_leases()) {
    std::int64_t unset = 0;
    counters_.first_lease_us.compare_exchange_strong(unset, now_us());
    {
      const std::lock_guard lock(mutex_);
      if (granted_us_ > 0) counters_.lease.add(now_us() - std::exchange(granted_us_, 0));
      for (const v1::JobDescription& job : event.leases().jobs()) shelf_.describe(job);
      for (const v1::Lease& lease : event.leases().leases()) {
        counters_.first_leases.add(lease.job_id(), now_us());
        for (std::int32_t k = 0; k < lease.tile_count(); ++k) {
          pending_.push_back({lease, lease.first_tile() + k});
        }
        outstanding_ += lease.tile_count();
      }
    }
    deliver_->wake();
  } else if (event.has_acknowledgements()) {
    on_acknowledgements(event.acknowledgements());
  } else if (event.has_revocation()) {
    // All leased units count as started.
    v1::WorkRequest message;
    message.mutable_returned();
    work_->send(std::move(message));
  }
}

void SimulatedWorker::on_acknowledgements(const v1::AcknowledgementBatch& batch) {
  for (const v1::Acknowledgement& item : batch.acknowledgements()) {
    switch (item.status()) {
      case v1::Acknowledgement::ACK_STATUS_COMMITTED: {
        const SimulatedFilm* film = shelf_.film(item.unit().job_id());
        ++counters_.committed;
        counters_.committed_bytes += film == nullptr ? 0 : film->block_bytes();
        counters_.last_commit_us = now_us();
        break;
      }
      case v1::Acknowledgement::ACK_STATUS_DUPLICATE:
        ++counters_.duplicate;
        break;
      case v1::Acknowledgement::ACK_STATUS_OBSOLETE:
        ++counters_.obsolete;
        break;
      default:
        if (counters_.rejected++ == 0) fprintf(stderr, "rejected: %s\n", item.reason().c_str());
    }
  }
  v1::WorkRequest message;
  message.mutable_credits()->set_unit_count(batch.acknowledgements_size());
  {
    const std::lock_guard lock(mutex_);
    for (const v1::Acknowledgement& item : batch.acknowledgements()) {
      const auto sent = sent_us_.find(item.unit().SerializeAsString());
      if (sent == sent_us_.end()) continue;
      counters_.commit.add(now_us() - sent->second);
      sent_us_.erase(sent);
    }
    outstanding_ -= batch.acknowledgements_size();
    if (granted_us_ == 0 && outstanding_ > 0) granted_us_ = now_us();
  }
  work_->send(std::move(message));
}

bool SimulatedWorker::next_delivery(v1::DeliverRequest& message) {
  const std::lock_guard lock(mutex_);
  if (open_offset_ < open_block_.size()) {
    message.add_parts()->set_chunk(open_block_.substr(open_offset_, kChunkBytes));
    open_offset_ += kChunkBytes;
    return true;
  }
  std::size_t sent = 0;
  while (!pending_.empty()) {
    const PendingUnit& unit = pending_.front();
    const SimulatedFilm* film = shelf_.film(unit.lease.job_id());
    if (film == nullptr) {
      pending_.pop_front();
      continue;
    }
    if (sent > 0 && sent + static_cast<std::size_t>(film->block_bytes()) > kChunkBytes) break;
    std::string block = film->block(unit.tile, unit.lease.pass());
    v1::BlockPart& part = *message.add_parts();
    v1::BlockHeader& header = *part.mutable_header();
    *header.mutable_lease() = unit.lease;
    header.set_tile(unit.tile);
    header.set_size_bytes(static_cast<std::int64_t>(block.size()));
    header.set_wire_size_bytes(static_cast<std::int64_t>(block.size()));
    header.set_sha256(contract::sha256(block).binary());
    header.set_cpu_seconds(0.001);
    v1::UnitId id;
    id.set_job_id(unit.lease.job_id());
    id.set_frame(unit.lease.frame());
    id.set_pass(unit.lease.pass());
    id.set_tile(unit.tile);
    sent_us_[id.SerializeAsString()] = now_us();
    pending_.pop_front();
    sent += block.size();
    if (block.size() > kChunkBytes) {
      part.set_chunk(block.substr(0, kChunkBytes));
      open_block_ = std::move(block);
      open_offset_ = kChunkBytes;
      return true;
    }
    part.set_chunk(std::move(block));
  }
  return sent > 0;
}

}  // namespace tessera::bench
