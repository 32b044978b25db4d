#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace tessera::support {

/// What is wrong with `document` under `schema`, each as "PATH: FAULT"; empty if nothing is.
///
/// Knows the part of JSON Schema that docs/reference/schema uses: type, const, enum, required, properties,
/// additionalProperties (false), items, minItems, maxItems, minimum, exclusiveMinimum, maximum,
/// pattern. Any other keyword that would restrict is a fault, so that a
/// schema cannot say what nobody checks.
std::vector<std::string> schema_faults(const nlohmann::json& schema,
                                       const nlohmann::json& document);

/// The schema of documents of a kind ("tessera.job/1" or "job"), from docs/reference/schema. Throws if there
/// is none.
nlohmann::json read_schema(const std::string& kind);

/// Faults of a document under the schema it names itself.
std::vector<std::string> document_faults(const std::string& text);

}  // namespace tessera::support
