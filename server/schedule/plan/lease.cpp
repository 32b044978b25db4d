#include "server/schedule/plan/lease.h"

#include "contract/digest.h"

namespace tessera::server {
namespace {

void append(std::string& bytes, std::int64_t value) {
  for (int shift = 0; shift < 64; shift += 8) {
    bytes.push_back(static_cast<char>((static_cast<std::uint64_t>(value) >> shift) & 0xff));
  }
}

void append(std::string& bytes, std::string_view text) {
  append(bytes, static_cast<std::int64_t>(text.size()));  // so that "ab"+"c" differs from "a"+"bc"
  bytes.append(text);
}

contract::Digest digest_of(const Lease& lease, std::string_view worker_id, std::string_view key) {
  std::string message;
  message.reserve(256);
  append(message, lease.job_id);
  append(message, worker_id);
  append(message, lease.frame);
  append(message, lease.pass);
  append(message, lease.first_tile);
  append(message, lease.tile_count);
  append(message, lease.first_sample);
  append(message, lease.sample_count);
  append(message, lease.attempt.boot);
  append(message, lease.attempt.counter);
  return contract::hmac_sha256(key, message);
}

}  // namespace

std::string make_seal(const Lease& lease, std::string_view worker_id, std::string_view store_key) {
  return digest_of(lease, worker_id, store_key).binary();
}

bool is_seal_valid(const Lease& lease, std::string_view worker_id, std::string_view store_key) {
  const auto seal = contract::Digest::from_binary(lease.seal);
  return seal && contract::equal_in_constant_time(*seal, digest_of(lease, worker_id, store_key));
}

}  // namespace tessera::server
