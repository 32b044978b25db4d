#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <string_view>

namespace tessera::render::schema {

inline constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Types of objects in a glTF document.
enum class Type : std::uint8_t {
  root,
  asset,
  accessor,
  sparse,
  sparse_indices,
  sparse_values,
  animation,
  channel,
  channel_target,
  animation_sampler,
  buffer,
  buffer_view,
  camera,
  orthographic,
  perspective,
  image,
  material,
  metallic_roughness,
  texture_info,
  normal_texture,
  occlusion_texture,
  mesh,
  primitive,
  node,
  sampler,
  scene,
  skin,
  texture,
  // Objects of extensions.
  webp,
  animation_pointer,
  lights,
  light,
  spot,
  node_light,
  anisotropy,
  clearcoat,
  dispersion,
  emissive_strength,
  ior,
  iridescence,
  specular_glossiness,
  sheen,
  specular,
  transmission,
  unlit,
  variants,
  variant,
  variant_mappings,
  variant_mapping,
  volume,
  texture_transform
};

/// Form of a member's value.
enum class Form : std::uint8_t {
  index,    // a non-negative integer
  integer,  // in [low, high]
  code,     // an integer of `codes`
  number,   // in the range
  boolean,
  text,        // one of `words` unless that is empty
  numbers,     // an array of `length` numbers in [low, high]; 0: any length
  bounds,      // min or max of an accessor
  indices,     // an array of indices
  names,       // an array of strings
  object,      // of `type`
  objects,     // an array of objects of `type`
  collection,  // an array of objects of `type` in the root
  attributes,  // an object of accessors
  targets,     // an array of objects of accessors
};

/// Required form of a text.
enum class Pattern : std::uint8_t { none, version, pointer };

/// A member of an object.
struct Member {
  std::string_view name;
  double low = -kInfinity, high = kInfinity;
  double also = std::numeric_limits<double>::quiet_NaN();  // allowed outside the range
  std::size_t length = 0;
  std::span<const int> codes = {};
  std::span<const std::string_view> words = {};
  /// One more word while an extension is in use.
  std::string_view word_extension = {}, extension_word = {};
  Form form = Form::text;
  Type type = Type::root;
  Pattern pattern = Pattern::none;
  bool required = false;
  /// Read only if the sibling "type" is the member's name.
  bool by_type = false;
  bool low_open = false, high_open = false;
};

/// Members of objects of a type, in the order in which they are checked.
std::span<const Member> members_of(Type type);

/// An extension object: its name, where it may stand and its type.
struct ExtensionObject {
  std::string_view name;
  Type holder, type;
  bool alone = false;  // may not be combined with other extensions
};

/// The extension objects whose contents are known.
std::span<const ExtensionObject> extension_objects();

/// Returns whether the contents of an extension are known.
bool is_known_extension(std::string_view name);

/// Returns whether an extension may be used only if it is required.
bool must_be_required(std::string_view name);

}  // namespace tessera::render::schema
