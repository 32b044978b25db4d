#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace tessera::render {

/// A JSON value that keeps the order of an object's members, as the links of a document are
/// followed in the order of the file. A repeated key has its last value.
class JsonNode {
 public:
  /// `faulty` is a value that a check has rejected: later checks do not use it.
  enum class Kind : std::uint8_t { absent, null, boolean, number, text, array, object, faulty };

  JsonNode() = default;
  explicit JsonNode(Kind kind, double number = 0);

  [[nodiscard]] Kind kind() const { return kind_; }
  [[nodiscard]] bool is(Kind kind) const { return kind_ == kind; }
  /// The value of a number; 0 or 1 for a boolean.
  [[nodiscard]] double number() const { return number_; }
  [[nodiscard]] const std::string& text() const;
  /// Elements of an array, or values of an object's members; empty for other kinds.
  [[nodiscard]] const std::vector<JsonNode>& items() const;
  [[nodiscard]] std::vector<JsonNode>& items();
  /// Keys of an object in the order of items().
  [[nodiscard]] const std::vector<std::string>& keys() const;

  /// Returns whether an object has the key, whatever the value.
  [[nodiscard]] bool has(std::string_view key) const { return find(key) != nullptr; }
  [[nodiscard]] const JsonNode* find(std::string_view key) const;
  [[nodiscard]] JsonNode* find(std::string_view key);
  /// Value of a member; a value of kind absent if there is none.
  const JsonNode& operator[](std::string_view key) const;

  [[nodiscard]] bool is_true() const { return kind_ == Kind::boolean && number_ != 0; }
  /// Whether this is a number without a fraction.
  [[nodiscard]] bool is_integer() const;
  /// This number as an integer, at most 2^53 in magnitude; -1 if it is none.
  [[nodiscard]] std::int64_t as_integer() const;
  /// Member as an integer: `fallback` if it is absent, -1 if it is faulty.
  [[nodiscard]] std::int64_t integer(std::string_view key, std::int64_t fallback = -1) const;
  /// Member as a number: `fallback` if it is no number.
  [[nodiscard]] double number_or(std::string_view key, double fallback) const;
  /// Member as text: empty if it is none.
  [[nodiscard]] const std::string& text_of(std::string_view key) const;
  /// Size of an array or object; 0 for other kinds.
  [[nodiscard]] std::size_t size() const { return items().size(); }

  /// Replaces the value by one of kind faulty or absent.
  void reject() { kind_ = Kind::faulty; }
  void remove() { kind_ = Kind::absent; }

  void set_text(std::string text);
  JsonNode& add_item(JsonNode item);
  void add_key(std::string key);
  /// Keeps the last value of each repeated key. Returns these keys.
  std::vector<std::string> drop_repeated_keys();

 private:
  struct Compound {
    std::string text;
    std::vector<JsonNode> items;
    std::vector<std::string> keys;
  };
  Compound& compound();

  Kind kind_ = Kind::absent;
  double number_ = 0;
  std::unique_ptr<Compound> compound_;  // of text, arrays and objects
};

/// Parses JSON text. Returns the parser's message if it is not valid, and an empty string
/// otherwise. Calls `on_repeated` with the JSON pointer of each repeated key.
std::string parse_json_tree(std::string_view text, JsonNode& root,
                            const std::function<void(std::string pointer)>& on_repeated);

}  // namespace tessera::render
