#include "worker/gltf/validate/validate.h"

#include <string>
#include <string_view>
#include <utility>

#include "worker/gltf/file/container.h"
#include "worker/gltf/file/limits.h"
#include "worker/gltf/validate/findings/rules.h"
#include "worker/gltf/validate/formats/glb_check.h"
#include "worker/gltf/validate/links/linked_document.h"
#include "worker/gltf/validate/links/resources.h"
#include "worker/gltf/validate/schema/schema_check.h"
#include "worker/gltf/validate/values/value_checks.h"

namespace tessera::render {

namespace {

/// Parses the JSON text. Returns whether there is a root object.
bool parse(std::string_view text, CheckedDocument& document, ValidationFindings& findings) {
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
  if (text.substr(0, kByteOrderMark.size()) == kByteOrderMark) {
    findings.add(rules::kInvalidJson, "", "a byte order mark is not allowed");
    text.remove_prefix(kByteOrderMark.size());
  }
  std::string fault;
  if (text.size() > kMaxJsonBytes || json_depth(text) > kMaxJsonDepth) {
    fault = "too large or nested too deeply";
  } else {
    fault = parse_json_tree(text, document.root, [&findings](std::string pointer) {
      findings.add(rules::kDuplicateKey, std::move(pointer));
    });
  }
  if (!fault.empty()) {
    findings.add(rules::kInvalidJson, "", fault);
    return false;
  }
  if (!document.root.is(JsonNode::Kind::object)) {
    findings.add(rules::kTypeMismatch, "", "the root is no object");
    return false;
  }
  return true;
}

void link(LinkedDocument& document) {
  link_views_and_accessors(document);
  link_images_and_textures(document);
  link_materials(document);
  link_meshes(document);
  link_nodes(document);
  link_skins(document);
  link_animations(document);
  link_scenes(document);
  report_unused_objects(document);
}

}  // namespace

ValidationResult validate_gltf(std::span<const std::byte> file, ResourceReader& reader,
                               std::size_t limit) {
  ValidationResult result{ValidationFindings(limit)};
  ValidationFindings& findings = result.findings;
  CheckedDocument document;
  std::string_view text(reinterpret_cast<const char*>(file.data()), file.size());
  GlbChunks chunks;
  document.is_glb = !text.empty() && text[0] == 'g';
  if (document.is_glb) {
    chunks = check_glb(file, findings);
    if (!chunks.json) return result;
    text = *chunks.json;
  }
  if (!parse(text, document, findings) || !check_schema(document, findings)) return result;
  LinkedDocument linked(document, findings);
  link(linked);
  if (document.is_glb && !chunks.is_complete) return result;
  DecodedUris decoded;
  load_buffers(linked, chunks.binary ? &*chunks.binary : nullptr, reader, decoded);
  check_images(linked, reader);
  std::uint64_t bytes = 0;
  for (const BufferBytes& each : linked.buffer_bytes) bytes += each.bytes.size();
  constexpr std::uint64_t kValuesPerByte = 16, kSpareValues = std::uint64_t{1} << 26U;
  ValueBudget budget(kValuesPerByte * bytes + kSpareValues);
  check_accessor_values(linked, budget);
  check_skinned_vertices(linked, budget);
  result.is_partial = budget.is_exhausted() || linked.is_partial;
  return result;
}

}  // namespace tessera::render
