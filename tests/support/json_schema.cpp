#include "tests/support/json_schema.h"

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>
#include <regex>
#include <stdexcept>

namespace tessera::support {
namespace {

using nlohmann::json;

class Checker {
 public:
  void check(const json& schema, const json& value, const std::string& path) {
    for (const auto& [keyword, rule] : schema.items()) {
      if (keyword == "type") {
        check_type(rule, value, path);
      } else if (keyword == "const") {
        if (value != rule) fault(path, "is not " + rule.dump());
      } else if (keyword == "enum") {
        if (std::find(rule.begin(), rule.end(), value) == rule.end()) {
          fault(path, value.dump() + " is not one of " + rule.dump());
        }
      } else if (keyword == "minimum" || keyword == "maximum" || keyword == "exclusiveMinimum") {
        check_bound(keyword, rule, value, path);
      } else if (keyword == "pattern") {
        if (value.is_string() &&
            !std::regex_search(value.get<std::string>(), std::regex(rule.get<std::string>()))) {
          fault(path, value.dump() + " does not match " + rule.dump());
        }
      } else if (keyword == "required") {
        for (const json& key : rule) {
          if (value.is_object() && !value.contains(key.get<std::string>())) {
            fault(path, "has no " + key.dump());
          }
        }
      } else if (keyword == "properties") {
        for (const auto& [key, inner] : rule.items()) {
          const std::string below = std::string(path).append("/").append(key);
          if (value.is_object() && value.contains(key)) check(inner, value[key], below);
        }
      } else if (keyword == "additionalProperties") {
        check_additional(rule, schema, value, path);
      } else if (keyword == "minItems" || keyword == "maxItems") {
        const bool fits = keyword == "minItems" ? value.size() >= rule : value.size() <= rule;
        if (value.is_array() && !fits) fault(path, "breaks " + keyword + " " + rule.dump());
      } else if (keyword == "items") {
        for (std::size_t i = 0; value.is_array() && i < value.size(); ++i) {
          check(rule, value[i], path + "/" + std::to_string(i));
        }
      } else if (keyword == "if") {
        Checker condition;
        condition.check(rule, value, path);
        if (condition.faults.empty()) check(schema.at("then"), value, path);
      } else if (keyword != "then" && keyword != "description" && keyword != "title" &&
                 keyword != "default" && keyword[0] != '$') {
        fault(path, "the schema's keyword " + keyword + " is not known here");
      }
    }
  }

  std::vector<std::string> faults;

 private:
  void fault(const std::string& path, const std::string& what) {
    faults.push_back((path.empty() ? "/" : path) + ": " + what);
  }

  static bool is_of(const std::string& type, const json& value) {
    if (type == "object") return value.is_object();
    if (type == "array") return value.is_array();
    if (type == "string") return value.is_string();
    if (type == "boolean") return value.is_boolean();
    if (type == "null") return value.is_null();
    if (type == "integer") return value.is_number_integer();
    return type == "number" && value.is_number();
  }

  void check_type(const json& rule, const json& value, const std::string& path) {
    const bool fits = rule.is_string()
                          ? is_of(rule.get<std::string>(), value)
                          : std::any_of(rule.begin(), rule.end(), [&value](const json& type) {
                              return is_of(type.get<std::string>(), value);
                            });
    if (!fits) fault(path, std::string(value.type_name()) + " is not " + rule.dump());
  }

  void check_additional(const json& rule, const json& schema, const json& value,
                        const std::string& path) {
    if (rule != false) return fault(path, "additionalProperties other than false are not known");
    if (!value.is_object()) return;
    for (const auto& item : value.items()) {
      if (!schema["properties"].contains(item.key())) fault(path, item.key() + " is unknown");
    }
  }

  void check_bound(const std::string& keyword, const json& rule, const json& value,
                   const std::string& path) {
    if (!value.is_number()) return;
    const bool fits = keyword == "minimum"   ? value >= rule
                      : keyword == "maximum" ? value <= rule
                                             : value > rule;
    if (!fits) fault(path, value.dump() + " breaks " + keyword + " " + rule.dump());
  }
};

}  // namespace

std::vector<std::string> schema_faults(const json& schema, const json& document) {
  Checker checker;
  checker.check(schema, document, "");
  return checker.faults;
}

json read_schema(const std::string& kind) {
  std::string name = kind;
  if (name.rfind("tessera.", 0) == 0) name = name.substr(8);
  name = name.substr(0, name.find('/'));
  std::ifstream file(std::string(TESSERA_SOURCE_DIR) + "/docs/reference/schema/" + name + ".json");
  if (!file) throw std::runtime_error("no schema of " + kind);
  return json::parse(file);
}

std::vector<std::string> document_faults(const std::string& text) {
  const json document = json::parse(text, nullptr, false);
  if (!document.is_object() || !document.contains("schema")) {
    return {"not a JSON document that names its schema"};
  }
  return schema_faults(read_schema(document["schema"].get<std::string>()), document);
}

}  // namespace tessera::support
