#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace tessera::support {

/// Returns the faults of `document` under `schema`, each as "PATH: FAULT".
///
/// Supports the keywords that docs/reference/schema uses: type, const, enum, required, properties,
/// additionalProperties (false), items, minItems, maxItems, minimum, exclusiveMinimum, maximum,
/// pattern. Any other restricting keyword is a fault, so that no schema has a rule that nobody
/// checks.
std::vector<std::string> schema_faults(const nlohmann::json& schema,
                                       const nlohmann::json& document);

/// Reads the schema of a kind of documents ("tessera.job/1" or "job") from docs/reference/schema.
/// Throws if there is none.
nlohmann::json read_schema(const std::string& kind);

/// Returns the faults of a document under the schema that it names.
std::vector<std::string> document_faults(const std::string& text);

}  // namespace tessera::support
