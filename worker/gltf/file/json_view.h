#pragma once

#include <cstdint>
#include <initializer_list>
#include <limits>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "worker/gltf/file/part_faults.h"
#include "worker/math/vector.h"

namespace tessera::render {

/// Keeps the first fault found while reading JSON; later ones are dropped. Faults of parts that a
/// scene need not use go to `parts` instead, if it is given.
class JsonFault {
 public:
  JsonFault() = default;
  explicit JsonFault(PartFaults& parts) : parts_(&parts) {}

  void report(const std::string& element, std::string message);
  /// InvalidArgument "ELEMENT: MESSAGE", or OK.
  [[nodiscard]] absl::Status status() const;

 private:
  std::optional<std::string> first_;
  PartFaults* parts_ = nullptr;
};

/// Read-only view of a JSON value that knows its path ("materials[3].extensions.X"). Reading a
/// value of the wrong type or out of range reports a fault and returns the default, so callers
/// check for faults once, at the end. The JSON and the fault must outlive it.
class JsonView {
 public:
  JsonView(const nlohmann::json& value, std::string path, JsonFault& fault);

  [[nodiscard]] bool present() const { return value_ != nullptr; }
  [[nodiscard]] const std::string& path() const { return path_; }

  /// Property of an object; absent if this value is absent or has no such property.
  [[nodiscard]] JsonView operator[](std::string_view key) const;
  [[nodiscard]] JsonView extension(std::string_view name) const;
  /// A view of the same path without a value.
  [[nodiscard]] JsonView absent() const { return {nullptr, path_, fault_}; }
  /// Elements of an array; empty if absent. Reports a fault for any other type.
  [[nodiscard]] std::vector<JsonView> items() const;
  /// Reports a fault for every property of this object not among `names`, `extensions` and
  /// `extras`. Used for TESSERA extensions, where a misspelt property must not be ignored.
  void allow(std::initializer_list<std::string_view> names) const;
  /// Names of the properties of an object, sorted.
  [[nodiscard]] std::vector<std::string> keys() const;

  /// Value in [low, high], or `fallback` if absent.
  [[nodiscard]] double number(std::string_view key, double fallback,
                              double low = std::numeric_limits<double>::lowest(),
                              double high = std::numeric_limits<double>::max()) const;
  [[nodiscard]] bool boolean(std::string_view key, bool fallback) const;
  [[nodiscard]] std::string text(std::string_view key) const;
  /// An integer in [0, limit), or -1 if absent.
  [[nodiscard]] std::int64_t integer(std::string_view key, std::int64_t limit) const;
  /// An index into an array of `size` elements, or kNone if absent.
  [[nodiscard]] std::int32_t index(std::string_view key, std::size_t size) const;
  [[nodiscard]] Vec3f vec3(std::string_view key, Vec3f fallback) const;
  /// Elements of an array of exactly fallback.size() numbers, or `fallback` if absent.
  [[nodiscard]] std::vector<double> numbers(std::string_view key,
                                            std::vector<double> fallback) const;

  /// This value as an index into an array of `size` elements.
  [[nodiscard]] std::int32_t as_index(std::size_t size) const;
  [[nodiscard]] std::string as_text() const;

 private:
  JsonView(const nlohmann::json* value, std::string path, JsonFault* fault)
      : value_(value), path_(std::move(path)), fault_(fault) {}

  const nlohmann::json* value_;
  std::string path_;
  JsonFault* fault_;
};

}  // namespace tessera::render
