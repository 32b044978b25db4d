#include "worker/gltf/validate/schema/schema_check.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "worker/gltf/validate/findings/rules.h"
#include "worker/gltf/validate/schema/attribute_names.h"

namespace tessera::render {

namespace {

using Kind = JsonNode::Kind;
using schema::Form;
using schema::Member;
using schema::Type;

bool in_range(const Member& member, double value) {
  if (value == member.also) return true;
  const bool low = member.low_open ? value > member.low : value >= member.low;
  const bool high = member.high_open ? value < member.high : value <= member.high;
  return low && high && std::isfinite(value);
}

/// "N.N" of decimal digits.
bool is_version(std::string_view text) {
  const std::size_t dot = text.find('.');
  const auto digits = [](std::string_view part) {
    return !part.empty() &&
           std::all_of(part.begin(), part.end(), [](char c) { return c >= '0' && c <= '9'; });
  };
  return dot != std::string_view::npos && digits(text.substr(0, dot)) &&
         digits(text.substr(dot + 1));
}

/// A JSON pointer: empty, or "/" before each token, with ~ only in ~0 and ~1.
bool is_json_pointer(std::string_view text) {
  if (!text.empty() && text[0] != '/') return false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] == '~' && (i + 1 == text.size() || (text[i + 1] != '0' && text[i + 1] != '1'))) {
      return false;
    }
  }
  return true;
}

bool matches(schema::Pattern pattern, std::string_view text) {
  switch (pattern) {
    case schema::Pattern::none:
      return true;
    case schema::Pattern::version:
      return is_version(text);
    case schema::Pattern::pointer:
      return is_json_pointer(text);
  }
  return true;
}

/// Letters, digits and _, with a prefix of capitals and digits.
bool is_extension_name(std::string_view name) {
  const auto is_capital = [](char c) { return (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9'); };
  const std::size_t bar = name.find('_');
  if (bar == std::string_view::npos || bar == 0 || bar + 1 == name.size()) return false;
  return std::all_of(name.begin(), name.begin() + static_cast<std::ptrdiff_t>(bar), is_capital) &&
         std::all_of(name.begin(), name.end(),
                     [&](char c) { return is_capital(c) || (c >= 'a' && c <= 'z') || c == '_'; });
}

/// Range of an integer component type of an accessor.
std::pair<double, double> range_of(std::int64_t component_type) {
  switch (component_type) {
    case 5120:
      return {-128, 127};
    case 5121:
      return {0, 255};
    case 5122:
      return {-32768, 32767};
    case 5123:
      return {0, 65535};
    default:
      return {0, 4294967295.0};
  }
}

std::size_t components_of(std::string_view type) {
  if (type == "SCALAR") return 1;
  if (type == "VEC2") return 2;
  if (type == "VEC3") return 3;
  if (type == "VEC4" || type == "MAT2") return 4;
  if (type == "MAT3") return 9;
  return type == "MAT4" ? 16 : 0;
}

class SchemaCheck {
 public:
  SchemaCheck(CheckedDocument& document, ValidationFindings& findings)
      : document_(document), findings_(findings) {}

  bool run() {
    JsonNode& root = document_.root;
    const auto members = schema::members_of(Type::root);
    unexpected(members, root, "");
    if (root.has("extensionsRequired") && !root.has("extensionsUsed")) {
      findings_.add(rules::kUnsatisfiedDependency, "/extensionsRequired", "extensionsUsed");
    }
    member(members[0], root, "/");
    member(members[1], root, "/");
    read_extensions();
    if (!asset(root)) return false;
    for (const Member& each : members.subspan(3)) member(each, root, "/");
    extensions(Type::root, root, "/");
    extras(root, "/");
    return true;
  }

 private:
  /// Checks the version. Returns whether the rest can be checked.
  bool asset(JsonNode& root) {
    JsonNode* value = root.find("asset");
    if (value == nullptr || value->is(Kind::null)) {
      if (value != nullptr) findings_.add(rules::kTypeMismatch, "/asset", "null, not an object");
      findings_.add(rules::kUndefinedProperty, "/", "asset");
      return false;
    }
    if (!value->is(Kind::object)) {
      findings_.add(rules::kTypeMismatch, "/asset", "not an object");
      return false;
    }
    object(Type::asset, *value, "/asset");
    const std::string& version = value->text_of("version");
    if (version.empty()) return false;
    const std::string major = version.substr(0, version.find('.'));
    const std::string minor = version.substr(version.find('.') + 1);
    if (major.find_first_not_of('0') == std::string::npos ||
        major.substr(major.find_first_not_of('0')) != "2") {
      findings_.add(rules::kUnknownAssetMajorVersion, "/asset/version", version);
      return false;
    }
    if (minor.find_first_not_of('0') != std::string::npos) {
      findings_.add(rules::kUnknownAssetMinorVersion, "/asset/version", version);
    }
    return true;
  }

  void read_extensions() {
    const JsonNode& used = document_.root["extensionsUsed"];
    const JsonNode& required = document_.root["extensionsRequired"];
    std::set<std::string_view> required_names;
    for (const JsonNode& each : required.items()) required_names.insert(each.text());
    for (const JsonNode& each : used.items()) document_.declared.insert(each.text());
    for (std::size_t i = 0; i < used.size(); ++i) {
      const std::string& name = used.items()[i].text();
      if (!is_extension_name(name)) {
        findings_.add_at(rules::kInvalidExtensionNameFormat, "/extensionsUsed", i, name);
      }
      if (!schema::is_known_extension(name)) {
        findings_.add_at(rules::kUnsupportedExtension, "/extensionsUsed", i, name);
        continue;
      }
      if (schema::must_be_required(name) && required_names.count(name) == 0) {
        findings_.add_at(rules::kNonRequiredExtension, "/extensionsUsed", i, name);
      }
      document_.enabled.insert(name);
    }
    for (std::size_t i = 0; i < required.size(); ++i) {
      const std::string& name = required.items()[i].text();
      if (document_.declared.count(name) == 0) {
        findings_.add_at(rules::kUnusedExtensionRequired, "/extensionsRequired", i, name);
      }
    }
  }

  // The nesting depth of the schema bounds this recursion.
  void object(Type type, JsonNode& node, const std::string& path) {
    const auto members = schema::members_of(type);
    unexpected(members, node, path);
    for (const Member& each : members) {
      if (!each.by_type || node.text_of("type") == each.name) member(each, node, path);
    }
    extensions(type, node, path);
    extras(node, path);
    check_object_rules(type, node, path, document_, findings_);
  }

  void unexpected(std::span<const Member> members, const JsonNode& node, const std::string& path) {
    for (const std::string& key : node.keys()) {
      const bool known = key == "extensions" || key == "extras" ||
                         std::any_of(members.begin(), members.end(),
                                     [&key](const Member& each) { return each.name == key; });
      if (!known) findings_.add_at(rules::kUnexpectedProperty, path, key);
    }
  }

  void extras(const JsonNode& node, const std::string& path) {
    const JsonNode* value = node.find("extras");
    if (value != nullptr && !value->is(Kind::object) && !value->is(Kind::null)) {
      findings_.add_at(rules::kNonObjectExtras, path, "extras");
    }
  }

  void extensions(Type holder, JsonNode& node, const std::string& path) {
    JsonNode* list = node.find("extensions");
    if (list == nullptr) return;
    if (!list->is(Kind::object)) {
      findings_.add_at(rules::kTypeMismatch, path, "extensions", "not an object");
      list->is(Kind::null) ? list->remove() : list->reject();
      return;
    }
    const std::string inner = pointer_to(path, "extensions");
    for (std::size_t i = 0; i < list->size(); ++i) {
      extension(holder, list->keys()[i], list->items()[i], list->size(), inner);
    }
  }

  void extension(Type holder, const std::string& name, JsonNode& value, std::size_t siblings,
                 const std::string& path) {
    if (!value.is(Kind::object)) {
      findings_.add_at(rules::kTypeMismatch, path, name, "not an object");
      value = JsonNode(Kind::object);
    }
    if (document_.enabled.count(name) == 0) {
      if (document_.declared.count(name) == 0) {
        findings_.add_at(rules::kUndeclaredExtension, path, name);
      }
      return;
    }
    const auto known = schema::extension_objects();
    const auto found = std::find_if(known.begin(), known.end(), [&](const auto& each) {
      return each.name == name && each.holder == holder;
    });
    if (found == known.end()) {
      findings_.add_at(rules::kUnexpectedExtensionObject, path, name);
      value.reject();
      return;
    }
    if (found->alone && siblings > 1) findings_.add_at(rules::kMultipleExtensions, path, name);
    object(found->type, value, pointer_to(path, name));
  }

  void member(const Member& member, JsonNode& holder, const std::string& path) {
    JsonNode* value = holder.find(member.name);
    if (value != nullptr && value->is(Kind::null)) {
      findings_.add_at(rules::kTypeMismatch, path, member.name, "null");
      member.form == Form::collection ? value->reject() : value->remove();
      if (member.form == Form::collection) return;
      value = nullptr;
    }
    if (value != nullptr) {
      if (!check_value(member, holder, *value, path)) value->reject();
    } else if (member.required) {
      findings_.add(rules::kUndefinedProperty, path, member.name);
    }
  }

  bool wrong_type(const Member& member, const std::string& path) {
    findings_.add_at(rules::kTypeMismatch, path, member.name);
    return false;
  }

  bool check_value(const Member& m, const JsonNode& holder, JsonNode& value,
                   const std::string& path) {
    switch (m.form) {
      case Form::index:
      case Form::integer:
      case Form::code:
        return value.is_integer() ? check_integer(m, value.number(), path) : wrong_type(m, path);
      case Form::number:
        if (!value.is(Kind::number)) return wrong_type(m, path);
        if (in_range(m, value.number())) return true;
        findings_.add_at(rules::kValueNotInRange, path, m.name, number_text(value.number()));
        return false;
      case Form::boolean:
        return value.is(Kind::boolean) || wrong_type(m, path);
      case Form::text:
        return value.is(Kind::text) ? check_text(m, value.text(), path) : wrong_type(m, path);
      case Form::object:
        if (!value.is(Kind::object)) return wrong_type(m, path);
        object(m.type, value, pointer_to(path, m.name));
        return true;
      case Form::attributes:
        return value.is(Kind::object) ? check_attributes(value, pointer_to(path, m.name), false)
                                      : wrong_type(m, path);
      default:
        return value.is(Kind::array) ? check_array(m, holder, value, path) : wrong_type(m, path);
    }
  }

  static std::string number_text(double number) {
    char text[32];
    std::snprintf(text, sizeof text, "%.9g", number);
    return text;
  }

  bool check_integer(const Member& m, double value, const std::string& path) {
    const ValidationRule* rule = nullptr;
    if (m.form == Form::index && value < 0) rule = &rules::kInvalidIndex;
    if (m.form == Form::integer && !in_range(m, value)) rule = &rules::kValueNotInRange;
    if (m.form == Form::code && std::find(m.codes.begin(), m.codes.end(), value) == m.codes.end()) {
      rule = &rules::kValueNotInList;
    }
    if (rule != nullptr) findings_.add_at(*rule, path, m.name, number_text(value));
    return rule == nullptr;
  }

  bool check_text(const Member& m, const std::string& text, const std::string& path) {
    if (!matches(m.pattern, text)) {
      findings_.add_at(rules::kPatternMismatch, path, m.name, text);
      return false;
    }
    const bool is_extension_word = !m.extension_word.empty() && text == m.extension_word &&
                                   document_.enabled.count(m.word_extension) != 0;
    if (!m.words.empty() && !is_extension_word &&
        std::find(m.words.begin(), m.words.end(), text) == m.words.end()) {
      findings_.add_at(rules::kValueNotInList, path, m.name, text);
    }
    return true;  // an unknown word is only a warning
  }

  bool check_array(const Member& m, const JsonNode& holder, JsonNode& value,
                   const std::string& path) {
    const bool integer_bounds = m.form == Form::bounds && holder.integer("componentType") != 5126;
    if (value.size() == 0 && !integer_bounds) {
      findings_.add_at(rules::kEmptyEntity, path, m.name);
      return false;
    }
    switch (m.form) {
      case Form::numbers:
        return check_numbers(m, m.length, value, path);
      case Form::bounds:
        return check_bounds(m, holder, value, path);
      case Form::indices:
        return check_indices(value, pointer_to(path, m.name));
      case Form::names:
        return check_names(value, pointer_to(path, m.name));
      case Form::objects:
        return check_objects(m, value, path);
      case Form::collection:
        check_collection(m, value, pointer_to(path, m.name));
        return true;
      default:
        return check_targets(value, pointer_to(path, m.name));
    }
  }

  bool check_numbers(const Member& m, std::size_t length, JsonNode& value,
                     const std::string& path) {
    if (length != 0 && value.size() != length) {
      findings_.add_at(rules::kArrayLengthNotInList, path, m.name, std::to_string(value.size()));
      return false;
    }
    bool valid = true;
    for (std::size_t i = 0; i < value.size(); ++i) {
      const JsonNode& element = value.items()[i];
      if (!element.is(Kind::number)) {
        findings_.add_at(rules::kArrayTypeMismatch, path, m.name, "an element is no number");
        valid = false;
      } else if (!in_range(m, element.number())) {
        findings_.add_at(rules::kValueNotInRange, pointer_to(path, m.name), i,
                         number_text(element.number()));
        valid = false;
      }
    }
    return valid;
  }

  /// Checks min or max of an accessor whose types are valid; otherwise drops it.
  bool check_bounds(const Member& m, const JsonNode& accessor, JsonNode& value,
                    const std::string& path) {
    const std::size_t length = components_of(accessor.text_of("type"));
    const std::int64_t type = accessor.integer("componentType");
    if (length == 0 || type == -1) return false;
    if (type == 5126) return check_numbers(m, length, value, path);
    if (value.size() != length) {
      findings_.add_at(rules::kArrayLengthNotInList, path, m.name, std::to_string(value.size()));
      return false;
    }
    const auto [low, high] = range_of(type);
    bool valid = true;
    for (const JsonNode& element : value.items()) {
      const bool fits = element.number() >= low && element.number() <= high;
      if (element.is_integer() && fits) continue;
      findings_.add_at(element.is_integer() ? rules::kInvalidGlValue : rules::kArrayTypeMismatch,
                       path, m.name);
      valid = false;
    }
    return valid;
  }

  bool check_indices(JsonNode& value, const std::string& path) {
    std::set<double> seen;
    for (std::size_t i = 0; i < value.size(); ++i) {
      JsonNode& element = value.items()[i];
      if (!element.is_integer() || element.number() < 0) {
        findings_.add_at(rules::kInvalidIndex, path, i);
        element.reject();
      } else if (!seen.insert(element.number()).second) {
        findings_.add_at(rules::kDuplicateElements, path, i, number_text(element.number()));
      }
    }
    return true;
  }

  bool check_names(JsonNode& value, const std::string& path) {
    std::set<std::string_view> seen;
    bool valid = true;
    for (std::size_t i = 0; i < value.size(); ++i) {
      const JsonNode& element = value.items()[i];
      if (!element.is(Kind::text)) {
        findings_.add_at(rules::kArrayTypeMismatch, path, i, "not a string");
        valid = false;
      } else if (!seen.insert(element.text()).second) {
        findings_.add_at(rules::kDuplicateElements, path, i, element.text());
      }
    }
    return valid;
  }

  bool check_objects(const Member& m, JsonNode& value, const std::string& path) {
    for (const JsonNode& element : value.items()) {
      if (element.is(Kind::object)) continue;
      findings_.add_at(rules::kArrayTypeMismatch, path, m.name, "an element is no object");
      return false;
    }
    check_collection(m, value, pointer_to(path, m.name));
    return true;
  }

  void check_collection(const Member& m, JsonNode& value, const std::string& path) {
    for (std::size_t i = 0; i < value.size(); ++i) {
      JsonNode& element = value.items()[i];
      if (element.is(Kind::object)) {
        object(m.type, element, pointer_to(path, i));
      } else {
        findings_.add_at(rules::kTypeMismatch, path, i, "not an object");
        element.reject();
      }
    }
  }

  /// Checks the names and values of a primitive's attributes, or of a morph target.
  bool check_attributes(JsonNode& value, const std::string& path, bool of_target) {
    if (value.size() == 0) {
      findings_.add(rules::kEmptyEntity, path);
      return false;
    }
    for (std::size_t i = 0; i < value.size(); ++i) {
      const std::string& name = value.keys()[i];
      if (of_target ? !is_target_attribute(name) : !is_attribute(name)) {
        findings_.add_at(rules::kMeshPrimitiveInvalidAttribute, path, name);
      }
      JsonNode& index = value.items()[i];
      if (!index.is_integer() || index.number() < 0) {
        findings_.add_at(rules::kInvalidIndex, path, name);
        index.reject();
      }
    }
    return true;
  }

  bool check_targets(JsonNode& value, const std::string& path) {
    bool valid = true;
    for (std::size_t i = 0; i < value.size(); ++i) {
      JsonNode& target = value.items()[i];
      if (target.is(Kind::object)) {
        valid = check_attributes(target, pointer_to(path, i), true) && valid;
      } else {
        findings_.add(rules::kArrayTypeMismatch, path, "an element is no object");
        valid = false;
      }
    }
    return valid;
  }

  CheckedDocument& document_;
  ValidationFindings& findings_;
};

}  // namespace

const JsonNode& CheckedDocument::extension(const JsonNode& object, std::string_view name) const {
  static const JsonNode absent;
  return enabled.count(name) != 0 ? object["extensions"][name] : absent;
}

bool check_schema(CheckedDocument& document, ValidationFindings& findings) {
  return SchemaCheck(document, findings).run();
}

}  // namespace tessera::render
