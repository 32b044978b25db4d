#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "worker/gltf/file/part_faults.h"
#include "worker/gltf/file/resource_reader.h"
#include "worker/math/transform.h"
#include "worker/math/vector.h"
#include "worker/scene/problem.h"
#include "worker/scene/scene.h"

namespace tessera::render {

/// A glTF file as plain data with every index checked: the result of preprocessing and tinygltf,
/// and the input of posing. It contains no third-party type, unresolved URI or compressed data.

enum class ComponentType : std::uint8_t { i8, u8, i16, u16, u32, f32 };

/// Size of one component, bytes.
int component_bytes(ComponentType type);

struct BufferView {
  std::int32_t buffer = kNone;
  std::size_t offset = 0, length = 0;
  std::size_t stride = 0;  // 0: tightly packed
};

struct SparseValues {
  std::int64_t count = 0;
  std::int32_t index_view = kNone, value_view = kNone;
  std::size_t index_offset = 0, value_offset = 0;
  ComponentType index_type = ComponentType::u32;
};

struct Accessor {
  std::int32_t view = kNone;  // kNone: zeros, overlaid by the sparse values
  std::size_t offset = 0;
  ComponentType type = ComponentType::f32;
  int rows = 1, columns = 1;  // VECn is n x 1, MATn n x n
  std::int64_t count = 0;
  bool normalized = false;
  std::optional<SparseValues> sparse;

  [[nodiscard]] int components() const { return rows * columns; }
};

using Attributes = std::map<std::string, std::int32_t>;  // semantic -> accessor

enum class PrimitiveMode : std::uint8_t {
  points,
  lines,
  line_loop,
  line_strip,
  triangles,
  strip,
  fan
};

/// lookAt of TESSERA_camera, in the space of the camera's node.
struct LookAt {
  Vec3d position, target, up = {0, 1, 0};
};

struct GltfCamera {
  Camera camera;  // camera_to_world, lens radius and focus distance are unset
  std::optional<LookAt> look_at;
  double f_number = 0;           // 0: pinhole
  double sensor_height = 0.024;  // metres
  std::int32_t focus_node = kNone;
};

/// Material of a primitive under some variants of KHR_materials_variants.
struct VariantMapping {
  std::int32_t material = kNone;
  std::vector<std::int32_t> variants;
};

struct GltfPrimitive {
  Attributes attributes;
  std::int32_t indices = kNone, material = kNone;
  PrimitiveMode mode = PrimitiveMode::triangles;
  std::vector<Attributes> targets;
  std::vector<VariantMapping> mappings;
};

struct GltfMesh {
  std::string name;
  std::vector<GltfPrimitive> primitives;
  std::vector<double> weights;
};

struct Node {
  std::string name;
  std::vector<std::int32_t> children;
  std::int32_t parent = kNone;
  std::int32_t mesh = kNone, skin = kNone, camera = kNone, light = kNone;
  bool visible = true;             // KHR_node_visibility
  std::optional<Affine3d> matrix;  // otherwise translation * rotation * scale
  Vec3d translation, scale = {1, 1, 1};
  Vec4d rotation = {0, 0, 0, 1};  // unit quaternion, w last
  std::vector<double> weights;
  Attributes instancing;               // EXT_mesh_gpu_instancing; empty: not instanced
  std::shared_ptr<const Shape> shape;  // TESSERA_shape, _blobs or _terrain, instead of a mesh
  std::int32_t shape_material = kNone;
  std::optional<CsgOperation> csg;  // TESSERA_csg: operation on the children
};

struct GltfImage {
  std::string name;                  // shown in messages: URI, name or "images[i]"
  std::string uri;                   // of a file; empty: buffer view or data URI
  std::span<const std::byte> bytes;  // read only for images that a material uses
  /// Whether a material uses it.
  bool needed = false;
};

/// A glTF texture with its image chosen from source, EXT_texture_webp and KHR_texture_basisu.
struct GltfTexture {
  std::int32_t image = kNone;
  std::int32_t sampler = kNone;
  std::int32_t procedural = kNone;  // TESSERA_texture
  bool basisu_only = false;         // only a KTX2 image, which is not supported
};

struct Skin {
  std::vector<std::int32_t> joints;
  std::int32_t inverse_bind_matrices = kNone;
};

enum class Interpolation : std::uint8_t { linear, step, cubic_spline };
enum class AnimationPath : std::uint8_t { translation, rotation, scale, weights };

struct AnimationChannel {
  std::int32_t node = kNone;
  AnimationPath path = AnimationPath::translation;
  std::int32_t input = kNone, output = kNone;  // accessors
  Interpolation interpolation = Interpolation::linear;
};

/// KHR_animation_pointer: animates numbers of the file named by a JSON pointer.
struct PointerChannel {
  std::string pointer;
  int width = 1;         // how many numbers it animates
  bool flat = false;     // numbers are separate scalars in the output, not one element
  bool boolean = false;  // 0 is false, anything else true
  std::int32_t input = kNone, output = kNone;  // accessors
  Interpolation interpolation = Interpolation::linear;
  std::size_t index = 0;  // index of the channel in the file
};

struct Animation {
  std::string name;
  std::vector<AnimationChannel> channels;
  std::vector<PointerChannel> pointers;
};

struct GltfScene {
  std::string name;
  std::vector<std::int32_t> roots;
  std::optional<Atmosphere> atmosphere = {};  // TESSERA_medium
};

/// A whole file.
struct GltfModel {
  std::deque<std::vector<std::byte>> owned;         // decoded data URIs and decompressed buffers
  std::vector<std::span<const std::byte>> buffers;  // into `owned` or the reader's memory
  std::vector<BufferView> views;
  std::vector<Accessor> accessors;
  std::vector<GltfImage> images;
  std::vector<GltfTexture> texture_sources;
  std::vector<ProceduralTexture> procedural_textures;
  std::vector<Texture> samplers;    // `image` unset
  std::vector<Material> materials;  // TextureRef::texture is an index into texture_sources
  std::vector<GltfMesh> meshes;
  std::vector<Node> nodes;
  std::vector<Skin> skins;
  std::vector<Animation> animations;
  std::vector<GltfCamera> cameras;
  std::vector<PunctualLight> lights;  // node, position and direction are unset
  std::vector<GltfScene> scenes;
  std::int32_t default_scene = kNone;
  std::vector<std::string> variants;
  std::vector<std::string> extensions_used, extensions_required;
  std::vector<std::string> resources;  // URIs of the files it refers to
  std::vector<Problem> problems;
  PartFaults faults;  // a faulty part has values that are safe to read but wrong
};

}  // namespace tessera::render
