#include "worker/gltf/validate/schema/attribute_names.h"

#include <algorithm>

namespace tessera::render {

namespace {

bool is_plain(std::string_view name) {
  return name == "POSITION" || name == "NORMAL" || name == "TANGENT";
}

bool is_application_specific(std::string_view name) {
  return !name.empty() && name[0] == '_';
}

}  // namespace

std::string_view semantic_of(std::string_view name) {
  return name.substr(0, name.find('_'));
}

NumberedAttribute numbered_attribute(std::string_view name) {
  constexpr std::string_view kSemantics[] = {"COLOR", "JOINTS", "TEXCOORD", "WEIGHTS"};
  const std::string_view semantic = semantic_of(name);
  if (semantic.size() == name.size() ||
      std::find(std::begin(kSemantics), std::end(kSemantics), semantic) == std::end(kSemantics)) {
    return {};
  }
  const std::string_view digits = name.substr(semantic.size() + 1);
  constexpr std::size_t kMaxDigits = 9;
  const bool is_number =
      !digits.empty() && digits.size() <= kMaxDigits && (digits.size() == 1 || digits[0] != '0') &&
      std::all_of(digits.begin(), digits.end(), [](char c) { return c >= '0' && c <= '9'; });
  if (!is_number) return {};
  int set = 0;
  for (const char c : digits) set = 10 * set + (c - '0');
  return {semantic, set};
}

int numbered_sets(const JsonNode& attributes, std::string_view semantic) {
  int count = 0, highest = -1;
  for (const std::string& name : attributes.keys()) {
    const NumberedAttribute numbered = numbered_attribute(name);
    if (numbered.semantic != semantic) continue;
    ++count;
    highest = std::max(highest, numbered.set);
  }
  return highest + 1 == count ? count : -1;
}

bool is_attribute(std::string_view name) {
  return is_application_specific(name) || is_plain(name) || numbered_attribute(name).set >= 0;
}

bool is_target_attribute(std::string_view name) {
  const NumberedAttribute numbered = numbered_attribute(name);
  return is_application_specific(name) || is_plain(name) || numbered.semantic == "COLOR" ||
         numbered.semantic == "TEXCOORD";
}

}  // namespace tessera::render
