#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace tessera::render {

/// Severity of a finding; names and order are those of the Khronos glTF validator.
enum class FindingSeverity : std::uint8_t { error, warning, information, hint };

/// A rule of glTF 2.0 with the code that the Khronos glTF validator gives its breach.
struct ValidationRule {
  std::string_view code;
  FindingSeverity severity;
  std::string_view text;  // the breach, in plain English
};

/// A breach of a rule.
struct ValidationFinding {
  const ValidationRule* rule = nullptr;
  std::string pointer;  // JSON pointer; "@N" is byte N of a GLB
  std::string message;
};

/// Findings of one file. Keeps the first `limit` and counts the others.
class ValidationFindings {
 public:
  explicit ValidationFindings(std::size_t limit) : limit_(limit) {}

  /// Adds a finding at `pointer`. `detail` is appended to the rule's text.
  void add(const ValidationRule& rule, std::string pointer, std::string_view detail = "");
  /// Adds a finding at the member `key`, or the element `index`, of `path`.
  void add_at(const ValidationRule& rule, const std::string& path, std::string_view key,
              std::string_view detail = "");
  void add_at(const ValidationRule& rule, const std::string& path, std::size_t index,
              std::string_view detail = "");

  [[nodiscard]] const std::vector<ValidationFinding>& kept() const { return kept_; }
  [[nodiscard]] std::size_t count(FindingSeverity severity) const;
  /// Number of findings beyond the limit.
  [[nodiscard]] std::size_t omitted() const { return omitted_; }

 private:
  std::size_t limit_;
  std::vector<ValidationFinding> kept_;
  std::array<std::size_t, 4> counts_ = {};
  std::size_t omitted_ = 0;
};

/// `path` with the member `key` or the element `index` appended, as a JSON pointer.
std::string pointer_to(const std::string& path, std::string_view key);
std::string pointer_to(const std::string& path, std::size_t index);

}  // namespace tessera::render
