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
#include "worker/math/vector.h"

namespace tessera::render {

/// The first fault met while a piece of JSON is read; later ones are dropped.
class JsonFault {
 public:
  void report(std::string element, std::string message);
  /// InvalidArgument "ELEMENT: MESSAGE", or OK.
  [[nodiscard]] absl::Status status() const;

 private:
  std::optional<std::string> first_;
};

/// A read-only look at a JSON value that knows its path ("materials[3].extensions.X"). Reading a
/// value of the wrong type or out of range reports a fault and gives the default, so that callers
/// check once, at the end. The JSON and the fault must outlive it.
class JsonView {
 public:
  JsonView(const nlohmann::json& value, std::string path, JsonFault& fault);

  [[nodiscard]] bool present() const { return value_ != nullptr; }
  [[nodiscard]] const std::string& path() const { return path_; }

  /// Member of an object; absent when this is absent or has no such member.
  [[nodiscard]] JsonView operator[](std::string_view key) const;
  [[nodiscard]] JsonView extension(std::string_view name) const;
  /// As if this value were not there.
  [[nodiscard]] JsonView absent() const { return {nullptr, path_, fault_}; }
  /// Elements of an array; none when absent. A fault when it is something else.
  [[nodiscard]] std::vector<JsonView> items() const;
  /// A fault for every member of this object whose name is not among `names`, `extensions` or
  /// `extras`: for our own extensions, where a misspelt member must not pass.
  void allow(std::initializer_list<std::string_view> names) const;
  /// Names of an object's members in the JSON library's (sorted) order.
  [[nodiscard]] std::vector<std::string> keys() const;

  [[nodiscard]] double number(std::string_view key, double fallback,
                              double low = std::numeric_limits<double>::lowest(),
                              double high = std::numeric_limits<double>::max()) const;
  [[nodiscard]] bool boolean(std::string_view key, bool fallback) const;
  [[nodiscard]] std::string text(std::string_view key) const;
  /// An integer in [0, limit), or -1 when absent.
  [[nodiscard]] std::int64_t integer(std::string_view key, std::int64_t limit) const;
  /// An index into an array of `size` elements, or kNone when absent.
  [[nodiscard]] std::int32_t index(std::string_view key, std::size_t size) const;
  [[nodiscard]] Vec3f vec3(std::string_view key, Vec3f fallback) const;
  /// Numbers of an array of exactly `size` (fallback.size()) elements.
  [[nodiscard]] std::vector<double> numbers(std::string_view key,
                                            std::vector<double> fallback) const;

  /// This value itself as an index.
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
