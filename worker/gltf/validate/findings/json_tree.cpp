#include "worker/gltf/validate/findings/json_tree.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>
#include <utility>

#include "worker/gltf/validate/findings/findings.h"

namespace tessera::render {

namespace {

using nlohmann::json;

/// Builds a tree from the events of the parser.
class TreeBuilder final : public nlohmann::json_sax<json> {
 public:
  TreeBuilder(JsonNode& root, const std::function<void(std::string)>& on_repeated)
      : root_(root), on_repeated_(on_repeated) {}

  bool null() override { return add(JsonNode(JsonNode::Kind::null)); }
  bool boolean(bool value) override {
    return add(JsonNode(JsonNode::Kind::boolean, value ? 1 : 0));
  }
  bool number_integer(number_integer_t value) override { return add_number(double(value)); }
  bool number_unsigned(number_unsigned_t value) override { return add_number(double(value)); }
  bool number_float(number_float_t value, const string_t& /*text*/) override {
    return add_number(value);
  }
  bool string(string_t& value) override {
    JsonNode node(JsonNode::Kind::text);
    node.set_text(std::move(value));
    return add(std::move(node));
  }
  bool binary(binary_t& /*value*/) override { return false; }
  bool start_object(std::size_t /*size*/) override { return open(JsonNode::Kind::object); }
  bool key(string_t& value) override {
    open_.back()->add_key(std::move(value));
    return true;
  }
  bool end_object() override {
    for (const std::string& key : open_.back()->drop_repeated_keys()) {
      on_repeated_(pointer_to(open_pointer(), key));
    }
    return close();
  }
  bool start_array(std::size_t /*size*/) override { return open(JsonNode::Kind::array); }
  bool end_array() override { return close(); }
  bool parse_error(std::size_t /*position*/, const std::string& /*token*/,
                   const nlohmann::detail::exception& error) override {
    message_ = error.what();
    return false;
  }

  [[nodiscard]] const std::string& message() const { return message_; }

 private:
  JsonNode& place(JsonNode node) {
    if (!open_.empty()) return open_.back()->add_item(std::move(node));
    root_ = std::move(node);
    return root_;
  }
  bool add(JsonNode node) {
    place(std::move(node));
    return true;
  }
  bool add_number(double value) { return add(JsonNode(JsonNode::Kind::number, value)); }
  bool open(JsonNode::Kind kind) {
    open_.push_back(&place(JsonNode(kind)));
    return true;
  }
  bool close() {
    open_.pop_back();
    return true;
  }

  /// JSON pointer of the innermost open container.
  [[nodiscard]] std::string open_pointer() const {
    std::string pointer;
    for (std::size_t i = 0; i + 1 < open_.size(); ++i) {
      const JsonNode& outer = *open_[i];
      pointer = outer.is(JsonNode::Kind::object) ? pointer_to(pointer, outer.keys().back())
                                                 : pointer_to(pointer, outer.size() - 1);
    }
    return pointer;
  }

  JsonNode& root_;
  const std::function<void(std::string)>& on_repeated_;
  std::vector<JsonNode*> open_;  // containers; a container grows only when it is the last
  std::string message_;
};

}  // namespace

JsonNode::JsonNode(Kind kind, double number) : kind_(kind), number_(number) {}

JsonNode::Compound& JsonNode::compound() {
  if (!compound_) compound_ = std::make_unique<Compound>();
  return *compound_;
}

const std::string& JsonNode::text() const {
  static const std::string empty;
  return compound_ && kind_ == Kind::text ? compound_->text : empty;
}

const std::vector<JsonNode>& JsonNode::items() const {
  static const std::vector<JsonNode> none;
  return compound_ && (kind_ == Kind::array || kind_ == Kind::object) ? compound_->items : none;
}

std::vector<JsonNode>& JsonNode::items() {
  return compound().items;
}

const std::vector<std::string>& JsonNode::keys() const {
  static const std::vector<std::string> none;
  return compound_ && kind_ == Kind::object ? compound_->keys : none;
}

const JsonNode* JsonNode::find(std::string_view key) const {
  const std::vector<std::string>& names = keys();
  const auto found = std::find(names.begin(), names.end(), key);
  return found == names.end() ? nullptr : &items()[static_cast<std::size_t>(found - names.begin())];
}

JsonNode* JsonNode::find(std::string_view key) {
  return const_cast<JsonNode*>(std::as_const(*this).find(key));
}

const JsonNode& JsonNode::operator[](std::string_view key) const {
  static const JsonNode absent;
  const JsonNode* found = find(key);
  return found != nullptr ? *found : absent;
}

bool JsonNode::is_integer() const {
  return kind_ == Kind::number && std::isfinite(number_) && number_ == std::floor(number_);
}

std::int64_t JsonNode::as_integer() const {
  constexpr double kLimit = 9007199254740992.0;  // 2^53: products with sizes of elements fit
  return is_integer() ? static_cast<std::int64_t>(std::clamp(number_, -kLimit, kLimit)) : -1;
}

std::int64_t JsonNode::integer(std::string_view key, std::int64_t fallback) const {
  const JsonNode& value = (*this)[key];
  return value.is(Kind::absent) ? fallback : value.as_integer();
}

double JsonNode::number_or(std::string_view key, double fallback) const {
  const JsonNode& value = (*this)[key];
  return value.is(Kind::number) ? value.number() : fallback;
}

const std::string& JsonNode::text_of(std::string_view key) const {
  return (*this)[key].text();
}

void JsonNode::set_text(std::string text) {
  compound().text = std::move(text);
}

JsonNode& JsonNode::add_item(JsonNode item) {
  compound().items.push_back(std::move(item));
  return compound().items.back();
}

void JsonNode::add_key(std::string key) {
  compound().keys.push_back(std::move(key));
}

std::vector<std::string> JsonNode::drop_repeated_keys() {
  if (!compound_ || compound_->keys.size() < 2) return {};
  std::vector<JsonNode>& items = compound_->items;
  std::vector<std::string>& keys = compound_->keys;
  std::vector<std::size_t> order(keys.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&keys](std::size_t a, std::size_t b) {
    const int compared = keys[a].compare(keys[b]);
    return compared != 0 ? compared < 0 : a < b;
  });
  std::vector<bool> repeated(keys.size(), false);
  std::vector<std::string> names;
  for (std::size_t i = order.size() - 1; i > 0; --i) {
    if (keys[order[i]] != keys[order[i - 1]]) continue;
    std::swap(items[order[i - 1]], items[order[i]]);
    repeated[order[i]] = true;
    if (names.empty() || names.back() != keys[order[i]]) names.push_back(keys[order[i]]);
  }
  if (names.empty()) return names;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < keys.size(); ++i) {
    if (repeated[i]) continue;
    if (kept != i) {
      keys[kept] = std::move(keys[i]);
      items[kept] = std::move(items[i]);
    }
    ++kept;
  }
  keys.resize(kept);
  items.resize(kept);
  return names;
}

std::string parse_json_tree(std::string_view text, JsonNode& root,
                            const std::function<void(std::string pointer)>& on_repeated) {
  TreeBuilder builder(root, on_repeated);
  if (json::sax_parse(text.begin(), text.end(), &builder)) return "";
  return builder.message().empty() ? "not valid JSON" : builder.message();
}

}  // namespace tessera::render
