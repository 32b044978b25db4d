#include <algorithm>
#include <cmath>
#include <string>

#include "worker/gltf/validate/findings/rules.h"
#include "worker/gltf/validate/formats/image_header.h"
#include "worker/gltf/validate/formats/uri_rules.h"
#include "worker/gltf/validate/schema/attribute_names.h"
#include "worker/gltf/validate/schema/matrix_rules.h"
#include "worker/gltf/validate/schema/schema_check.h"

namespace tessera::render {

namespace {

using Kind = JsonNode::Kind;
using schema::Type;

/// Where the findings of one object go.
struct Object {
  const JsonNode& json;
  const std::string& path;
  const CheckedDocument& document;
  ValidationFindings& findings;

  void add(const ValidationRule& rule, std::string_view key = "",
           std::string_view detail = "") const {
    key.empty() ? findings.add(rule, path, detail) : findings.add_at(rule, path, key, detail);
  }
};

void check_asset(const Object& object) {
  const std::string& version = object.json.text_of("version");
  const std::string& minimum = object.json.text_of("minVersion");
  if (version.empty() || minimum.empty()) return;
  const auto part = [](const std::string& text, bool major) {
    const std::size_t dot = text.find('.');
    return std::strtod((major ? text.substr(0, dot) : text.substr(dot + 1)).c_str(), nullptr);
  };
  const double majors[] = {part(minimum, true), part(version, true)};
  const bool is_above = majors[0] > majors[1] ||
                        (majors[0] == majors[1] && part(minimum, false) > part(version, false));
  if (is_above) object.add(rules::kAssetMinVersionGreaterThanVersion, "minVersion", minimum);
}

void check_accessor(const Object& object) {
  const JsonNode& json = object.json;
  if (json.integer("bufferView") == -1 && json.has("byteOffset")) {
    object.add(rules::kUnsatisfiedDependency, "byteOffset", "bufferView");
  }
  const std::int64_t component_type = json.integer("componentType");
  const bool is_wide = component_type == 5125 || component_type == 5126;
  if (is_wide && json["normalized"].is_true()) {
    object.add(rules::kAccessorNormalizedInvalid, "normalized");
  }
  const std::int64_t offset = json.integer("byteOffset", 0);
  if (json.text_of("type").substr(0, 3) == "MAT" && offset > 0 && offset % 4 != 0) {
    object.add(rules::kAccessorMatrixAlignment, "byteOffset");
  }
}

void check_buffer_view(const Object& object) {
  const std::int64_t stride = object.json.integer("byteStride");
  const std::int64_t length = object.json.integer("byteLength");
  if (stride == -1) return;
  if (length != -1 && stride > length) {
    object.add(rules::kBufferViewTooBigByteStride, "byteStride");
  }
  if (stride % 4 != 0) object.add(rules::kValueMultipleOf, "byteStride", "of 4");
  if (object.json.integer("target") == 34963) {
    object.add(rules::kBufferViewInvalidByteStride, "byteStride");
  }
}

/// Checks a URI. Returns whether it is a data URI that can be decoded.
bool check_uri(const Object& object, const std::string& uri) {
  if (object.document.is_glb) object.add(rules::kUriGlb, "uri");
  if (is_valid_data_uri(uri)) {
    if (object.document.is_glb) object.add(rules::kDataUriGlb, "uri");
    return true;
  }
  const UriForm form = form_of_uri(uri);
  if (form == UriForm::invalid) object.add(rules::kInvalidUri, "uri", uri);
  if (form == UriForm::other) object.add(rules::kNonRelativeUri, "uri", uri);
  return false;
}

void check_buffer(const Object& object) {
  const JsonNode& uri = object.json["uri"];
  if (!uri.is(Kind::text) || !check_uri(object, uri.text())) return;
  const std::string type = media_type_of(uri.text());
  if (type != "application/gltf-buffer" && type != "application/octet-stream") {
    object.add(rules::kBufferDataUriMimeTypeInvalid, "uri", type);
  }
}

void check_image(const Object& object) {
  const JsonNode& uri = object.json["uri"];
  const bool has_view = object.json.integer("bufferView") != -1;
  if (has_view && !object.json["mimeType"].is(Kind::text)) {
    object.add(rules::kUnsatisfiedDependency, "bufferView", "mimeType");
  }
  if (has_view == uri.is(Kind::text)) {
    object.add(rules::kOneOfMismatch, "", "bufferView or uri");
  }
  if (!uri.is(Kind::text) || !check_uri(object, uri.text())) return;
  if (!image_data_of(uri.text())) {
    object.add(rules::kInvalidUri, "uri", "the data are not of the declared media type");
  }
}

void check_camera(const Object& object) {
  if (object.json.has("orthographic") && object.json.has("perspective")) {
    object.add(rules::kOneOfMismatch, "", "orthographic or perspective");
  }
}

void check_depth_range(const Object& object) {
  if (object.json.number_or("zfar", schema::kInfinity) <=
      object.json.number_or("znear", -schema::kInfinity)) {
    object.add(rules::kCameraZfarLequalZnear);
  }
}

void check_orthographic(const Object& object) {
  for (const char* key : {"xmag", "ymag"}) {
    const double magnification = object.json.number_or(key, 1);
    if (magnification == 0) object.add(rules::kCameraXmagYmagZero, key);
    if (magnification < 0) object.add(rules::kCameraXmagYmagNegative, key);
  }
  check_depth_range(object);
}

void check_perspective(const Object& object) {
  constexpr double kPi = 3.141592653589793;
  if (object.json.number_or("yfov", 0) >= kPi) object.add(rules::kCameraYfovGequalPi);
  check_depth_range(object);
}

void check_material(const Object& object) {
  const JsonNode& mode = object.json["alphaMode"];
  if (mode.text() != "MASK" && object.json.has("alphaCutoff")) {
    object.add(rules::kMaterialAlphaCutoffInvalidMode, "alphaCutoff");
  }
}

/// Number of morph targets of a primitive.
std::size_t target_count(const JsonNode& primitive) {
  return primitive["targets"].size();
}

void check_mesh(const Object& object) {
  const JsonNode& primitives = object.json["primitives"];
  if (!primitives.is(Kind::array)) return;
  const std::size_t expected = target_count(primitives.items()[0]);
  const std::string path = pointer_to(object.path, "primitives");
  for (std::size_t i = 1; i < primitives.size(); ++i) {
    const std::size_t count = target_count(primitives.items()[i]);
    if (count == expected) continue;
    const std::string primitive = pointer_to(path, i);
    object.findings.add(rules::kMeshPrimitivesUnequalTargetsCount,
                        count > 0 ? pointer_to(primitive, "targets") : primitive);
  }
  const JsonNode& weights = object.json["weights"];
  if (weights.is(Kind::array) && weights.size() != expected) {
    object.add(rules::kMeshInvalidWeightsCount, "weights");
  }
}

void check_primitive(const Object& object) {
  const JsonNode& attributes = object.json["attributes"];
  if (!attributes.is(Kind::object)) return;
  const std::string path = pointer_to(object.path, "attributes");
  if (!attributes.has("POSITION")) object.findings.add(rules::kMeshPrimitiveNoPosition, path);
  if (attributes.has("TANGENT") && !attributes.has("NORMAL")) {
    object.findings.add_at(rules::kMeshPrimitiveTangentWithoutNormal, path, "TANGENT");
  }
  int joints = 0, weights = 0;
  for (const char* semantic : {"COLOR", "JOINTS", "WEIGHTS", "TEXCOORD"}) {
    const int sets = numbered_sets(attributes, semantic);
    if (sets < 0) {
      object.findings.add(rules::kMeshPrimitiveIndexedSemanticContinuity, path, semantic);
    }
    if (semantic[0] == 'J') joints = std::max(sets, 0);
    if (semantic[0] == 'W') weights = std::max(sets, 0);
  }
  if (joints != weights) object.findings.add(rules::kMeshPrimitiveJointsWeightsMismatch, path);
}

void check_node(const Object& object) {
  const JsonNode& json = object.json;
  if (json.integer("mesh") == -1) {
    if (json.integer("skin") != -1) object.add(rules::kUnsatisfiedDependency, "skin", "mesh");
    if (json["weights"].is(Kind::array)) {
      object.add(rules::kUnsatisfiedDependency, "weights", "mesh");
    }
  }
  if (json["rotation"].is(Kind::array) && !is_unit_quaternion(json["rotation"])) {
    object.add(rules::kRotationNonUnit, "rotation");
  }
  if (!json["matrix"].is(Kind::array)) return;
  const bool has_parts = json["translation"].is(Kind::array) || json["rotation"].is(Kind::array) ||
                         json["scale"].is(Kind::array);
  if (has_parts) object.add(rules::kNodeMatrixTrs, "matrix");
  if (is_identity_matrix(json["matrix"])) {
    object.add(rules::kNodeMatrixDefault, "matrix");
  } else if (!is_decomposable_matrix(json["matrix"])) {
    object.add(rules::kNodeMatrixNonTrs, "matrix");
  }
}

void check_light(const Object& object) {
  const std::string& type = object.json.text_of("type");
  if (type != "spot" && object.json.has("spot")) object.add(rules::kExtraProperty, "spot");
  if (type == "directional" && object.json["range"].is(Kind::number)) {
    object.add(rules::kExtraProperty, "range");
  }
}

void check_spot(const Object& object) {
  const auto angle = [&object](const char* key, double fallback) {
    return object.json[key].is(Kind::faulty) ? NAN : object.json.number_or(key, fallback);
  };
  constexpr double kQuarterPi = 0.7853981633974483;
  if (angle("outerConeAngle", kQuarterPi) <= angle("innerConeAngle", 0)) {
    object.add(rules::kKhrLightsPunctualLightSpotAngles, "outerConeAngle");
  }
}

void check_iridescence(const Object& object) {
  const JsonNode& minimum = object.json["iridescenceThicknessMinimum"];
  if (!object.json["iridescenceThicknessTexture"].is(Kind::object)) {
    if (minimum.is(Kind::number)) {
      object.add(rules::kKhrMaterialsIridescenceThicknessRangeWithoutTexture,
                 "iridescenceThicknessMinimum");
    }
    return;
  }
  const JsonNode& maximum = object.json["iridescenceThicknessMaximum"];
  const bool usable = !minimum.is(Kind::faulty) && !maximum.is(Kind::faulty);
  constexpr double kMinimum = 100, kMaximum = 400;  // defaults, nm
  if (usable && object.json.number_or("iridescenceThicknessMinimum", kMinimum) ==
                    object.json.number_or("iridescenceThicknessMaximum", kMaximum)) {
    object.add(rules::kKhrMaterialsIridescenceThicknessTextureUnused,
               "iridescenceThicknessTexture");
  }
}

}  // namespace

void check_object_rules(Type type, const JsonNode& object_json, const std::string& path,
                        const CheckedDocument& document, ValidationFindings& findings) {
  const Object object{object_json, path, document, findings};
  switch (type) {
    case Type::asset:
      return check_asset(object);
    case Type::accessor:
      return check_accessor(object);
    case Type::buffer_view:
      return check_buffer_view(object);
    case Type::buffer:
      return check_buffer(object);
    case Type::image:
      return check_image(object);
    case Type::camera:
      return check_camera(object);
    case Type::orthographic:
      return check_orthographic(object);
    case Type::perspective:
      return check_perspective(object);
    case Type::material:
      return check_material(object);
    case Type::mesh:
      return check_mesh(object);
    case Type::primitive:
      return check_primitive(object);
    case Type::node:
      return check_node(object);
    case Type::light:
      return check_light(object);
    case Type::spot:
      return check_spot(object);
    case Type::iridescence:
      return check_iridescence(object);
    default:
      return;
  }
}

}  // namespace tessera::render
