#pragma once

#include <string_view>

#include "worker/gltf/validate/findings/json_tree.h"

namespace tessera::render {

/// A numbered attribute such as TEXCOORD_0.
struct NumberedAttribute {
  std::string_view semantic;  // empty if the name is none
  int set = -1;
};

/// Splits a name such as TEXCOORD_0 of the semantics COLOR, JOINTS, TEXCOORD and WEIGHTS.
NumberedAttribute numbered_attribute(std::string_view name);

/// Whether glTF defines an attribute of this name, or it is specific to an application (_NAME).
bool is_attribute(std::string_view name);
/// The same for an attribute of a morph target.
bool is_target_attribute(std::string_view name);

/// Number of sets of a numbered semantic, which must be 0, 1, ... without gaps; -1 if they are not.
int numbered_sets(const JsonNode& attributes, std::string_view semantic);

/// The part of a name before "_", which determines the allowed formats.
std::string_view semantic_of(std::string_view name);

}  // namespace tessera::render
