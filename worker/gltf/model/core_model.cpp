#include "worker/gltf/model/core_model.h"

#include <cmath>
#include <exception>

// Compiled here because Debian's libdraco.so exports a tinygltf of another version, and link
// order would decide which of the two shared libraries a program uses.
#include <nlohmann/json.hpp>
#define TINYGLTF_IMPLEMENTATION
#define TINYGLTF_NO_INCLUDE_JSON
#define TINYGLTF_NO_STB_IMAGE
#define TINYGLTF_NO_STB_IMAGE_WRITE
#define TINYGLTF_NO_EXTERNAL_IMAGE
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpedantic"
#pragma GCC diagnostic ignored "-Wshadow"
#pragma GCC diagnostic ignored "-Wextra"
#pragma GCC diagnostic ignored "-Wunused-function"
#pragma GCC diagnostic ignored "-Wunused-parameter"
#include <tiny_gltf.h>
#pragma GCC diagnostic pop

#include "absl/strings/str_cat.h"
#include "worker/gltf/file/limits.h"
#include "worker/gltf/model/hierarchy.h"

namespace tessera::render {

namespace {

/// Converts a parsed tinygltf model to a GltfModel and checks it. Keeps the first fault of each
/// part and of the whole file.
class Converter {
 public:
  Converter(const tinygltf::Model& parsed, GltfModel& model) : in_(parsed), out_(model) {}

  absl::Status convert() {
    convert_views();
    convert_accessors();
    convert_materials();
    convert_samplers();
    convert_meshes();
    convert_nodes();
    convert_skins();
    convert_animations();
    convert_cameras();
    convert_scenes();
    return status_;
  }

 private:
  void fault(const std::string& element, const std::string& message) {
    const auto status = absl::InvalidArgumentError(absl::StrCat(element, ": ", message));
    if (!out_.faults.add(element, status) && status_.ok()) status_ = status;
  }

  void warn(const std::string& element, const std::string& message) {
    out_.problems.push_back({Problem::Severity::warning, element, message});
  }

  /// Returns `value` if it is kNone or an index below `size`; otherwise reports a fault and returns
  /// kNone.
  std::int32_t index(int value, std::size_t size, const std::string& element) {
    if (value == kNone) return kNone;
    if (value >= 0 && static_cast<std::size_t>(value) < size) return value;
    fault(element, absl::StrCat(value, " is not the index of one of ", size, " elements"));
    return kNone;
  }

  ComponentType component_type(int code, const std::string& element) {
    switch (code) {
      case TINYGLTF_COMPONENT_TYPE_BYTE:
        return ComponentType::i8;
      case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
        return ComponentType::u8;
      case TINYGLTF_COMPONENT_TYPE_SHORT:
        return ComponentType::i16;
      case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
        return ComponentType::u16;
      case TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT:
        return ComponentType::u32;
      case TINYGLTF_COMPONENT_TYPE_FLOAT:
        return ComponentType::f32;
      default:
        fault(element, absl::StrCat("componentType ", code, " is not defined by glTF"));
        return ComponentType::f32;
    }
  }

  void convert_views() {
    for (const auto& v : in_.bufferViews) {
      out_.views.push_back({v.buffer, v.byteOffset, v.byteLength, v.byteStride});
    }
  }

  void convert_accessors() {
    for (std::size_t i = 0; i < in_.accessors.size(); ++i) {
      const auto& a = in_.accessors[i];
      const std::string where = absl::StrCat("accessors[", i, "]");
      Accessor accessor;
      accessor.view = index(a.bufferView, in_.bufferViews.size(), where + ".bufferView");
      accessor.offset = a.byteOffset;
      accessor.type = component_type(a.componentType, where);
      accessor.count = static_cast<std::int64_t>(a.count);
      accessor.normalized = a.normalized;
      const bool matrix = a.type == TINYGLTF_TYPE_MAT2 || a.type == TINYGLTF_TYPE_MAT3 ||
                          a.type == TINYGLTF_TYPE_MAT4;
      const int size = tinygltf::GetNumComponentsInType(static_cast<std::uint32_t>(a.type));
      accessor.columns = !matrix ? 1 : a.type == TINYGLTF_TYPE_MAT2 ? 2 : size == 9 ? 3 : 4;
      accessor.rows = size / accessor.columns;
      if (a.sparse.isSparse) {
        accessor.sparse =
            SparseValues{a.sparse.count,
                         a.sparse.indices.bufferView,
                         a.sparse.values.bufferView,
                         static_cast<std::size_t>(a.sparse.indices.byteOffset),
                         static_cast<std::size_t>(a.sparse.values.byteOffset),
                         component_type(a.sparse.indices.componentType, where + ".sparse.indices")};
      }
      out_.accessors.push_back(accessor);
    }
  }

  template <typename Info>
  TextureRef texture(const Info& info, bool srgb, const std::string& element) {
    TextureRef ref;
    ref.texture = index(info.index, in_.textures.size(), element + ".index");
    ref.uv_set = info.texCoord;
    ref.srgb = srgb;
    return ref;
  }

  Material material(const tinygltf::Material& m, const std::string& where) {
    Material out;
    out.name = m.name;
    const auto& pbr = m.pbrMetallicRoughness;
    const std::string pbr_where = where + ".pbrMetallicRoughness";
    if (pbr.baseColorFactor.size() != 4) {
      fault(pbr_where + ".baseColorFactor", "must be 4 numbers");
    } else {
      for (int k = 0; k < 4; ++k) {
        out.base_color[k] = unit(pbr.baseColorFactor[k], pbr_where + ".baseColorFactor");
      }
    }
    out.base_color_texture = texture(pbr.baseColorTexture, true, pbr_where + ".baseColorTexture");
    out.metallic = unit(pbr.metallicFactor, pbr_where + ".metallicFactor");
    out.roughness = unit(pbr.roughnessFactor, pbr_where + ".roughnessFactor");
    out.metallic_roughness_texture =
        texture(pbr.metallicRoughnessTexture, false, pbr_where + ".metallicRoughnessTexture");
    out.normal_texture = texture(m.normalTexture, false, where + ".normalTexture");
    out.normal_scale = finite(m.normalTexture.scale, where + ".normalTexture.scale");
    for (int k = 0; k < 3; ++k) {
      out.emission[k] = finite(m.emissiveFactor[k], where + ".emissiveFactor");
      if (out.emission[k] < 0) fault(where + ".emissiveFactor", "is negative");
    }
    out.emissive_texture = texture(m.emissiveTexture, true, where + ".emissiveTexture");
    out.alpha_mode = m.alphaMode == "MASK"    ? AlphaMode::mask
                     : m.alphaMode == "BLEND" ? AlphaMode::blend
                                              : AlphaMode::opaque;
    if (out.alpha_mode == AlphaMode::opaque && m.alphaMode != "OPAQUE") {
      fault(where + ".alphaMode", "is not OPAQUE, MASK or BLEND");
    }
    out.alpha_cutoff = finite(m.alphaCutoff, where + ".alphaCutoff");
    out.double_sided = m.doubleSided;
    return out;
  }

  /// A factor that must be in [0, 1]; small deviations by exporters are clamped.
  float unit(double value, const std::string& element) {
    if (!(value >= -1e6 && value <= 1e6)) fault(element, "is not in [0, 1]");
    return static_cast<float>(value < 0 ? 0 : value > 1 ? 1 : value);
  }

  float finite(double value, const std::string& element) {
    const auto narrow = static_cast<float>(value);
    if (!std::isfinite(narrow)) fault(element, absl::StrCat(value, " is too large"));
    return narrow;
  }

  void convert_materials() {
    for (std::size_t i = 0; i < in_.materials.size(); ++i) {
      out_.materials.push_back(material(in_.materials[i], absl::StrCat("materials[", i, "]")));
    }
  }

  Wrap wrap(int code, const std::string& element) {
    if (code == TINYGLTF_TEXTURE_WRAP_CLAMP_TO_EDGE) return Wrap::clamp;
    if (code == TINYGLTF_TEXTURE_WRAP_MIRRORED_REPEAT) return Wrap::mirror;
    if (code != TINYGLTF_TEXTURE_WRAP_REPEAT) {
      fault(element, absl::StrCat("wrap mode ", code, " is not defined by glTF"));
    }
    return Wrap::repeat;
  }

  void convert_samplers() {
    for (std::size_t i = 0; i < in_.samplers.size(); ++i) {
      const auto& s = in_.samplers[i];
      const std::string where = absl::StrCat("samplers[", i, "]");
      Texture sampler;
      sampler.wrap_u = wrap(s.wrapS, where + ".wrapS");
      sampler.wrap_v = wrap(s.wrapT, where + ".wrapT");
      sampler.nearest = s.magFilter == TINYGLTF_TEXTURE_FILTER_NEAREST;
      out_.samplers.push_back(sampler);
    }
  }

  Attributes attributes(const std::map<std::string, int>& from, const std::string& element) {
    Attributes out;
    for (const auto& [name, accessor] : from) {
      const std::string where = absl::StrCat(element, ".", name);
      out[name] = index(accessor, in_.accessors.size(), where);
      if (out[name] == kNone) fault(where, "is negative");
    }
    return out;
  }

  void convert_meshes() {
    for (std::size_t i = 0; i < in_.meshes.size(); ++i) {
      const auto& m = in_.meshes[i];
      GltfMesh mesh{m.name, {}, m.weights};
      for (std::size_t k = 0; k < m.primitives.size(); ++k) {
        const auto& p = m.primitives[k];
        const std::string where = absl::StrCat("meshes[", i, "].primitives[", k, "]");
        GltfPrimitive primitive;
        primitive.attributes = attributes(p.attributes, where + ".attributes");
        primitive.indices = index(p.indices, in_.accessors.size(), where + ".indices");
        primitive.material = index(p.material, in_.materials.size(), where + ".material");
        if (p.mode < 0 || p.mode > 6) {
          fault(where + ".mode", absl::StrCat(p.mode, " is not defined by glTF"));
        } else {
          primitive.mode = static_cast<PrimitiveMode>(p.mode);
        }
        for (std::size_t t = 0; t < p.targets.size(); ++t) {
          primitive.targets.push_back(
              attributes(p.targets[t], absl::StrCat(where, ".targets[", t, "]")));
        }
        mesh.primitives.push_back(std::move(primitive));
      }
      out_.meshes.push_back(std::move(mesh));
    }
  }

  Vec3d vec3(const std::vector<double>& v, Vec3d fallback, const std::string& element) {
    if (v.empty()) return fallback;
    if (v.size() != 3) {
      fault(element, "must be 3 numbers");
      return fallback;
    }
    return {v[0], v[1], v[2]};
  }

  std::optional<Affine3d> matrix(const std::vector<double>& m, const std::string& element) {
    if (m.empty()) return std::nullopt;
    if (m.size() != 16) {
      fault(element, "must be 16 numbers");
      return std::nullopt;
    }
    constexpr double kTolerance = 1e-6;
    if (!(std::fabs(m[3]) + std::fabs(m[7]) + std::fabs(m[11]) <= kTolerance &&
          std::fabs(m[15] - 1) <= kTolerance)) {
      fault(element, "is not affine: its last row is not 0, 0, 0, 1");
    }
    return Affine3d{{Vec3d{m[0], m[4], m[8]}, Vec3d{m[1], m[5], m[9]}, Vec3d{m[2], m[6], m[10]}},
                    {m[12], m[13], m[14]}};
  }

  Node node(const tinygltf::Node& n, const std::string& where) {
    Node out;
    out.name = n.name;
    for (std::size_t k = 0; k < n.children.size(); ++k) {
      const std::string child = absl::StrCat(where, ".children[", k, "]");
      out.children.push_back(index(n.children[k], in_.nodes.size(), child));
    }
    out.mesh = index(n.mesh, in_.meshes.size(), where + ".mesh");
    out.skin = index(n.skin, in_.skins.size(), where + ".skin");
    out.camera = index(n.camera, in_.cameras.size(), where + ".camera");
    out.matrix = matrix(n.matrix, where + ".matrix");
    out.translation = vec3(n.translation, {0, 0, 0}, where + ".translation");
    out.scale = vec3(n.scale, {1, 1, 1}, where + ".scale");
    if (n.rotation.size() == 4) {
      out.rotation = {n.rotation[0], n.rotation[1], n.rotation[2], n.rotation[3]};
    } else if (!n.rotation.empty()) {
      fault(where + ".rotation", "must be 4 numbers");
    }
    out.weights = n.weights;
    return out;
  }

  void convert_nodes() {
    for (std::size_t i = 0; i < in_.nodes.size(); ++i) {
      out_.nodes.push_back(node(in_.nodes[i], absl::StrCat("nodes[", i, "]")));
    }
    if (status_.ok()) status_ = link_parents(out_.nodes);
  }

  void convert_skins() {
    for (std::size_t i = 0; i < in_.skins.size(); ++i) {
      const std::string where = absl::StrCat("skins[", i, "]");
      Skin skin;
      skin.inverse_bind_matrices = index(in_.skins[i].inverseBindMatrices, in_.accessors.size(),
                                         where + ".inverseBindMatrices");
      for (const int joint : in_.skins[i].joints) {
        skin.joints.push_back(index(joint, in_.nodes.size(), where + ".joints"));
      }
      if (skin.joints.empty()) fault(where + ".joints", "is empty");
      out_.skins.push_back(std::move(skin));
    }
  }

  void convert_channel(const tinygltf::Animation& from, std::size_t k, const std::string& where,
                       Animation& animation) {
    const auto& c = from.channels[k];
    if (c.target_path == "pointer") return;  // see animation_pointers.h
    const std::int32_t sampler = index(c.sampler, from.samplers.size(), where + ".sampler");
    AnimationChannel out;
    out.node = index(c.target_node, in_.nodes.size(), where + ".target.node");
    if (sampler == kNone || out.node == kNone)
      return fault(where, "has no sampler or no target node");
    const auto& s = from.samplers[sampler];
    out.input = index(s.input, in_.accessors.size(), where + ".sampler.input");
    out.output = index(s.output, in_.accessors.size(), where + ".sampler.output");
    if (out.input == kNone || out.output == kNone) return fault(where, "has no input or output");
    if (s.interpolation == "STEP") {
      out.interpolation = Interpolation::step;
    } else if (s.interpolation == "CUBICSPLINE") {
      out.interpolation = Interpolation::cubic_spline;
    } else if (s.interpolation != "LINEAR") {
      return fault(where, "interpolation is not STEP, LINEAR or CUBICSPLINE");
    }
    if (c.target_path == "rotation") {
      out.path = AnimationPath::rotation;
    } else if (c.target_path == "scale") {
      out.path = AnimationPath::scale;
    } else if (c.target_path == "weights") {
      out.path = AnimationPath::weights;
    } else if (c.target_path != "translation") {
      return warn(where, "unknown target path; channel ignored");
    }
    animation.channels.push_back(out);
  }

  void convert_animations() {
    for (std::size_t i = 0; i < in_.animations.size(); ++i) {
      Animation animation;
      animation.name = in_.animations[i].name;
      for (std::size_t k = 0; k < in_.animations[i].channels.size(); ++k) {
        const std::string where = absl::StrCat("animations[", i, "].channels[", k, "]");
        convert_channel(in_.animations[i], k, where, animation);
      }
      out_.animations.push_back(std::move(animation));
    }
  }

  void convert_cameras() {
    for (std::size_t i = 0; i < in_.cameras.size(); ++i) {
      const auto& c = in_.cameras[i];
      Camera camera;
      camera.name = c.name;
      if (c.type == "orthographic") {
        camera.kind = Camera::Kind::orthographic;
        camera.ymag = c.orthographic.ymag;
        camera.znear = c.orthographic.znear;
        camera.zfar = c.orthographic.zfar;
      } else if (c.type == "perspective") {
        camera.yfov = c.perspective.yfov;
        camera.znear = c.perspective.znear;
        if (c.perspective.zfar > 0) camera.zfar = c.perspective.zfar;
      } else {
        fault(absl::StrCat("cameras[", i, "].type"), "is not perspective or orthographic");
      }
      out_.cameras.emplace_back().camera = std::move(camera);
    }
  }

  /// Nearest listed ancestor of every node, or kNone.
  [[nodiscard]] std::vector<std::int32_t> containers(const std::vector<bool>& is_listed) const {
    std::vector<std::int32_t> out(out_.nodes.size(), kNone);
    for (const std::int32_t node : parents_first(out_.nodes)) {
      const std::int32_t parent = out_.nodes[node].parent;
      if (parent != kNone) out[node] = is_listed[parent] ? parent : out[parent];
    }
    return out;
  }

  /// The listed nodes without those that another one contains, so that every node is rendered once.
  std::vector<std::int32_t> scene_roots(const std::vector<std::int32_t>& listed,
                                        const std::string& where) {
    std::vector<bool> is_listed(out_.nodes.size()), is_taken(out_.nodes.size());
    for (const std::int32_t node : listed) is_listed[node] = true;
    const std::vector<std::int32_t> container = containers(is_listed);
    std::vector<std::int32_t> roots;
    for (const std::int32_t node : listed) {
      const std::string name = absl::StrCat("nodes[", node, "]");
      const std::int32_t parent = out_.nodes[node].parent;
      if (is_taken[node]) {
        warn(where, absl::StrCat(name, " is listed twice; rendered once"));
      } else if (container[node] != kNone) {
        warn(where, absl::StrCat(name, " is also listed as a descendant of nodes[", container[node],
                                 "]; rendered once"));
      } else {
        if (parent != kNone) {
          warn(where, absl::StrCat(name, " is not a root node; rendered where its parent nodes[",
                                   parent, "] places it"));
        }
        roots.push_back(node);
      }
      is_taken[node] = true;
    }
    return roots;
  }

  void convert_scenes() {
    for (std::size_t i = 0; i < in_.scenes.size(); ++i) {
      const std::string where = absl::StrCat("scenes[", i, "].nodes");
      std::vector<std::int32_t> listed;
      for (const int root : in_.scenes[i].nodes) {
        const std::int32_t node = index(root, in_.nodes.size(), where);
        if (node != kNone) listed.push_back(node);
      }
      GltfScene scene{in_.scenes[i].name, {}};
      if (status_.ok()) scene.roots = scene_roots(listed, where);
      out_.scenes.push_back(std::move(scene));
    }
    out_.default_scene = index(in_.defaultScene, in_.scenes.size(), "scene");
  }

  const tinygltf::Model& in_;
  GltfModel& out_;
  absl::Status status_;
};

/// File access callbacks for tinygltf that read nothing.
tinygltf::FsCallbacks no_files() {
  tinygltf::FsCallbacks fs;
  fs.FileExists = [](const std::string&, void*) { return false; };
  fs.ExpandFilePath = [](const std::string&, void*) { return std::string(); };
  fs.ReadWholeFile = [](std::vector<unsigned char>*, std::string* error, const std::string&,
                        void*) {
    if (error != nullptr) *error = "files are not read here";
    return false;
  };
  fs.WriteWholeFile = [](std::string*, const std::string&, const std::vector<unsigned char>&,
                         void*) { return false; };
  fs.user_data = nullptr;
  return fs;
}

/// Images are read from the JSON and decoded by image_decoder.h.
constexpr auto kNoImages = [](auto...) { return true; };

}  // namespace

absl::Status read_core_model(const std::string& text, GltfModel& model) {
  try {
    tinygltf::TinyGLTF parser;
    parser.SetFsCallbacks(no_files());
    parser.SetImageLoader(kNoImages, nullptr);
    tinygltf::Model parsed_model;
    std::string error, warning;
    const bool parsed = parser.LoadASCIIFromString(&parsed_model, &error, &warning, text.data(),
                                                   static_cast<unsigned int>(text.size()), "");
    if (!parsed) {
      while (!error.empty() && error.back() == '\n') error.pop_back();
      return absl::InvalidArgumentError(absl::StrCat("glTF: ", error));
    }
    return Converter(parsed_model, model).convert();
  } catch (const std::exception& e) {
    return absl::InvalidArgumentError(absl::StrCat("glTF: ", e.what()));
  }
}

}  // namespace tessera::render
