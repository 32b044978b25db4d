#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "worker/geometry/motion.h"
#include "worker/geometry/shape.h"
#include "worker/math/transform.h"
#include "worker/math/vector.h"
#include "worker/scene/shared_array.h"

namespace tessera::render {

/// Plain data of one frame's scene: decoded, posed at one time and recentred. Made by
/// worker/gltf/build/loader.h and read by accel, light, shading and render, which do not know glTF.

/// Index of an element that is absent.
inline constexpr std::int32_t kNone = -1;

/// Decoded pixels, row-major from the top, level 0 only.
struct Image {
  enum class Storage : std::uint8_t {
    u8,   // 8-bit codes; TextureRef::srgb says whether they are sRGB
    u16,  // 16-bit codes
    f32,  // linear floats
  };
  std::string name;  // URI or image index, for messages
  std::int32_t width = 0, height = 0;
  std::int32_t channels = 0;  // 1 to 4; missing G and B are as the decoder says, A is 1
  Storage storage = Storage::u8;
  SharedArray<std::uint8_t> u8;
  SharedArray<std::uint16_t> u16;
  SharedArray<float> f32;
};

enum class Wrap : std::uint8_t { repeat, clamp, mirror };

/// Procedural texture (TESSERA_texture), evaluated at each lookup
/// (worker/shading/texture/procedural_texture.h).
struct ProceduralTexture {
  enum class Pattern : std::uint8_t {
    noise,
    value_noise,
    fbm,
    turbulence,
    ridged,
    marble,
    wood,
    clouds,
    worn_metal,
    fire
  };
  enum class Space : std::uint8_t { object, world, uv };
  struct Stop {
    float at = 0;  // [0, 1], increasing
    Vec4f color;   // linear
  };
  Pattern pattern = Pattern::fbm;
  Space space = Space::object;
  std::int32_t dimensions = 3;  // 1 to 4; the fourth is time
  Vec3f scale = {1, 1, 1};      // features per metre, or per unit of UV
  Vec3f offset;                 // in features
  float time = 0;
  std::uint32_t seed = 0;
  std::int32_t octaves = 6;
  float lacunarity = 2, gain = 0.5f;  // factors of frequency and amplitude per octave
  float distortion = 1;               // marble and wood: amount of turbulence
  float bump_height = 0;              // metres between values 0 and 1, as a normal map
  std::vector<Stop> ramp;             // at least one stop
};

/// An image with its sampler, or a procedural texture.
struct Texture {
  std::int32_t image = kNone;
  Wrap wrap_u = Wrap::repeat, wrap_v = Wrap::repeat;
  bool nearest = false;             // magnification filter NEAREST; otherwise bilinear
  std::int32_t procedural = kNone;  // takes precedence over `image`
};

/// How a material reads a texture. uv' = matrix * (u, v, 1) (KHR_texture_transform).
struct TextureRef {
  std::int32_t texture = kNone;
  std::int32_t uv_set = 0;  // 0 or 1
  bool srgb = false;        // decode sRGB codes to linear before filtering
  bool has_transform = false;
  std::array<float, 6> uv_matrix = {1, 0, 0, 0, 1, 0};  // rows of a 2x3

  explicit operator bool() const { return texture != kNone; }
};

enum class AlphaMode : std::uint8_t { opaque, mask, blend };

/// KHR_materials_clearcoat: a dielectric coating over all other layers.
struct Clearcoat {
  float factor = 0, roughness = 0;
  TextureRef texture;            // R
  TextureRef roughness_texture;  // G
  TextureRef normal_texture;
  float normal_scale = 1;
};

/// KHR_materials_anisotropy: roughness is higher along one direction.
struct Anisotropy {
  float strength = 0, rotation = 0;  // [0, 1]; radians from the tangent towards the bitangent
  TextureRef texture;                // R, G direction, B strength
};

/// KHR_materials_sheen: fabric fibres over the base layer, below the clearcoat.
struct Sheen {
  Vec3f color;
  TextureRef color_texture;  // sRGB
  float roughness = 0;
  TextureRef roughness_texture;  // A
};

/// KHR_materials_iridescence: a thin film on the base layer.
struct Iridescence {
  float factor = 0;
  TextureRef texture;                                      // R
  float ior = 1.3f;                                        // at least 1
  float thickness_minimum = 100, thickness_maximum = 400;  // nanometres
  TextureRef thickness_texture;                            // G, from minimum to maximum
};

/// KHR_materials_diffuse_transmission: part of the diffuse light leaves on the opposite side.
struct DiffuseTransmission {
  float factor = 0;
  TextureRef texture;  // A
  Vec3f color = {1, 1, 1};
  TextureRef color_texture;  // sRGB
};

/// TESSERA_material: measured optical constants that replace the metallic-roughness model's.
struct Optics {
  bool conductor = false;  // the metallic part has index n + ik and is tinted by the base colour
  Vec3f n = {1, 1, 1}, k;  // complex index of refraction, per channel
  bool exact_fresnel = false;   // of thin dielectric layers, instead of Schlick
  float diffuse_roughness = 0;  // [0, 1] (EON): above 0, rough and retroreflective
  bool has_priority = false;    // this solid has a priority where solids overlap
  std::int32_t priority = 0;    // the solid with the highest priority occupies the overlap
};

/// Density at lattice points over a box; trilinear between them, zero outside. x varies fastest.
struct DensityGrid {
  std::array<std::int32_t, 3> size = {0, 0, 0};  // lattice points, at least 2 each
  Vec3f low, high;                               // corners, in the medium's space
  std::vector<float> values;                     // not negative
};

/// TESSERA_medium: a participating medium, which absorbs, scatters and emits light.
struct Medium {
  Vec3f absorption, scattering;               // per metre at density 1
  Vec3f emission;                             // nits per metre at density 1
  float anisotropy = 0;                       // mean cosine (Henyey-Greenstein), |g| <= 0.999
  std::int32_t procedural = kNone;            // density; a texture index until the scene is posed
  std::shared_ptr<const DensityGrid> grid{};  // density, used instead of `procedural`
};

/// A participating medium that fills a ball around the scene, or all of space.
struct Atmosphere {
  Medium medium;
  Vec3d center;  // recentred world
  double radius = std::numeric_limits<double>::infinity();
};

/// A glTF material with its extensions. Factors multiply textures as the specification says. An
/// extension that is added here also needs a bit in worker/scene/features.h.
struct Material {
  std::string name;

  bool specular_glossiness = false;  // KHR_materials_pbrSpecularGlossiness instead of metal-rough
  Vec4f base_color = {1, 1, 1, 1};   // or diffuse factor
  TextureRef base_color_texture;     // sRGB; or diffuse texture
  float metallic = 1, roughness = 1;
  TextureRef metallic_roughness_texture;  // B metallic, G roughness
  Vec3f specular_f0 = {1, 1, 1};          // specular-glossiness only
  float glossiness = 1;
  TextureRef specular_glossiness_texture;  // RGB (sRGB) specular, A glossiness

  TextureRef normal_texture;
  float normal_scale = 1;
  Vec3f emission;               // nits: emissiveFactor * KHR_materials_emissive_strength
  TextureRef emissive_texture;  // sRGB

  AlphaMode alpha_mode = AlphaMode::opaque;
  float alpha_cutoff = 0.5f;
  bool double_sided = false;
  bool unlit = false;

  float ior = 1.5f;  // 0 means F = 1 (KHR_materials_ior)
  float specular = 1;
  TextureRef specular_texture;  // A
  Vec3f specular_color = {1, 1, 1};
  TextureRef specular_color_texture;  // sRGB

  float transmission = 0;
  TextureRef transmission_texture;  // R
  bool has_volume = false;          // thicknessFactor > 0: a solid, not a thin surface
  Vec3f attenuation_color = {1, 1, 1};
  float attenuation_distance = std::numeric_limits<float>::infinity();  // metres

  Clearcoat clearcoat;
  Anisotropy anisotropy;
  Sheen sheen;
  float dispersion = 0;  // KHR_materials_dispersion: 20 / Abbe number
  Iridescence iridescence;
  DiffuseTransmission diffuse_transmission;
  Optics optics;
  std::optional<Medium> medium = {};  // TESSERA_medium: fills the closed surfaces
};

/// Returns whether the material's surface or the medium behind it emits light.
inline bool gives_light(const Material& m) {
  return (!m.unlit && max_component(m.emission) > 0) ||
         (m.medium && max_component(m.medium->emission) > 0);
}

/// One glTF primitive, as triangles. Optional arrays are empty or as long as `positions`.
struct Primitive {
  std::vector<Vec3f> positions;                         // object space; finite, |x| <= 1e18
  std::vector<std::array<std::uint32_t, 3>> triangles;  // indices in range
  std::vector<Vec3f> normals;                           // unit; empty: flat shading
  std::vector<Vec4f> tangents;                          // only if a normal map needs them; w = +-1
  std::array<std::vector<Vec2f>, 2> uv;                 // only the sets the material reads
  std::vector<Vec4f> colors;                            // linear COLOR_0
  std::int32_t material = 0;                            // index into Scene::materials, always valid
  std::int32_t id = 0;                                  // index of the primitive in its glTF mesh
};

/// A glTF mesh, a skinned or morphed copy of one, or an analytic shape.
struct Mesh {
  std::string name;
  SharedArray<Primitive> primitives;
  std::shared_ptr<const Shape> shape =
      nullptr;  // if set, the mesh has one primitive that holds only the material
  /// For a mesh that deforms during the exposure: positions, normals and tangents of the primitives
  /// at each of Scene::key_times; all other members are unset.
  std::vector<SharedArray<Primitive>> keys = {};
};

/// A placed mesh. Its index in Scene::instances is the instance id that orders hits
/// (docs/explanation/determinism.md#closest-hit): nodes in depth-first order, then the index within
/// EXT_mesh_gpu_instancing.
struct Instance {
  std::int32_t mesh = 0;
  std::int32_t node = 0;        // glTF node index
  Affine3d object_to_world;     // to the recentred world: metres minus Scene::center
  Affine3d world_to_object;     // its inverse; unset if `flat`
  bool flips_winding = false;   // negative determinant
  bool operand = false;         // operand of one of Scene::solids: not hit on its own
  std::int32_t motion = kNone;  // index into Scene::motions; kNone: static
  bool flat = false;            // object_to_world is singular; only if the instance has a motion
};

enum class CsgOperation : std::uint8_t { unite, intersect, subtract, exclude };

/// A step of deciding whether a point is inside a solid, in postfix order. It pushes whether the
/// point is inside an operand, or replaces the topmost results by that of an operation.
struct CsgStep {
  bool is_operand = true;
  CsgOperation operation = CsgOperation::unite;  // subtract: the first without the others; exclude:
                                                 // inside an odd number of them
  std::uint32_t number = 0;  // index of the operand, or number of results to combine; the union of
                             // none is empty
};

/// TESSERA_csg: a body bounded by the surfaces of several closed, consecutive instances.
struct CsgSolid {
  std::int32_t node = 0;               // glTF node index
  std::uint32_t first = 0, count = 0;  // operands, in Scene::instances; at least one
  std::vector<CsgStep> steps;
};

struct PunctualLight : PunctualPose {
  enum class Kind : std::uint8_t { point, spot, directional };
  Kind kind = Kind::point;
  std::string name;
  std::int32_t node = 0;
  Vec3f intensity;  // colour * intensity: candela, or lux for directional lights
  float range = std::numeric_limits<float>::infinity();  // metres
  float cos_inner = 1, cos_outer = 0.70710678f;          // spot cone
  std::vector<PunctualPose> keys;                        // poses at Scene::key_times if it moves
};

/// Thin lens of a perspective camera (TESSERA_camera).
struct Lens {
  double radius = 0;          // of the aperture, metres; 0: pinhole
  double focus_distance = 1;  // metres along -Z
  std::int32_t blades = 0;    // corners of the aperture; 0: round
  double blade_rotation = 0;  // radians, counter-clockwise as the camera looks
  double rim_distance = 0;    // metres in front of the lens where a rim causes vignetting
  double rim_radius = std::numeric_limits<double>::infinity();
};

/// Pose of a camera at one time of the exposure.
struct CameraKey {
  float time = 0;  // [0, 1] of the exposure
  Affine3d camera_to_world;
  double focus_distance = 1;
};

struct Camera {
  enum class Kind : std::uint8_t {
    perspective,
    orthographic,
    spherical,    // TESSERA_camera: longitude by latitude
    cylindrical,  // longitude by height
    equidistant,  // fisheye: distance from the centre proportional to the angle
    equisolid,    // fisheye: distance proportional to the sine of half the angle
  };
  Kind kind = Kind::perspective;
  std::string name;
  double yfov = 0.69813170079773184;  // radians, full vertical angle (perspective)
  double ymag = 1;                    // half height, metres (orthographic)
  double znear = 0;                   // near plane, metres
  double zfar = std::numeric_limits<double>::infinity();
  double center_x = 0, center_y = 0;  // film centre: at depth 1, or metres (orthographic)
  double slant_x = 0, slant_y = 0;    // orthographic: sideways shift per metre of depth
  double horizontal_angle = 0,
         vertical_angle = 0;  // radians, curved projections; equal for fisheyes
  Lens lens;
  Affine3d camera_to_world;  // recentred; orthonormal axes; looks along -Z, +Y is up
  double shutter_open = 0,
         shutter_close = 0;     // seconds from the frame's time; equal: instantaneous
  std::vector<CameraKey> keys;  // poses if it moves during the exposure, with linear interpolation
};

/// Environment map, latitude-longitude, linear
/// (docs/reference/gltf-support.md#lights-and-environment).
struct Environment {
  std::int32_t image = kNone;  // index into Scene::images (f32); kNone: constant
  Vec3f constant;              // radiance if there is no image
  double rotation_degrees = 0;
  float strength = 1;
};

/// Everything needed to render a frame. Unless a member says otherwise, poses are those of the
/// frame's time and positions are recentred.
struct Scene {
  std::vector<Image> images;
  std::vector<Texture> textures;
  std::vector<ProceduralTexture> procedural_textures;
  std::vector<Material> materials;  // at least one; the last is glTF's default material
  std::vector<Mesh> meshes;
  std::vector<Instance> instances;
  std::vector<CsgSolid> solids;
  std::vector<PunctualLight> lights;
  /// Times in [0, 1] of the exposure at which the poses of moving objects are known, from 0 to 1,
  /// with linear interpolation between them. Empty if nothing moves.
  std::vector<float> key_times;
  std::vector<std::vector<Affine3d>> motions;  // object to world at each of key_times
  Camera camera;
  std::optional<Atmosphere> atmosphere = {};
  bool has_environment = false;  // lights the scene, even if camera rays do not see it
  Environment environment;
  Vec3d center;                  // added to recentred positions in AOVs
  Vec3d bounds_min, bounds_max;  // recentred box around the transformed boxes of all meshes; see
                                 // visible_bounds() for a tight one
  /// The scene one frame earlier and later, without images, solids and motion during the exposure;
  /// null unless motion vectors are rendered.
  std::shared_ptr<const Scene> before = nullptr, after = nullptr;
};

}  // namespace tessera::render
