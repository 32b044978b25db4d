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
#include "worker/shading/bsdf/bsdf.h"
#include "worker/shading/surface/medium.h"
#include "worker/shading/tables/glass_albedo.h"
#include "worker/shading/texture/texture.h"

namespace tessera::render {

/// Properties of a primitive for which a hit needs extra work, as bits; a scene pays only for those
/// it uses.
inline constexpr std::uint8_t kTraitAlpha = 1u << 0;  // MASK or BLEND with some alpha below 1
inline constexpr std::uint8_t kTraitUnlit = 1u << 1;  // visible to camera rays only
inline constexpr std::uint8_t kTraitStraight =
    1u << 2;  // thin surface: light may pass straight through
inline constexpr std::uint8_t kTraitEmissive = 1u << 3;
inline constexpr std::uint8_t kTraitOneSided = 1u << 4;  // --cull-backfaces hides its back
inline constexpr std::uint8_t kTraitBody = 1u << 5;  // bounds a body, in a scene that tracks_bodies
inline constexpr std::uint8_t kTraitCrossed =
    1u << 6;  // of a body; light may cross it straight, because it can be hidden or is invisible

/// A glTF primitive as read by hot code. Absent attributes are null.
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

/// An instance as read by hot code.
struct InstanceView {
  Affine3f object_to_world, world_to_object;
  const Instance* source = nullptr;  // its transforms in double
  const Shape* shape = nullptr;      // null for a mesh
  bool solid = false;                // a shape, or an operand of a CSG solid
  bool moves = false;                // it or its mesh moves during the exposure
  bool special = false;              // a solid, or moving
  const InstanceView* still =
      nullptr;  // itself; for one posed at another time, that of the frame's time
  std::uint32_t first_primitive = 0;  // of its mesh, index into ShadingScene::primitives
  std::uint32_t primitive_count = 0;
  std::int32_t node = 0;
  float handedness = 1;    // -1 for mirrored instances
  std::uint32_t body = 0;  // the first instance of its CSG solid, or itself
};

/// A material with everything precomputed that does not vary over the surface.
struct MaterialView {
  const Material* source = nullptr;
  Vec3f f0;              // dielectric, before specularColorTexture
  Vec3f extinction;      // -ln(attenuationColor) / attenuationDistance, 1/m; may be infinite
  bool absorbs = false;  // inside, by the extinction
  bool emissive = false;
  bool extended = false;    // has an extension of BsdfExtensions, or disperses
  bool dispersive = false;  // refracts wavelengths differently
  bool lambert = false;     // has only a diffuse lobe of the base colour everywhere
  Interface interface = Interface::opaque;
  Conductor conductor;
  BsdfTables tables;
  std::vector<float> film_caps;  // ThinFilm::cap at equal steps of thickness, from its minimum up
  std::uint8_t traits = 0;
  std::int32_t rank = 0;  // among overlapping bodies: the priority of solids, kBoundaryRank
  MediumView medium;      // inside the body that it bounds
};

/// Rank of mere boundaries of a medium: below all solids.
inline constexpr std::int32_t kBoundaryRank = -1;

/// A scene flattened for shading. Refers to `Scene`, which must outlive it.
struct ShadingScene {
  /// `assumed`: see TraceOptions.
  explicit ShadingScene(const Scene& scene, std::uint64_t assumed = 0);
  ShadingScene(const ShadingScene&) = delete;
  ShadingScene& operator=(const ShadingScene&) = delete;

  const PrimitiveView& primitive(const TriangleId& id) const {
    return primitives[instances[id.instance].first_primitive + id.primitive];
  }

  /// Returns whether the scene is treated as using one of `features` throughout.
  bool assumes(std::uint64_t features) const { return (assumed_ & features) != 0; }

  /// Material of the solid `inside` where its surface borders the solid `outside`: its index of
  /// refraction is relative to that of `outside`. Without priorities, and for dispersive materials,
  /// `inside` itself.
  const MaterialView& between(const MaterialView& inside, const MaterialView& outside) const {
    const auto found = relative_.find({&inside, outside.source->ior});
    return found == relative_.end() ? inside : found->second->view;
  }

  /// Returns false if no point near `p` is in a body. Requires a scene with kTraitBody.
  bool may_be_in_body(const Vec3f& p) const;

  const Scene& source;
  TextureTable textures;
  std::vector<PrimitiveView> primitives;
  std::vector<InstanceView> instances;
  std::vector<MaterialView> materials;
  std::uint8_t traits = 0;     // of all primitives combined
  bool tracks_bodies = false;  // has a medium, absorbs or has priorities: paths keep a stack
  bool has_emissive_media = false;
  bool tracks_footprints = false;  // has procedural textures, which need footprints
  MediumView atmosphere;
  Vec3f atmosphere_center;
  float atmosphere_radius = 0;
  std::int64_t memory_bytes = 0;

 private:
  std::uint8_t assumed_traits() const;
  void add_atmosphere(const Scene& scene);
  void add_materials(const Scene& scene);
  void add_volume(const Scene& scene, MaterialView* view);
  void add_tables(MaterialView* view);
  void add_glass_tables(MaterialView* view);
  void add_relative();
  void mark_crossed();
  void add_body_boxes(const Scene& scene);

  struct GlassTables {
    float ior = 0, dispersion = 0;
    GlassTableParts parts;
    GlassTable entering, leaving;
  };
  const std::uint64_t assumed_;
  std::vector<Box3f> body_boxes_;  // around bodies, world space; see add_body_boxes()
  std::vector<std::unique_ptr<GlassTables>> glass_;  // one per index and dispersion

  /// Material of a solid with its index relative to another's.
  struct Relative {
    Material material;
    MaterialView view;
  };
  std::map<std::pair<const MaterialView*, float>, std::unique_ptr<Relative>> relative_;
};

}  // namespace tessera::render
