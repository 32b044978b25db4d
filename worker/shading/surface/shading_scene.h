#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "worker/geometry/bounds.h"
#include "worker/geometry/ray.h"
#include "worker/scene/scene.h"
#include "worker/shading/tables/albedo_table.h"
#include "worker/shading/tables/anisotropic_albedo.h"
#include "worker/shading/bsdf/bsdf.h"
#include "worker/shading/surface/medium.h"
#include "worker/shading/tables/sheen.h"
#include "worker/shading/surface/texture.h"

namespace tessera::render {

/// Why a hit on a primitive needs a second look, as bits; what a scene does not use costs nothing.
inline constexpr std::uint8_t kTraitAlpha = 1u << 0;     // MASK or BLEND, and some alpha is below 1
inline constexpr std::uint8_t kTraitUnlit = 1u << 1;     // seen by camera rays only
inline constexpr std::uint8_t kTraitStraight = 1u << 2;  // a thin sheet: light may go straight on
inline constexpr std::uint8_t kTraitEmissive = 1u << 3;
inline constexpr std::uint8_t kTraitOneSided = 1u << 4;  // --cull-backfaces hides its back
inline constexpr std::uint8_t kTraitBody = 1u << 5;  // bounds a body, in a scene that tracks_bodies

/// One glTF primitive as the hot code reads it. Null where the file has no such attribute.
struct PrimitiveView {
  const Vec3f* positions = nullptr;
  const std::array<std::uint32_t, 3>* triangles = nullptr;
  const Vec3f* normals = nullptr;
  const Vec4f* tangents = nullptr;
  std::array<const Vec2f*, 2> uv = {nullptr, nullptr};
  const Vec4f* colors = nullptr;
  std::uint32_t triangle_count = 0;
  std::int32_t material = 0;
  std::int32_t id = 0;  // glTF primitive
  bool curved = false;  // opaque, with vertex normals: see offset_shadow_terminator()
  std::uint8_t traits = 0;
};

struct InstanceView {
  Affine3f object_to_world, world_to_object;
  const Instance* source = nullptr;     // its transforms in double
  const Shape* shape = nullptr;         // if it is one, and no mesh
  bool solid = false;                   // a shape, or an operand of a CSG solid
  bool moves = false;                   // or its mesh does, while the shutter is open
  bool special = false;                 // a solid, or it moves
  const InstanceView* still = nullptr;  // itself; of one as it is at a time, at the frame's
  std::uint32_t first_primitive = 0;    // of its mesh, into ShadingScene::primitives
  std::uint32_t primitive_count = 0;
  std::int32_t node = 0;
  float handedness = 1;  // -1 for mirrored instances
  std::uint32_t body =
      0;  // what its surface is part of: the first instance of its CSG solid, or it
};

/// A material with everything that does not vary over the surface worked out.
struct MaterialView {
  const Material* source = nullptr;
  Vec3f f0;          // dielectric, before specularColorTexture
  Vec3f extinction;  // -ln(attenuationColor) / attenuationDistance, 1/m; may be infinite
  bool absorbs = false;
  bool emissive = false;
  bool extended = false;    // has an extension of BsdfExtensions, or disperses
  bool dispersive = false;  // refracts each wavelength differently
  bool lambert = false;     // nothing but a diffuse lobe of the base colour, wherever it is met
  Interface interface = Interface::opaque;
  Conductor conductor;
  BsdfTables tables;
  std::uint8_t traits = 0;
  std::int32_t rank = 0;  // among bodies that overlap: the priority of solids, kBoundaryRank
  MediumView medium;      // what it encloses, if it bounds a body
};

/// Rank of surfaces that are nothing but the end of a medium: below that of all solids.
inline constexpr std::int32_t kBoundaryRank = -1;

/// A scene flattened for shading: views into `Scene`, which must outlive it.
struct ShadingScene {
  /// `assumed`: Tracing::assumed.
  explicit ShadingScene(const Scene& scene, std::uint32_t assumed = 0);
  ShadingScene(const ShadingScene&) = delete;
  ShadingScene& operator=(const ShadingScene&) = delete;

  const PrimitiveView& primitive(const TriangleId& id) const {
    return primitives[instances[id.instance].first_primitive + id.primitive];
  }

  /// Whether everything is taken to have one of the features.
  bool assumes(std::uint32_t features) const { return (assumed_ & features) != 0; }

  /// The material of a solid as it is met where the solid `outside` is on the other side of its
  /// surface: its index of refraction is relative to that. Without priorities, and for dispersive
  /// ones, `inside` itself.
  const MaterialView& between(const MaterialView& inside, const MaterialView& outside) const {
    const auto found = relative_.find({&inside, outside.source->ior});
    return found == relative_.end() ? inside : found->second->view;
  }

  /// False where no place near `p` is in a body. Requires: a scene with kTraitBody.
  bool may_be_in_body(const Vec3f& p) const;

  const Scene& source;
  TextureTable textures;
  std::vector<PrimitiveView> primitives;
  std::vector<InstanceView> instances;
  std::vector<MaterialView> materials;
  std::uint8_t traits = 0;         // of any primitive
  bool tracks_bodies = false;      // has a medium or priorities: paths know all bodies they are in
  bool tracks_footprints = false;  // has procedures, which ask how wide a spot is seen
  MediumView atmosphere;
  Vec3f atmosphere_center;
  float atmosphere_radius = 0;
  std::int64_t memory_bytes = 0;

 private:
  std::uint8_t assumed_traits() const;
  void add_atmosphere(const Scene& scene);
  void add_materials(const Scene& scene);
  void add_interior(const Scene& scene, MaterialView* view);
  void add_tables(MaterialView* view);
  void add_glass_tables(MaterialView* view);
  void add_relative();
  void add_body_boxes(const Scene& scene);

  struct GlassTables {
    float ior = 0;
    AlbedoTable entering, leaving;
  };
  const std::uint32_t assumed_;
  std::vector<Box3f> body_boxes_;  // in the world, around whatever has a body; see add_body_boxes()
  std::unique_ptr<AnisotropicAlbedo> anisotropic_;  // if a metal or thin sheet is anisotropic
  std::unique_ptr<SheenTable> sheen_;
  std::unique_ptr<AlbedoTable> reflector_;           // if any metal or thin sheet needs it
  std::vector<std::unique_ptr<GlassTables>> glass_;  // one per index of refraction

  /// A solid's material with the index it has relative to another's.
  struct Relative {
    Material material;
    MaterialView view;
  };
  std::map<std::pair<const MaterialView*, float>, std::unique_ptr<Relative>> relative_;
};

}  // namespace tessera::render
