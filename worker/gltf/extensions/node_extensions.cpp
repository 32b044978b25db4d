#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "worker/gltf/extensions/extension_reader.h"
#include "worker/gltf/extensions/shape_reader.h"
#include "worker/gltf/file/json_view.h"
#include "worker/math/elementary.h"

namespace tessera::render {

namespace {

constexpr double kHalfPi = 1.57079632679489661923;

PunctualLight read_light(const JsonView& light, JsonFault& fault) {
  PunctualLight out;
  out.name = light.text("name");
  const std::string type = light.text("type");
  const Vec3f color = light.vec3("color", {1, 1, 1});
  out.intensity = color * static_cast<float>(light.number("intensity", 1, 0, 1e30));
  if (light["range"].present()) {
    out.range = static_cast<float>(light.number("range", 1, 0, 1e18));
    if (!(out.range > 0)) fault.report(light.path() + ".range", "must be above 0");
  }
  if (type == "directional") {
    out.kind = PunctualLight::Kind::directional;
  } else if (type == "spot") {
    out.kind = PunctualLight::Kind::spot;
    const JsonView spot = light["spot"];
    const double inner = spot.number("innerConeAngle", 0, 0, kHalfPi);
    const double outer = spot.number("outerConeAngle", kHalfPi / 2, 0, kHalfPi);
    // Equal angles describe a spot without a soft edge.
    if (!(inner <= outer && outer > 0)) {
      fault.report(light.path() + ".spot",
                   "requires 0 <= innerConeAngle <= outerConeAngle and outerConeAngle > 0");
    }
    out.cos_inner = static_cast<float>(elementary::cos(inner));
    out.cos_outer = static_cast<float>(elementary::cos(outer));
  } else if (type != "point") {
    fault.report(light.path() + ".type", "is not directional, point or spot");
  }
  if (!is_finite(out.intensity) || out.intensity.x < 0 || out.intensity.y < 0 ||
      out.intensity.z < 0) {
    fault.report(light.path() + ".color", "is negative or too large");
  }
  return out;
}

/// An extension that gives a node a shape.
struct ShapeExtension {
  const char* name;
  std::shared_ptr<const Shape> (*read)(const JsonView&, JsonFault&);
};

constexpr ShapeExtension kShapeExtensions[] = {{"TESSERA_shape", read_shape},
                                               {"TESSERA_blobs", read_blobs},
                                               {"TESSERA_terrain", read_terrain}};

void read_node(const JsonView& object, Node& node, const GltfModel& model, JsonFault& fault) {
  std::string surface = node.mesh != kNone ? "mesh" : "";  // how the node already got one
  for (const ShapeExtension& kind : kShapeExtensions) {
    const JsonView shape = object.extension(kind.name);
    if (!shape.present()) continue;
    if (!surface.empty()) fault.report(shape.path(), "the node already has a " + surface);
    surface = kind.name;
    node.shape = kind.read(shape, fault);
    node.shape_material = shape.index("material", model.materials.size());
  }
  node.csg = read_csg(object.extension("TESSERA_csg"), fault);
  if (node.csg && !surface.empty()) {
    fault.report(object.path(), "a node with TESSERA_csg cannot have a mesh or shape");
  }
  node.light = object.extension("KHR_lights_punctual").index("light", model.lights.size());
  node.visible = object.extension("KHR_node_visibility").boolean("visible", true);
  const JsonView attributes = object.extension("EXT_mesh_gpu_instancing")["attributes"];
  for (const std::string& name : attributes.keys()) {
    node.instancing[name] = attributes.index(name, model.accessors.size());
  }
  std::int64_t count = -1;
  for (const auto& [name, accessor] : node.instancing) {
    if (accessor == kNone) return;
    if (count != -1 && model.accessors[accessor].count != count) {
      fault.report(attributes.path(), "the accessors differ in count");
    }
    count = model.accessors[accessor].count;
  }
}

void read_mappings(const JsonView& object, GltfPrimitive& primitive, const GltfModel& model) {
  for (const JsonView& item : object.extension("KHR_materials_variants")["mappings"].items()) {
    VariantMapping mapping;
    mapping.material = item.index("material", model.materials.size());
    for (const JsonView& variant : item["variants"].items()) {
      mapping.variants.push_back(variant.as_index(model.variants.size()));
    }
    primitive.mappings.push_back(std::move(mapping));
  }
}

}  // namespace

absl::Status read_node_extensions(const nlohmann::json& root, GltfModel& model) {
  JsonFault fault(model.faults);
  const JsonView view(root, "", fault);
  for (const JsonView& light : view.extension("KHR_lights_punctual")["lights"].items()) {
    model.lights.push_back(read_light(light, fault));
  }
  for (const JsonView& v : view.extension("KHR_materials_variants")["variants"].items()) {
    model.variants.push_back(v.text("name"));
  }
  const std::vector<JsonView> nodes = view["nodes"].items();
  for (std::size_t i = 0; i < nodes.size() && i < model.nodes.size(); ++i) {
    if (nodes[i]["extensions"].present()) {
      read_node(nodes[i], model.nodes[i], model, fault);
    }
  }
  const std::vector<JsonView> meshes = view["meshes"].items();
  for (std::size_t i = 0; i < meshes.size() && i < model.meshes.size(); ++i) {
    const std::vector<JsonView> primitives = meshes[i]["primitives"].items();
    auto& sources = model.meshes[i].primitives;
    for (std::size_t k = 0; k < primitives.size() && k < sources.size(); ++k) {
      read_mappings(primitives[k], sources[k], model);
    }
  }
  return fault.status();
}

}  // namespace tessera::render
