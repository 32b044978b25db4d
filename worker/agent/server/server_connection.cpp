#include "worker/agent/server/server_connection.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera::agent {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr milliseconds kFirstPause{50}, kLongestPause{5'000};
constexpr seconds kHelloTimeout{10};    // from Hello to Welcome
constexpr seconds kVerdictTimeout{30};  // after which blocks are sent again
constexpr std::size_t kChunkBytes = 64 << 10;

std::chrono::nanoseconds span_of(const google::protobuf::Duration& span,
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
    case absl::StatusCode::kAborted:  // another process has this worker's id
      return true;
    default:
      return false;
  }
}

}  // namespace

ServerConnection::ServerConnection(v1::WorkerService::Stub& stub, Options options, UnitQueue& queue,
                       EventLoop& mailbox, Callbacks outlet)
    : stub_(stub),
      options_(std::move(options)),
      queue_(queue),
      mailbox_(mailbox),
      outlet_(std::move(outlet)),
      random_(std::random_device{}()),
      interval_(seconds(1)),
      timeout_(kHelloTimeout),
      pause_(kFirstPause) {}

void ServerConnection::pump(Time now) {
  check_silence(now);
  if (work_ == nullptr && deliver_ == nullptr && !finishing_ && now >= connect_at_) connect(now);
  if (!welcomed_) return;
  if (const std::int32_t grant = queue_.credits_to_grant(outlet_.window()); grant > 0) {
    v1::WorkRequest request;
    request.mutable_credits()->set_unit_count(grant);
    work_->send(std::move(request));
  }
  if (now >= beat_at_) {
    v1::WorkRequest request;
    for (const UnitKey& key : queue_.started()) {
      *request.mutable_heartbeat()->add_started() = id_of(key);
    }
    request.mutable_heartbeat()->set_rss_bytes(outlet_.rss_bytes());
    work_->send(std::move(request));
    check_verdicts(now);
    beat_at_ = now + std::chrono::duration_cast<Clock::duration>(interval_);
  }
  deliver();
}

Time ServerConnection::next_due() const {
  if (work_ == nullptr) return deliver_ == nullptr ? connect_at_ : Time::max();
  const Time silent = heard_ + std::chrono::duration_cast<Clock::duration>(timeout_ / 2);
  return welcomed_ ? std::min(beat_at_, silent) : silent;
}

void ServerConnection::connect(Time now) {
  WorkStream::Listener listener;
  listener.on_response = [this](v1::WorkResponse response) {
    mailbox_.post(
        [this, response = std::move(response)]() mutable { on_response(std::move(response)); });
  };
  // The stream is gone when this has run: there is never more than one, and no message after it.
  listener.on_closed = [this, &mailbox = mailbox_](const absl::Status& status) {
    mailbox.post([this, status] { on_closed(status); });
  };
  const std::string& token = session_key_.empty() ? options_.token : session_key_;
  work_ = std::make_unique<WorkStream>(stub_, token, std::move(listener));
  v1::WorkRequest request;
  *request.mutable_hello() = outlet_.hello();
  queue_.describe(*request.mutable_hello(), outlet_.window());
  work_->send(std::move(request));
  heard_ = now;
  timeout_ = kHelloTimeout;
}

void ServerConnection::open_deliver() {
  DeliverStream::Listener listener;
  listener.on_room = [this] { mailbox_.post([this] { deliver(); }); };
  listener.on_closed = [this, &mailbox = mailbox_](const absl::Status& status) {
    mailbox.post([this, status] {
      if (!status.ok() && welcomed_ && !deliver_cancelled_) {
        options_.log(LogLevel::warn,
                     absl::StrCat("delivery broke off: ", std::string(status.message())));
      }
      deliver_.reset();
    });
  };
  deliver_ = std::make_unique<DeliverStream>(stub_, options_.token, std::move(listener));
  names_itself_ = true;
  deliver_cancelled_ = false;
  sending_.reset();
  after_forged_.reset();
  queue_.offer_all_again();
}

void ServerConnection::on_response(v1::WorkResponse response) {
  heard_ = Clock::now();
  if (response.event_case() != v1::WorkResponse::kWelcome) {
    outlet_.on_response(std::move(response));
    return;
  }
  queue_.welcome(response.welcome().store_id());
  interval_ = span_of(response.welcome().heartbeat_interval(), milliseconds(50));
  timeout_ = span_of(response.welcome().timeout(), milliseconds(500));
  session_key_ = response.welcome().session_key();
  welcomed_ = true;
  unreachable_.clear();
  options_.log(LogLevel::info, absl::StrCat("working for store ", response.welcome().store_id()));
  pause_ = kFirstPause;
  beat_at_ = heard_;
}

void ServerConnection::on_closed(const absl::Status& status) {
  work_.reset();
  const bool was_welcome = std::exchange(welcomed_, false);
  if (deliver_ != nullptr) {
    deliver_cancelled_ = true;
    deliver_->cancel();
  }
  if (finishing_) return;
  // Another store knows not our key, but may take the token.
  const bool has_stale_key = absl::IsUnauthenticated(status) && !session_key_.empty();
  if (has_stale_key) session_key_.clear();
  if (is_final(status) && !has_stale_key) {
    finishing_ = true;
    outlet_.refused(status);
    return;
  }
  std::uniform_int_distribution<std::int64_t> jitter(pause_.count() / 2, pause_.count());
  connect_at_ = Clock::now() + milliseconds(jitter(random_));
  pause_ = std::min(2 * pause_, kLongestPause);
  if (was_welcome) {
    options_.log(LogLevel::warn, absl::StrCat("the server is gone (", std::string(status.message()),
                                              "); connecting again"));
  } else if (std::exchange(unreachable_, std::string(status.message())) != status.message()) {
    options_.log(LogLevel::warn,
                 absl::StrCat("the server cannot be reached (", unreachable_, "); trying again"));
  }
}

void ServerConnection::check_silence(Time now) {
  if (work_ != nullptr && now - heard_ >= timeout_) {
    heard_ = now;  // once is enough; on_closed follows
    work_->cancel();
  } else if (welcomed_ && life_sign_ == nullptr && now - heard_ >= timeout_ / 2) {
    ask_for_life_sign();
  }
}

/// A block whose verdict does not come is sent again, on another stream, with all others.
void ServerConnection::check_verdicts(Time now) {
  const auto oldest = queue_.oldest_offer();
  if (!oldest || now - *oldest <= kVerdictTimeout || deliver_ == nullptr || deliver_cancelled_)
    return;
  deliver_cancelled_ = true;
  deliver_->cancel();
}

void ServerConnection::ask_for_life_sign() {
  const auto limit = std::chrono::duration_cast<milliseconds>(timeout_ / 2);
  life_sign_ = std::make_unique<KeepaliveProbe>(stub_, options_.token, limit, [this](bool answered) {
    mailbox_.post([this, answered] {
      life_sign_.reset();
      if (answered) heard_ = Clock::now();
    });
  });
}

void ServerConnection::send(v1::WorkRequest request) {
  if (welcomed_) work_->send(std::move(request));
}

void ServerConnection::finish() {
  finishing_ = true;
  if (work_ != nullptr) work_->finish();
  if (deliver_ != nullptr) deliver_->finish();
  if (life_sign_ != nullptr) life_sign_->cancel();
}

void ServerConnection::cancel() {
  finishing_ = true;
  if (work_ != nullptr) work_->cancel();
  if (deliver_ != nullptr) deliver_->cancel();
  if (life_sign_ != nullptr) life_sign_->cancel();
}

void ServerConnection::note_verdict(Time offered, Time now) {
  const double trip = std::chrono::duration<double>(now - offered).count();
  constexpr double kForgets = 1.01;  // twice as long a way is believed after 70 verdicts
  round_trip_seconds_ =
      round_trip_seconds_ == 0 ? trip : std::min(kForgets * round_trip_seconds_, trip);
}

void ServerConnection::deliver() {
  if (!welcomed_ || finishing_) return;
  if (deliver_ == nullptr) open_deliver();
  while (deliver_->has_room()) {
    v1::DeliverRequest request;
    add_parts(request);
    if (request.parts().empty()) return;
    if (std::exchange(names_itself_, false)) {
      request.set_worker_id(outlet_.hello().worker_id());
    }
    deliver_->send(std::move(request));
  }
}

std::optional<UnitQueue::Block> ServerConnection::next_block() {
  if (after_forged_) return std::exchange(after_forged_, std::nullopt);
  auto block = queue_.next_block(Clock::now());
  if (!block || !options_.forge) return block;
  after_forged_ = block;
  v1::Lease lease = *block->lease;
  lease.set_attempt_counter(lease.attempt_counter() + 1);
  std::string bytes = *block->bytes;
  bytes.front() ^= 1;
  block->sha256 = contract::sha256(bytes);
  block->lease = std::make_shared<const v1::Lease>(std::move(lease));
  block->bytes = std::make_shared<const std::string>(std::move(bytes));
  return block;
}

/// Fills a message: the rest of the block begun, or as many blocks as fit.
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
    // A block that does not fit behind others starts a message of its own.
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
    }
    const std::size_t count = std::min(room, bytes.size() - sent_bytes_);
    part.set_chunk(bytes.substr(sent_bytes_, count));
    sent_bytes_ += count;
    room -= count;
    if (sent_bytes_ < bytes.size()) return;  // a message with a part of a block has nothing else
    if (options_.deliver_twice && !sent_once_) {
      sent_once_ = true;
      sent_bytes_ = 0;
      if (bytes.size() > room) return;
      continue;
    }
    sent_once_ = false;
    sending_.reset();
    if (!begins || count == kChunkBytes) return;
  }
}

}  // namespace tessera::agent
