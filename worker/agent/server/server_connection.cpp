#include "worker/agent/server/server_connection.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "worker/agent/server/backoff.h"

namespace tessera::agent {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr seconds kHelloTimeout{10};  // from Hello to Welcome
constexpr seconds kAckTimeout{30};    // then blocks are sent again
constexpr std::size_t kChunkBytes = 64 << 10;
/// If a stream is replaced twice within this time, another process uses the worker ID. Once may be
/// due to the network, if it delivers the Hello of an earlier stream of this process late.
constexpr seconds kReplacedTwice{60};

std::chrono::nanoseconds to_nanoseconds(const google::protobuf::Duration& span,
                                        std::chrono::nanoseconds least) {
  return std::max(least, seconds(span.seconds()) + std::chrono::nanoseconds(span.nanos()));
}

bool is_final(const absl::Status& status) {
  switch (status.code()) {
    case absl::StatusCode::kFailedPrecondition:
    case absl::StatusCode::kInvalidArgument:
    case absl::StatusCode::kUnauthenticated:
    case absl::StatusCode::kPermissionDenied:
    case absl::StatusCode::kUnimplemented:
      return true;
    default:
      return false;
  }
}

absl::Status id_is_in_use(const absl::Status& status) {
  return absl::AbortedError(absl::StrCat(
      "another process uses the worker ID; stop one of the two, or choose another one with --id (",
      std::string(status.message()), ")"));
}

}  // namespace

ServerConnection::ServerConnection(ServerChannel& channel, Options options, UnitQueue& queue,
                                   EventLoop& event_loop, Callbacks callbacks)
    : channel_(channel),
      options_(std::move(options)),
      queue_(queue),
      event_loop_(event_loop),
      callbacks_(std::move(callbacks)),
      backoff_(kFirstPause, kMaxPause),
      interval_(seconds(1)),
      timeout_(kHelloTimeout) {}

void ServerConnection::pump(Time now) {
  check_silence(now);
  if (work_ == nullptr && deliver_ == nullptr && !finishing_ && now >= connect_at_) connect(now);
  if (!welcomed_) return;
  if (const std::int32_t grant = queue_.credits_to_grant(callbacks_.window()); grant > 0) {
    v1::WorkRequest request;
    request.mutable_credits()->set_unit_count(grant);
    work_->send(std::move(request));
  }
  if (now >= heartbeat_at_) {
    v1::WorkRequest request;
    for (const UnitKey& key : queue_.started()) {
      *request.mutable_heartbeat()->add_started() = id_of(key);
    }
    request.mutable_heartbeat()->set_rss_bytes(callbacks_.rss_bytes());
    work_->send(std::move(request));
    check_acknowledgements(now);
    heartbeat_at_ = now + std::chrono::duration_cast<Clock::duration>(interval_);
  }
  deliver();
}

Time ServerConnection::next_due() const {
  if (work_ == nullptr) return deliver_ == nullptr ? connect_at_ : Time::max();
  const Time silent = last_response_at_ + std::chrono::duration_cast<Clock::duration>(timeout_ / 2);
  return welcomed_ ? std::min(heartbeat_at_, silent) : silent;
}

void ServerConnection::connect(Time now) {
  WorkStream::Listener listener;
  listener.on_response = [this](v1::WorkResponse response) {
    event_loop_.post(
        [this, response = std::move(response)]() mutable { on_response(std::move(response)); });
  };
  // Destroys the stream: there is never more than one, and no message arrives after on_closed.
  listener.on_closed = [this, &event_loop = event_loop_](const absl::Status& status) {
    event_loop.post([this, status] { on_closed(status); });
  };
  const std::string& token = session_key_.empty() ? options_.token : session_key_;
  work_ = std::make_unique<WorkStream>(*channel_.workers(), token, std::move(listener));
  v1::WorkRequest request;
  *request.mutable_hello() = callbacks_.hello();
  queue_.fill_hello(*request.mutable_hello(), callbacks_.window());
  work_->send(std::move(request));
  last_response_at_ = now;
  timeout_ = kHelloTimeout;
}

void ServerConnection::open_deliver() {
  DeliverStream::Listener listener;
  listener.on_room = [this] { event_loop_.post([this] { deliver(); }); };
  listener.on_closed = [this, &event_loop = event_loop_](const absl::Status& status) {
    event_loop.post([this, status] {
      if (!status.ok() && welcomed_ && !deliver_cancelled_) {
        options_.log(LogLevel::warn,
                     absl::StrCat("delivery stream failed: ", std::string(status.message())));
      }
      deliver_.reset();
    });
  };
  deliver_ =
      std::make_unique<DeliverStream>(*channel_.workers(), options_.token, std::move(listener));
  is_first_request_ = true;
  deliver_cancelled_ = false;
  sending_.reset();
  to_send_.clear();
  queue_.reset_offers();
}

void ServerConnection::on_response(v1::WorkResponse response) {
  last_response_at_ = Clock::now();
  if (response.event_case() != v1::WorkResponse::kWelcome) {
    callbacks_.on_response(std::move(response));
    return;
  }
  queue_.set_store(response.welcome().store_id());
  interval_ = to_nanoseconds(response.welcome().heartbeat_interval(), milliseconds(50));
  timeout_ = to_nanoseconds(response.welcome().timeout(), milliseconds(500));
  session_key_ = response.welcome().session_key();
  welcomed_ = true;
  last_connect_error_.clear();
  options_.log(LogLevel::info, absl::StrCat("connected to store ", response.welcome().store_id()));
  backoff_.reset();
  heartbeat_at_ = last_response_at_;
}

void ServerConnection::on_closed(const absl::Status& status) {
  work_.reset();
  const bool was_welcome = std::exchange(welcomed_, false);
  if (deliver_ != nullptr) {
    deliver_cancelled_ = true;
    deliver_->cancel();
  }
  if (finishing_) return;
  const Time now = Clock::now();
  if (absl::IsAborted(status)) {
    const auto before = std::exchange(replaced_at_, now);
    if (before && now - *before < kReplacedTwice) return refuse(id_is_in_use(status));
  }
  const bool awaits_certificate = absl::IsUnauthenticated(status) && options_.awaits_certificate &&
                                  options_.awaits_certificate();
  // A different store does not know the session key but may accept the token.
  const bool has_stale_key =
      absl::IsUnauthenticated(status) && !session_key_.empty() && !awaits_certificate;
  if (has_stale_key) session_key_.clear();
  if (is_final(status) && !has_stale_key && !awaits_certificate) return refuse(status);
  connect_at_ = now + backoff_.next();
  if (was_welcome) {
    options_.log(LogLevel::warn, absl::StrCat("connection lost (", std::string(status.message()),
                                              "); reconnecting"));
  } else if (std::exchange(last_connect_error_, std::string(status.message())) !=
             status.message()) {
    options_.log(LogLevel::warn,
                 absl::StrCat("cannot reach the server (", last_connect_error_, "); retrying"));
  }
}

void ServerConnection::refuse(const absl::Status& status) {
  finishing_ = true;
  callbacks_.refused(status);
}

void ServerConnection::check_silence(Time now) {
  if (work_ != nullptr && now - last_response_at_ >= timeout_) {
    last_response_at_ = now;  // cancel once; on_closed follows
    work_->cancel();
  } else if (welcomed_ && keepalive_ == nullptr && now - last_response_at_ >= timeout_ / 2) {
    send_keepalive();
  }
}

/// Replaces the delivery stream if a block is not acknowledged in time: all blocks are sent again.
void ServerConnection::check_acknowledgements(Time now) {
  const auto oldest = queue_.oldest_offer();
  if (!oldest || now - *oldest <= kAckTimeout || deliver_ == nullptr || deliver_cancelled_) return;
  deliver_cancelled_ = true;
  deliver_->cancel();
}

void ServerConnection::send_keepalive() {
  const auto limit = std::chrono::duration_cast<milliseconds>(timeout_ / 2);
  keepalive_ = std::make_unique<KeepaliveProbe>(*channel_.workers(), options_.token, limit,
                                                [this](bool answered) {
                                                  event_loop_.post([this, answered] {
                                                    keepalive_.reset();
                                                    if (answered) last_response_at_ = Clock::now();
                                                  });
                                                });
}

void ServerConnection::send(v1::WorkRequest request) {
  if (welcomed_) work_->send(std::move(request));
}

void ServerConnection::reconnect() {
  if (work_ != nullptr) work_->cancel();  // on_closed() follows
}

void ServerConnection::finish() {
  finishing_ = true;
  if (work_ != nullptr) work_->finish();
  if (deliver_ != nullptr) deliver_->finish();
  if (keepalive_ != nullptr) keepalive_->cancel();
}

void ServerConnection::cancel() {
  finishing_ = true;
  if (work_ != nullptr) work_->cancel();
  if (deliver_ != nullptr) deliver_->cancel();
  if (keepalive_ != nullptr) keepalive_->cancel();
}

void ServerConnection::record_acknowledgement(Time offered, Time now) {
  const double trip = std::chrono::duration<double>(now - offered).count();
  constexpr double kDecay = 1.01;  // the minimum at most doubles in 70 acknowledgements
  ack_latency_seconds_ =
      ack_latency_seconds_ == 0 ? trip : std::min(kDecay * ack_latency_seconds_, trip);
}

void ServerConnection::deliver() {
  if (!welcomed_ || finishing_) return;
  if (deliver_ == nullptr) open_deliver();
  while (deliver_->has_room()) {
    v1::DeliverRequest request;
    add_parts(request);
    if (request.parts().empty()) return;
    if (std::exchange(is_first_request_, false)) {
      request.set_worker_id(callbacks_.hello().worker_id());
    }
    deliver_->send(std::move(request));
  }
}

std::optional<UnitQueue::Block> ServerConnection::next_block() {
  if (to_send_.empty()) {
    auto block = queue_.next_block(Clock::now());
    if (!block || !options_.blocks_to_send) return block;
    auto blocks = options_.blocks_to_send(*std::move(block));
    to_send_.assign(blocks.begin(), blocks.end());
  }
  auto block = std::move(to_send_.front());
  to_send_.pop_front();
  return block;
}

/// Fills a message with the rest of a partly sent block, or with as many whole blocks as fit.
void ServerConnection::add_parts(v1::DeliverRequest& request) {
  std::size_t room = kChunkBytes;
  while (room > 0) {
    const bool begins = !sending_;
    if (begins) {
      sending_ = next_block();
      if (!sending_) return;
      sent_bytes_ = 0;
    }
    const std::string& bytes = *sending_->bytes;
    // A block that does not fit after others starts its own message.
    if (sent_bytes_ == 0 && !request.parts().empty() && bytes.size() > room) return;
    v1::BlockPart& part = *request.add_parts();
    if (sent_bytes_ == 0) {
      v1::BlockHeader& header = *part.mutable_header();
      *header.mutable_lease() = *sending_->lease;
      header.set_tile(sending_->key.unit.tile);
      header.set_size_bytes(static_cast<std::int64_t>(bytes.size()));
      header.set_wire_size_bytes(static_cast<std::int64_t>(bytes.size()));
      header.set_sha256(sending_->sha256.binary());
      header.set_cpu_seconds(sending_->cpu_seconds);
      header.set_ray_count(sending_->cost.rays);
      header.set_visited_node_count(sending_->cost.nodes);
      header.set_tested_primitive_count(sending_->cost.primitives);
    }
    const std::size_t count = std::min(room, bytes.size() - sent_bytes_);
    part.set_chunk(bytes.substr(sent_bytes_, count));
    sent_bytes_ += count;
    room -= count;
    if (sent_bytes_ < bytes.size()) return;  // a message with part of a block has nothing else
    sending_.reset();
    if (!begins || count == kChunkBytes) return;
  }
}

}  // namespace tessera::agent
