#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace tessera::contract {

/// A SHA-256 digest: the name of an asset, the fingerprint of a block, the hash of an image.
struct Digest {
  std::array<std::uint8_t, 32> bytes{};

  auto operator<=>(const Digest&) const = default;
  /// 64 lowercase hexadecimal digits.
  std::string hex() const;
  /// The 32 bytes as a string, the form on the wire.
  std::string binary() const;
  /// nullopt unless `text` is 64 hexadecimal digits of either case.
  static std::optional<Digest> from_hex(std::string_view text);
  /// nullopt unless `bytes` has 32 bytes.
  static std::optional<Digest> from_binary(std::string_view bytes);
};

/// SHA-256 of a stream of bytes.
class Hasher {
 public:
  Hasher();
  ~Hasher();
  Hasher(Hasher&&) noexcept;
  Hasher& operator=(Hasher&&) noexcept;
  void update(std::span<const std::byte> bytes);
  void update(std::string_view bytes) { update(std::as_bytes(std::span(bytes))); }
  /// The digest of all bytes so far; the hasher is spent.
  Digest finish();

 private:
  struct Context;
  std::unique_ptr<Context> context_;
};

Digest sha256(std::span<const std::byte> bytes);
Digest sha256(std::string_view bytes);

/// Digest of the sorted list of `digests`, repeats left out: the same for any order. A report's
/// `scene_sha256` is that of the job's assets: the same bytes under other names are the same scene.
Digest sha256_of_set(std::vector<Digest> digests);

/// HMAC-SHA-256 of `message` under `key`.
Digest hmac_sha256(std::string_view key, std::string_view message);

/// Equality in time that does not depend on where the difference is, for secrets.
bool equal_in_constant_time(const Digest& a, const Digest& b);

}  // namespace tessera::contract
