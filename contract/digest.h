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

/// A SHA-256 digest.
struct Digest {
  std::array<std::uint8_t, 32> bytes{};

  auto operator<=>(const Digest&) const = default;
  /// Returns 64 lowercase hexadecimal digits.
  std::string hex() const;
  /// Returns the 32 bytes, the form used in messages.
  std::string binary() const;
  /// Parses 64 hexadecimal digits of either case; nullopt for anything else.
  static std::optional<Digest> from_hex(std::string_view text);
  /// Returns nullopt unless `bytes` has 32 bytes.
  static std::optional<Digest> from_binary(std::string_view bytes);
};

/// Computes the SHA-256 of a stream of bytes.
class Hasher {
 public:
  Hasher();
  ~Hasher();
  Hasher(Hasher&&) noexcept;
  Hasher& operator=(Hasher&&) noexcept;
  void update(std::span<const std::byte> bytes);
  void update(std::string_view bytes) { update(std::as_bytes(std::span(bytes))); }
  /// Returns the digest of all bytes so far. The hasher must not be used afterwards.
  Digest finish();

 private:
  struct Context;
  std::unique_ptr<Context> context_;
};

Digest sha256(std::span<const std::byte> bytes);
Digest sha256(std::string_view bytes);

/// Returns the digest of the sorted `digests` without duplicates, so that order does not matter. A
/// report's `scene_sha256` is that of the job's assets: scenes with equal files have equal values,
/// whatever the files are called.
Digest sha256_of_set(std::vector<Digest> digests);

/// Returns the HMAC-SHA-256 of `message` with `key`.
Digest hmac_sha256(std::string_view key, std::string_view message);

/// Compares secrets in a time that does not depend on where they differ.
bool equal_in_constant_time(const Digest& a, const Digest& b);

}  // namespace tessera::contract
