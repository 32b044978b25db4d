#pragma once

#include <set>
#include <string>
#include <string_view>

#include "worker/gltf/validate/findings/findings.h"
#include "worker/gltf/validate/findings/json_tree.h"
#include "worker/gltf/validate/schema/schema_table.h"

namespace tessera::render {

/// A document in the course of its validation.
struct CheckedDocument {
  JsonNode root;
  bool is_glb = false;
  std::set<std::string, std::less<>> declared;  // extensionsUsed
  std::set<std::string, std::less<>> enabled;   // those of them that are known

  /// The extension of an object if it is known and declared; a node of kind absent otherwise.
  [[nodiscard]] const JsonNode& extension(const JsonNode& object, std::string_view name) const;
};

/// Checks types, ranges and required members against the schema of glTF 2.0, and rules that
/// concern one object. Rejects faulty values in `document.root`, so that the checks that follow
/// meet only values of the right form. Returns whether the version allows them.
bool check_schema(CheckedDocument& document, ValidationFindings& findings);

/// Checks rules between the members of an object of `type`; part of check_schema().
void check_object_rules(schema::Type type, const JsonNode& object_json, const std::string& path,
                        const CheckedDocument& document, ValidationFindings& findings);

}  // namespace tessera::render
