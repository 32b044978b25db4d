#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "worker/gltf/validate/findings/findings.h"
#include "worker/gltf/validate/findings/json_tree.h"
#include "worker/gltf/validate/formats/image_header.h"
#include "worker/gltf/validate/schema/schema_check.h"

namespace tessera::render {

inline constexpr std::int64_t kNoIndex = -1;

/// An array of the document whose elements refer to each other by index.
class Collection {
 public:
  Collection() = default;
  Collection(std::string path, const JsonNode& array);

  [[nodiscard]] std::size_t size() const { return items_.size(); }
  /// The element, or null if there is none or it is faulty.
  [[nodiscard]] const JsonNode* get(std::int64_t index) const;
  void use(std::int64_t index) { used_[static_cast<std::size_t>(index)] = true; }
  [[nodiscard]] bool is_used(std::size_t index) const { return used_[index]; }
  [[nodiscard]] std::string pointer(std::size_t index) const { return pointer_to(path_, index); }
  /// Reports the elements that nothing uses.
  void report_unused(ValidationFindings& findings) const;

 private:
  std::string path_;
  std::vector<const JsonNode*> items_;
  std::vector<bool> used_;
};

/// Component types of accessors. Source: glTF 2.0, section 3.6.2.2.
inline constexpr std::int64_t kByte = 5120, kUnsignedByte = 5121, kShort = 5122,
                              kUnsignedShort = 5123, kUnsignedInt = 5125, kFloat = 5126;

/// Type of an accessor's elements.
struct AccessorFormat {
  std::string_view type;
  std::int64_t component = 0;
  bool normalized = false;
  bool operator==(const AccessorFormat&) const = default;
};

/// Contents of a buffer view, and use of an accessor.
enum class ViewRole : std::uint8_t { none, vertices, indices, inverse_binds, image, other };
enum class AccessorRole : std::uint8_t {
  none,
  attribute,
  indices,
  inverse_binds,
  animation_input,
  animation_output
};

struct LinkedView {
  std::int64_t buffer = kNoIndex, offset = 0, length = kNoIndex, stride = kNoIndex;
  ViewRole role = ViewRole::none;
  std::int64_t attribute = kNoIndex;  // an attribute that reads it without a stride
};

struct LinkedAccessor {
  std::int64_t view = kNoIndex;  // of an existing view
  std::int64_t offset = 0, count = kNoIndex;
  AccessorFormat format;
  std::int64_t component_bytes = 0, components = 0;
  AccessorRole role = AccessorRole::none;
  bool has_sparse = false, has_bounds = false;

  /// Whether type, component type and count are known.
  [[nodiscard]] bool is_complete() const {
    return count != kNoIndex && components > 0 && component_bytes > 0;
  }
  /// Bytes of an element without the padding after it, and with it. Columns of matrices begin at
  /// multiples of 4 bytes.
  [[nodiscard]] std::int64_t element_bytes() const;
  [[nodiscard]] std::int64_t packed_stride() const;
};

struct LinkedMaterial {
  bool has_normal_texture = false, needs_tangents = false;
  std::map<std::string, std::int64_t> texcoords;  // by pointer of the texture reference
};

struct LinkedPrimitive {
  std::map<std::string, std::int64_t, std::less<>> attributes;  // those that exist
  std::int64_t vertices = kNoIndex;
  int joint_sets = 0;
  std::optional<std::size_t> targets;
};

struct LinkedMesh {
  std::vector<LinkedPrimitive> primitives;
  bool weights_used = false;
  [[nodiscard]] bool any_joints() const;
  [[nodiscard]] bool all_without_joints() const;
};

struct LinkedNode {
  std::int64_t parent = kNoIndex;
  bool is_joint = false;
  bool in_loop = false;              // the node is its own ancestor
  std::int64_t root = kNoIndex;      // topmost ancestor; in and below a loop one of its nodes
  std::size_t enter = 0, leave = 0;  // of a walk in depth-first order: descendants lie between
};

/// A rule for the values of an accessor, found by a link.
struct ValueCheck {
  enum class Kind : std::uint8_t {
    unit_vectors,
    tangents,
    colours,
    indices,
    times,
    quaternions,
    inverse_binds
  };
  Kind kind;
  std::int64_t accessor = kNoIndex;
  std::string pointer;
  std::int64_t vertices = kNoIndex;  // of indices
  bool triangles = false;            // of indices
  bool cubic = false;                // of quaternions
};

/// A buffer's bytes; empty if they are missing.
struct BufferBytes {
  bool present = false;
  std::span<const std::byte> bytes;
};

/// A document with its references resolved, as far as they can be.
struct LinkedDocument {
  LinkedDocument(const CheckedDocument& checked, ValidationFindings& findings);

  const CheckedDocument& checked;
  ValidationFindings& findings;
  Collection accessors, animations, buffers, buffer_views, cameras, images, materials, meshes,
      nodes, samplers, scenes, skins, textures, lights, variants;
  std::vector<LinkedView> views;
  std::vector<LinkedAccessor> linked_accessors;
  std::vector<LinkedMaterial> linked_materials;
  std::vector<LinkedMesh> linked_meshes;
  std::vector<LinkedNode> linked_nodes;
  std::vector<ValueCheck> value_checks;
  std::set<std::int64_t> sharing_accessors;  // attributes that share a view without a stride
  std::vector<BufferBytes> buffer_bytes;
  bool is_partial = false;  // some links were not followed, as they would take too long
  std::vector<std::string_view> image_types;  // media types of the images that were read

  /// Looks up element `index` of `in` for the member `key` of `path`, and marks it as used. Returns
  /// null, with a finding, if there is none; null without a finding for an index of -1.
  const JsonNode* resolve(Collection& in, std::int64_t index, const std::string& path,
                          std::string_view key);
  /// Records a use of a view or an accessor; a finding if it has another one.
  void use_view(std::int64_t view_index, ViewRole role, const std::string& pointer);
  void use_accessor(std::int64_t accessor_index, AccessorRole role, const std::string& pointer);
  [[nodiscard]] const LinkedView* view_of(const LinkedAccessor& accessor) const;
};

/// Whether elements of `size` bytes at `offset`, `length` bytes in all, are aligned within a view
/// and fit it. Adds findings at `path` unless `findings` is null.
bool fits_view(const LinkedView& view, std::int64_t offset, std::int64_t size, std::int64_t length,
               ValidationFindings* findings, const std::string& path);

/// Resolve the references of one part of the document, in this order, and check the rules about
/// them.
void link_views_and_accessors(LinkedDocument& document);
void link_images_and_textures(LinkedDocument& document);
void link_materials(LinkedDocument& document);
void link_meshes(LinkedDocument& document);
void link_nodes(LinkedDocument& document);
void number_nodes(LinkedDocument& document);
void link_skins(LinkedDocument& document);
void link_animations(LinkedDocument& document);
void link_scenes(LinkedDocument& document);
void report_unused_objects(LinkedDocument& document);

}  // namespace tessera::render
