#include "server/service/messages/messages.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "rpc/settings_message.h"
#include "server/service/messages/field_checks.h"

namespace tessera::server {
namespace {

constexpr int kMaxTags = 64;
constexpr std::int32_t kMaxThreads = 4096;
constexpr double kMaxUnitSeconds = 1e9;
constexpr std::int64_t kMaxUnitCount = std::int64_t{1} << 48;

}  // namespace

v1::Limit to_message(const LimitView& limit) {
  v1::Limit message;
  message.set_name(limit.name);
  message.set_unit_count(limit.units);
  message.set_used_unit_count(limit.used);
  return message;
}

v1::ClientShare to_message(const ShareView& share) {
  v1::ClientShare message;
  message.set_client(share.client);
  message.set_weight(share.weight);
  message.set_source(static_cast<v1::ClientShare::Source>(share.source));
  message.set_usage_cpu_seconds(share.usage);
  return message;
}

v1::Event to_message(const Event& event) {
  v1::Event message;
  message.set_sequence(event.sequence);
  set_time(event.time_us, *message.mutable_event_time());
  message.set_kind(static_cast<v1::Event::Kind>(event.kind));
  message.set_job_id(event.job_id);
  message.set_worker_id(event.worker_id);
  message.set_message(event.text);
  return message;
}

v1::Delivery to_message(const Delivery& delivery) {
  v1::Delivery message;
  message.set_frame(delivery.unit.frame);
  message.set_tile(delivery.unit.tile);
  message.set_pass(delivery.unit.pass);
  message.set_worker_id(std::string(delivery.worker_id));
  message.set_outcome(static_cast<v1::Delivery::Outcome>(delivery.outcome));
  set_time(delivery.end_us, *message.mutable_end_time());
  set_duration(delivery.cpu_seconds, *message.mutable_cpu_duration());
  if (delivery.lease_seconds)
    set_duration(*delivery.lease_seconds, *message.mutable_lease_duration());
  message.set_retry_count(delivery.retry_count);
  return message;
}

v1::Worker to_message(const Worker& worker, std::optional<double> silence_seconds) {
  v1::Worker message;
  message.set_id(worker.id);
  message.set_name(worker.name);
  message.set_host(worker.host);
  message.set_state(worker.quarantined            ? v1::Worker::STATE_QUARANTINED
                    : worker.set_aside            ? v1::Worker::STATE_SET_ASIDE
                    : worker.left                 ? v1::Worker::STATE_LEFT
                    : worker.lost                 ? v1::Worker::STATE_LOST
                    : worker.draining             ? v1::Worker::STATE_DRAINING
                    : worker.leased_units.empty() ? v1::Worker::STATE_IDLE
                                                  : v1::Worker::STATE_BUSY);
  message.set_isa(worker.isa);
  message.set_thread_count(worker.thread_count);
  for (const std::string& tag : worker.tags) message.add_tags(tag);
  message.set_leased_unit_count(static_cast<std::int32_t>(worker.leased_units.size()));
  message.set_committed_unit_count(worker.committed_count);
  message.set_cpu_seconds(worker.cpu_seconds);
  message.set_rss_bytes(worker.rss_bytes);
  message.set_pool(worker.pool);
  message.set_note(worker.note);
  message.set_certificate(worker.certificate);
  message.set_connected(worker.connected);
  if (silence_seconds) set_duration(*silence_seconds, *message.mutable_silence());
  return message;
}

v1::UnitId to_message(const UnitName& name) {
  v1::UnitId message;
  message.set_job_id(name.job_id);
  message.set_frame(name.unit.frame);
  message.set_tile(name.unit.tile);
  message.set_pass(name.unit.pass);
  return message;
}

v1::Lease to_message(const Lease& lease) {
  v1::Lease message;
  message.set_job_id(lease.job_id);
  message.set_frame(lease.frame);
  message.set_pass(lease.pass);
  message.set_first_tile(lease.first_tile);
  message.set_tile_count(lease.tile_count);
  message.set_first_sample(lease.first_sample);
  message.set_sample_count(lease.sample_count);
  message.set_attempt_boot(lease.attempt.boot);
  message.set_attempt_counter(lease.attempt.counter);
  message.set_seal(lease.seal);
  return message;
}

v1::Acknowledgement to_message(const Acknowledgement& acknowledgement) {
  v1::Acknowledgement message;
  *message.mutable_unit() = to_message(acknowledgement.unit);
  message.set_status(static_cast<v1::Acknowledgement::AckStatus>(acknowledgement.status));
  message.set_reason(acknowledgement.reason);
  return message;
}

v1::FrameHeader to_message(const FrameFile& file) {
  v1::FrameHeader header;
  header.set_size_bytes(file.size_bytes);
  header.set_file_sha256(file.file_sha256.binary());
  if (file.pixels_sha256) header.set_pixels_sha256(file.pixels_sha256->binary());
  const std::size_t count = std::min(file.missing_tiles.size(), kTilesPerMessage);
  for (std::size_t i = 0; i < count; ++i) {
    *header.add_missing_tiles() = contract::to_message(file.missing_tiles[i]);
  }
  return header;
}

v1::MissingTiles missing_tiles_from(const FrameFile& file, std::size_t first) {
  v1::MissingTiles message;
  const std::size_t end = std::min(file.missing_tiles.size(), first + kTilesPerMessage);
  for (std::size_t i = first; i < end; ++i) {
    *message.add_tiles() = contract::to_message(file.missing_tiles[i]);
  }
  return message;
}

UnitName from_message(const v1::UnitId& message) {
  return {message.job_id(), {message.frame(), message.tile(), message.pass()}};
}

Lease from_message(const v1::Lease& message) {
  return {message.job_id(),       message.frame(),
          message.pass(),         message.first_tile(),
          message.tile_count(),   message.first_sample(),
          message.sample_count(), {message.attempt_boot(), message.attempt_counter()},
          message.seal()};
}

absl::StatusOr<Hello> from_message(const v1::WorkerHello& message) {
  absl::Status status = check_name("hello.worker_id", message.worker_id());
  if (!status.ok()) return status;
  status = check_text("hello.name", message.name(), 1, 100);
  status.Update(check_text("hello.host", message.host(), 0, kMaxNameLetters));
  status.Update(check_text("hello.isa", message.isa(), 0, kMaxIdLetters));
  status.Update(check_range("hello.thread_count", message.thread_count(), 1, kMaxThreads));
  status.Update(check_range("hello.credit_count", message.credit_count(), 0, 1 << 20));
  status.Update(check_range("hello.tags", message.tags_size(), 0, kMaxTags));
  for (const std::string& tag : message.tags()) {
    status.Update(check_text("hello.tags", tag, 1, kMaxIdLetters));
  }
  if (!message.pool().empty()) status.Update(check_name("hello.pool", message.pool()));
  status.Update(check_text("hello.store_id", message.store_id(), 0, kMaxIdLetters));
  if (!status.ok()) return status;
  Hello hello;
  hello.worker_id = message.worker_id();
  hello.name = message.name();
  hello.host = message.host();
  hello.isa = message.isa();
  hello.thread_count = message.thread_count();
  hello.tags = {message.tags().begin(), message.tags().end()};
  hello.pool = message.pool();
  hello.credit_count = message.credit_count();
  hello.store_id = message.store_id();
  for (const v1::Lease& lease : message.leases()) hello.leases.push_back(from_message(lease));
  for (const v1::UnitId& unit : message.running()) hello.running.push_back(from_message(unit));
  for (const v1::UnitId& unit : message.unacknowledged())
    hello.unacknowledged.push_back(from_message(unit));
  return hello;
}

absl::StatusOr<BlockHeader> from_message(const v1::BlockHeader& message) {
  const auto digest = contract::Digest::from_binary(message.sha256());
  if (!digest) return bad("header.sha256", "expected 32 bytes");
  if (!(message.cpu_seconds() >= 0 && message.cpu_seconds() <= kMaxUnitSeconds)) {
    return bad("header.cpu_seconds", absl::StrCat(message.cpu_seconds(), " is not in [0, 1e9]"));
  }
  BlockHeader header;
  header.lease = from_message(message.lease());
  header.tile = message.tile();
  header.size_bytes = message.size_bytes();
  header.sha256 = *digest;
  header.cpu_seconds = message.cpu_seconds();
  for (const std::int64_t count :
       {message.ray_count(), message.visited_node_count(), message.tested_primitive_count()}) {
    if (count < 0 || count > kMaxUnitCount) {
      return bad("header: count", absl::StrCat(count, " is not in [0, 2^48]"));
    }
  }
  header.cost = {message.ray_count(), message.visited_node_count(),
                 message.tested_primitive_count()};
  return header;
}

absl::StatusOr<FrameQuery> from_message(const v1::FetchFrameRequest& message) {
  if (!(message.exposure_ev() >= -100 && message.exposure_ev() <= 100)) {
    return bad("exposure_ev", absl::StrCat(message.exposure_ev(), " is not in [-100, 100]"));
  }
  FrameQuery query;
  query.job_id = message.job_id();
  query.frame = message.frame();
  query.exposure_ev = message.exposure_ev();
  query.allow_partial = message.allow_partial();
  if (message.format() == v1::FetchFrameRequest::FORMAT_PNG) query.format = FrameFormat::png;
  if (message.format() == v1::FetchFrameRequest::FORMAT_JPEG) query.format = FrameFormat::jpeg;
  return query;
}

}  // namespace tessera::server
