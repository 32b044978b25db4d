#include "worker/gltf/validate/schema/schema_table.h"

#include <algorithm>

namespace tessera::render::schema {

namespace {

using Text = std::string_view;

constexpr Member index(Text name) {
  return {.name = name, .form = Form::index};
}
constexpr Member integer(Text name, double low, double high = kInfinity) {
  return {.name = name, .low = low, .high = high, .form = Form::integer};
}
constexpr Member code(Text name, std::span<const int> codes) {
  return {.name = name, .codes = codes, .form = Form::code};
}
constexpr Member number(Text name, double low = -kInfinity, double high = kInfinity) {
  return {.name = name, .low = low, .high = high, .form = Form::number};
}
constexpr Member above(Text name, double low, double high = kInfinity) {
  return {.name = name, .low = low, .high = high, .form = Form::number, .low_open = true};
}
constexpr Member flag(Text name) {
  return {.name = name, .form = Form::boolean};
}
constexpr Member text(Text name, Pattern pattern = Pattern::none) {
  return {.name = name, .form = Form::text, .pattern = pattern};
}
constexpr Member word(Text name, std::span<const Text> words) {
  return {.name = name, .words = words, .form = Form::text};
}
constexpr Member numbers(Text name, std::size_t length, double low = -kInfinity,
                         double high = kInfinity) {
  return {.name = name, .low = low, .high = high, .length = length, .form = Form::numbers};
}
constexpr Member bounds(Text name) {
  return {.name = name, .form = Form::bounds};
}
constexpr Member indices(Text name) {
  return {.name = name, .form = Form::indices};
}
constexpr Member names(Text name) {
  return {.name = name, .form = Form::names};
}
constexpr Member object(Text name, Type type) {
  return {.name = name, .form = Form::object, .type = type};
}
constexpr Member objects(Text name, Type type) {
  return {.name = name, .form = Form::objects, .type = type};
}
constexpr Member collection(Text name, Type type) {
  return {.name = name, .form = Form::collection, .type = type};
}
constexpr Member required(Member member) {
  member.required = true;
  return member;
}
/// A required object that exists only for the type of its name.
constexpr Member by_type(Member member) {
  member.by_type = member.required = true;
  return member;
}
constexpr Member with_extension(Member member, Text extension, Text extra) {
  member.word_extension = extension;
  member.extension_word = extra;
  return member;
}

constexpr int kComponentTypes[] = {5120, 5121, 5122, 5123, 5125, 5126};
constexpr int kIndexTypes[] = {5121, 5123, 5125};
constexpr int kTargets[] = {34962, 34963};
constexpr int kMagFilters[] = {9728, 9729};
constexpr int kMinFilters[] = {9728, 9729, 9984, 9985, 9986, 9987};
constexpr int kWraps[] = {33071, 33648, 10497};
constexpr Text kAccessorTypes[] = {"SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"};
constexpr Text kInterpolations[] = {"LINEAR", "STEP", "CUBICSPLINE"};
constexpr Text kPaths[] = {"translation", "rotation", "scale", "weights"};
constexpr Text kCameraTypes[] = {"orthographic", "perspective"};
constexpr Text kImageTypes[] = {"image/jpeg", "image/png"};
constexpr Text kAlphaModes[] = {"OPAQUE", "MASK", "BLEND"};
constexpr Text kLightTypes[] = {"directional", "point", "spot"};
constexpr double kHalfPi = 1.5707963267948966;

constexpr Member kRoot[] = {names("extensionsUsed"),
                            names("extensionsRequired"),
                            object("asset", Type::asset),
                            collection("accessors", Type::accessor),
                            collection("animations", Type::animation),
                            collection("buffers", Type::buffer),
                            collection("bufferViews", Type::buffer_view),
                            collection("cameras", Type::camera),
                            collection("images", Type::image),
                            collection("materials", Type::material),
                            collection("meshes", Type::mesh),
                            collection("nodes", Type::node),
                            collection("samplers", Type::sampler),
                            collection("scenes", Type::scene),
                            index("scene"),
                            collection("skins", Type::skin),
                            collection("textures", Type::texture)};
constexpr Member kAsset[] = {text("copyright"), text("generator"),
                             required(text("version", Pattern::version)),
                             text("minVersion", Pattern::version)};
constexpr Member kAccessor[] = {index("bufferView"),
                                integer("byteOffset", 0),
                                required(code("componentType", kComponentTypes)),
                                required(integer("count", 1)),
                                required(word("type", kAccessorTypes)),
                                flag("normalized"),
                                bounds("max"),
                                bounds("min"),
                                object("sparse", Type::sparse),
                                text("name")};
constexpr Member kSparse[] = {required(integer("count", 1)),
                              required(object("indices", Type::sparse_indices)),
                              required(object("values", Type::sparse_values))};
constexpr Member kSparseIndices[] = {required(index("bufferView")), integer("byteOffset", 0),
                                     required(code("componentType", kIndexTypes))};
constexpr Member kSparseValues[] = {required(index("bufferView")), integer("byteOffset", 0)};
constexpr Member kAnimation[] = {required(objects("channels", Type::channel)),
                                 required(objects("samplers", Type::animation_sampler)),
                                 text("name")};
constexpr Member kChannel[] = {required(index("sampler")),
                               required(object("target", Type::channel_target))};
constexpr Member kChannelTarget[] = {
    index("node"),
    required(with_extension(word("path", kPaths), "KHR_animation_pointer", "pointer"))};
constexpr Member kAnimationSampler[] = {
    required(index("input")), word("interpolation", kInterpolations), required(index("output"))};
constexpr Member kBuffer[] = {text("uri"), required(integer("byteLength", 1)), text("name")};
constexpr Member kBufferView[] = {required(index("buffer")),          integer("byteOffset", 0),
                                  required(integer("byteLength", 1)), integer("byteStride", 4, 252),
                                  code("target", kTargets),           text("name")};
constexpr Member kCamera[] = {required(word("type", kCameraTypes)),
                              by_type(object("orthographic", Type::orthographic)),
                              by_type(object("perspective", Type::perspective)), text("name")};
constexpr Member kOrthographic[] = {required(number("xmag")), required(number("ymag")),
                                    required(above("zfar", 0)), required(number("znear", 0))};
constexpr Member kPerspective[] = {above("aspectRatio", 0), required(above("yfov", 0)),
                                   above("zfar", 0), required(above("znear", 0))};
constexpr Member kImage[] = {
    text("uri"), with_extension(word("mimeType", kImageTypes), "EXT_texture_webp", "image/webp"),
    index("bufferView"), text("name")};
constexpr Member kMaterial[] = {object("pbrMetallicRoughness", Type::metallic_roughness),
                                object("normalTexture", Type::normal_texture),
                                object("occlusionTexture", Type::occlusion_texture),
                                object("emissiveTexture", Type::texture_info),
                                numbers("emissiveFactor", 3, 0, 1),
                                word("alphaMode", kAlphaModes),
                                number("alphaCutoff", 0),
                                flag("doubleSided"),
                                text("name")};
constexpr Member kMetallicRoughness[] = {
    numbers("baseColorFactor", 4, 0, 1), object("baseColorTexture", Type::texture_info),
    number("metallicFactor", 0, 1), number("roughnessFactor", 0, 1),
    object("metallicRoughnessTexture", Type::texture_info)};
constexpr Member kTextureInfo[] = {required(index("index")), integer("texCoord", 0)};
constexpr Member kNormalTexture[] = {required(index("index")), integer("texCoord", 0),
                                     number("scale")};
constexpr Member kOcclusionTexture[] = {required(index("index")), integer("texCoord", 0),
                                        number("strength", 0, 1)};
constexpr Member kMesh[] = {required(objects("primitives", Type::primitive)), numbers("weights", 0),
                            text("name")};
constexpr Member kPrimitive[] = {required({.name = "attributes", .form = Form::attributes}),
                                 index("indices"),
                                 index("material"),
                                 integer("mode", 0, 6),
                                 {.name = "targets", .form = Form::targets}};
constexpr Member kNode[] = {index("camera"),       indices("children"),
                            index("skin"),         numbers("matrix", 16),
                            index("mesh"),         numbers("rotation", 4, -1, 1),
                            numbers("scale", 3),   numbers("translation", 3),
                            numbers("weights", 0), text("name")};
constexpr Member kSampler[] = {code("magFilter", kMagFilters), code("minFilter", kMinFilters),
                               code("wrapS", kWraps), code("wrapT", kWraps), text("name")};
constexpr Member kScene[] = {indices("nodes"), text("name")};
constexpr Member kSkin[] = {index("inverseBindMatrices"), index("skeleton"),
                            required(indices("joints")), text("name")};
constexpr Member kTexture[] = {index("sampler"), index("source"), text("name")};

constexpr Member kWebp[] = {index("source")};
constexpr Member kAnimationPointer[] = {required(text("pointer", Pattern::pointer))};
constexpr Member kLights[] = {required(objects("lights", Type::light))};
constexpr Member kLight[] = {numbers("color", 3, 0, 1),
                             number("intensity", 0),
                             by_type(object("spot", Type::spot)),
                             required(word("type", kLightTypes)),
                             above("range", 0),
                             text("name")};
constexpr Member kSpot[] = {
    {.name = "innerConeAngle", .low = 0, .high = kHalfPi, .form = Form::number, .high_open = true},
    above("outerConeAngle", 0, kHalfPi)};
constexpr Member kNodeLight[] = {required(index("light"))};
constexpr Member kAnisotropy[] = {number("anisotropyStrength", 0, 1), number("anisotropyRotation"),
                                  object("anisotropyTexture", Type::texture_info)};
constexpr Member kClearcoat[] = {number("clearcoatFactor", 0, 1),
                                 object("clearcoatTexture", Type::texture_info),
                                 number("clearcoatRoughnessFactor", 0, 1),
                                 object("clearcoatRoughnessTexture", Type::texture_info),
                                 object("clearcoatNormalTexture", Type::normal_texture)};
constexpr Member kDispersion[] = {number("dispersion", 0)};
constexpr Member kEmissiveStrength[] = {number("emissiveStrength", 0)};
constexpr Member kIor[] = {{.name = "ior", .low = 1, .also = 0, .form = Form::number}};
constexpr Member kIridescence[] = {number("iridescenceFactor", 0, 1),
                                   object("iridescenceTexture", Type::texture_info),
                                   number("iridescenceIor", 1),
                                   number("iridescenceThicknessMinimum", 0),
                                   number("iridescenceThicknessMaximum", 0),
                                   object("iridescenceThicknessTexture", Type::texture_info)};
constexpr Member kSpecularGlossiness[] = {
    numbers("diffuseFactor", 4, 0, 1), object("diffuseTexture", Type::texture_info),
    numbers("specularFactor", 3, 0, 1), number("glossinessFactor", 0, 1),
    object("specularGlossinessTexture", Type::texture_info)};
constexpr Member kSheen[] = {
    numbers("sheenColorFactor", 3, 0, 1), object("sheenColorTexture", Type::texture_info),
    number("sheenRoughnessFactor", 0, 1), object("sheenRoughnessTexture", Type::texture_info)};
constexpr Member kSpecular[] = {
    number("specularFactor", 0, 1), object("specularTexture", Type::texture_info),
    numbers("specularColorFactor", 3, 0), object("specularColorTexture", Type::texture_info)};
constexpr Member kTransmission[] = {number("transmissionFactor", 0, 1),
                                    object("transmissionTexture", Type::texture_info)};
constexpr Member kVariants[] = {required(objects("variants", Type::variant))};
constexpr Member kVariant[] = {required(text("name"))};
constexpr Member kVariantMappings[] = {required(objects("mappings", Type::variant_mapping))};
constexpr Member kVariantMapping[] = {required(indices("variants")), required(index("material")),
                                      text("name")};
constexpr Member kVolume[] = {numbers("attenuationColor", 3, 0, 1), above("attenuationDistance", 0),
                              number("thicknessFactor", 0),
                              object("thicknessTexture", Type::texture_info)};
constexpr Member kTextureTransform[] = {numbers("offset", 2), number("rotation"),
                                        numbers("scale", 2), integer("texCoord", 0)};

constexpr ExtensionObject kExtensionObjects[] = {
    {"EXT_texture_webp", Type::texture, Type::webp},
    {"KHR_animation_pointer", Type::channel_target, Type::animation_pointer},
    {"KHR_lights_punctual", Type::root, Type::lights},
    {"KHR_lights_punctual", Type::node, Type::node_light},
    {"KHR_materials_anisotropy", Type::material, Type::anisotropy},
    {"KHR_materials_clearcoat", Type::material, Type::clearcoat},
    {"KHR_materials_dispersion", Type::material, Type::dispersion},
    {"KHR_materials_emissive_strength", Type::material, Type::emissive_strength},
    {"KHR_materials_ior", Type::material, Type::ior},
    {"KHR_materials_iridescence", Type::material, Type::iridescence},
    {"KHR_materials_pbrSpecularGlossiness", Type::material, Type::specular_glossiness, true},
    {"KHR_materials_sheen", Type::material, Type::sheen},
    {"KHR_materials_specular", Type::material, Type::specular},
    {"KHR_materials_transmission", Type::material, Type::transmission},
    {"KHR_materials_unlit", Type::material, Type::unlit, true},
    {"KHR_materials_variants", Type::root, Type::variants},
    {"KHR_materials_variants", Type::primitive, Type::variant_mappings},
    {"KHR_materials_volume", Type::material, Type::volume},
    {"KHR_texture_transform", Type::texture_info, Type::texture_transform},
    {"KHR_texture_transform", Type::normal_texture, Type::texture_transform},
    {"KHR_texture_transform", Type::occlusion_texture, Type::texture_transform},
};

constexpr Text kMeshQuantization = "KHR_mesh_quantization";

}  // namespace

std::span<const Member> members_of(Type type) {
  static constexpr std::span<const Member> kMembers[] = {kRoot,
                                                         kAsset,
                                                         kAccessor,
                                                         kSparse,
                                                         kSparseIndices,
                                                         kSparseValues,
                                                         kAnimation,
                                                         kChannel,
                                                         kChannelTarget,
                                                         kAnimationSampler,
                                                         kBuffer,
                                                         kBufferView,
                                                         kCamera,
                                                         kOrthographic,
                                                         kPerspective,
                                                         kImage,
                                                         kMaterial,
                                                         kMetallicRoughness,
                                                         kTextureInfo,
                                                         kNormalTexture,
                                                         kOcclusionTexture,
                                                         kMesh,
                                                         kPrimitive,
                                                         kNode,
                                                         kSampler,
                                                         kScene,
                                                         kSkin,
                                                         kTexture,
                                                         kWebp,
                                                         kAnimationPointer,
                                                         kLights,
                                                         kLight,
                                                         kSpot,
                                                         kNodeLight,
                                                         kAnisotropy,
                                                         kClearcoat,
                                                         kDispersion,
                                                         kEmissiveStrength,
                                                         kIor,
                                                         kIridescence,
                                                         kSpecularGlossiness,
                                                         kSheen,
                                                         kSpecular,
                                                         kTransmission,
                                                         {},
                                                         kVariants,
                                                         kVariant,
                                                         kVariantMappings,
                                                         kVariantMapping,
                                                         kVolume,
                                                         kTextureTransform};
  return kMembers[static_cast<std::size_t>(type)];
}

std::span<const ExtensionObject> extension_objects() {
  return kExtensionObjects;
}

bool is_known_extension(std::string_view name) {
  return name == kMeshQuantization ||
         std::any_of(std::begin(kExtensionObjects), std::end(kExtensionObjects),
                     [name](const ExtensionObject& each) { return each.name == name; });
}

bool must_be_required(std::string_view name) {
  return name == kMeshQuantization;
}

}  // namespace tessera::render::schema
