#include "worker/shading/surface/shading_scene.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

#include "worker/accel/build/instance_boxes.h"
#include "worker/math/elementary.h"
#include "worker/scene/features.h"
#include "worker/scene/volumes.h"
#include "worker/shading/microfacet/fresnel.h"

namespace tessera::render {
namespace {

/// Minimum alpha of an image: bilinear filtering stays within the range of its texels.
float min_alpha(const Image& image) {
  if (image.channels != 2 && image.channels != 4) return 1;
  const auto step = static_cast<std::size_t>(image.channels);
  float minimum = 1;
  for (std::size_t i = step - 1; i < image.u8.size(); i += step) {
    minimum = std::min(minimum, static_cast<float>(image.u8[i]) / 255);
  }
  for (std::size_t i = step - 1; i < image.u16.size(); i += step) {
    minimum = std::min(minimum, static_cast<float>(image.u16[i]) / 65535);
  }
  for (std::size_t i = step - 1; i < image.f32.size(); i += step) {
    minimum = std::min(minimum, image.f32[i]);
  }
  return minimum;
}

/// Minimum alpha of a procedural texture.
float min_alpha(const ProceduralTexture& procedural) {
  float minimum = 1;
  for (const ProceduralTexture::Stop& stop : procedural.ramp)
    minimum = std::min(minimum, stop.color.w);
  return minimum;
}

/// Returns whether rays may pass through some point of the material as a hole.
bool has_holes(const Material& material, const Scene& scene) {
  if (material.alpha_mode == AlphaMode::opaque) return false;
  float minimum = material.base_color.w;
  if (material.base_color_texture) {
    const auto index = static_cast<std::size_t>(material.base_color_texture.texture);
    const Texture& texture = scene.textures[index];
    if (texture.procedural != kNone) {
      minimum *= min_alpha(scene.procedural_textures[static_cast<std::size_t>(texture.procedural)]);
    } else if (texture.image != kNone) {
      minimum *= min_alpha(scene.images[static_cast<std::size_t>(texture.image)]);
    }
  }
  return material.alpha_mode == AlphaMode::mask ? !(minimum >= material.alpha_cutoff)
                                                : !(minimum >= 1);
}

Interface interface_of(const Material& m) {
  const bool transmits = (m.transmission > 0 || m.diffuse_transmission.factor > 0) && !m.unlit;
  if (!transmits) return Interface::opaque;
  return m.has_volume ? Interface::solid : Interface::thin;
}

/// Returns whether the material bounds a solid that absorbs light.
bool is_absorbing_solid(const Material& m) {
  return interface_of(m) == Interface::solid && max_component(volume_absorption(m)) > 0;
}

std::uint8_t traits_of(const Material& material, const MaterialView& view, const Scene& scene) {
  unsigned traits = 0;
  if (has_holes(material, scene)) traits |= kTraitAlpha;
  if (material.unlit) traits |= kTraitUnlit;
  if (view.interface == Interface::thin && material.transmission > 0) traits |= kTraitStraight;
  if (view.emissive) traits |= kTraitEmissive;
  if (!material.double_sided && !material.has_volume) traits |= kTraitOneSided;
  return static_cast<std::uint8_t>(traits);
}

PrimitiveView view_of(const Primitive& p) {
  PrimitiveView v;
  v.positions = p.positions.data();
  v.triangles = p.triangles.data();
  if (!p.normals.empty()) v.normals = p.normals.data();
  if (!p.tangents.empty()) v.tangents = p.tangents.data();
  for (std::size_t k = 0; k < 2; ++k) {
    if (!p.uv[k].empty()) v.uv[k] = p.uv[k].data();
  }
  if (!p.colors.empty()) v.colors = p.colors.data();
  v.triangle_count = static_cast<std::uint32_t>(p.triangles.size());
  v.material = p.material;
  v.id = p.id;
  return v;
}

/// Bound for the deviation of rounded normals of a flat triangle: 2^-22.
bool leans(const Vec3f& normal, const Vec3f& edge) {
  const float height = dot(edge, normal);
  return height * height > 0x1p-40f * dot(edge, edge) * dot(normal, normal);
}

/// Returns whether some vertex normal is not perpendicular to its triangle; otherwise
/// offset_shadow_terminator() has no effect.
bool has_leaning_normals(const Primitive& p) {
  if (p.normals.empty()) return false;
  for (const auto& triangle : p.triangles) {
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3f &normal = p.normals[triangle[k]], &from = p.positions[triangle[k]];
      if (leans(normal, p.positions[triangle[(k + 1) % 3]] - from)) return true;
      if (leans(normal, p.positions[triangle[(k + 2) % 3]] - from)) return true;
    }
  }
  return false;
}

/// Returns whether the material uses BsdfExtensions.
bool is_layered(const Material& m) {
  return m.clearcoat.factor > 0 || m.anisotropy.strength > 0 || max_component(m.sheen.color) > 0 ||
         m.iridescence.factor > 0 || m.diffuse_transmission.factor > 0 || m.optics.conductor ||
         m.optics.exact_fresnel || m.optics.diffuse_roughness > 0;
}

Conductor conductor_of(const Optics& optics) {
  Conductor c;
  c.present = optics.conductor;
  if (!c.present) return c;
  c.n = optics.n;
  c.k = optics.k;
  // Integral of F(sqrt(t)) over [0, 1] by the midpoint rule; relative error 1e-4.
  constexpr int kSteps = 64;
  for (int i = 0; i < kSteps; ++i) {
    const float cosine = std::sqrt((static_cast<float>(i) + 0.5f) / kSteps);
    for (int k = 0; k < 3; ++k) {
      c.average[k] += fresnel_conductor(cosine, c.n[k], c.k[k]) / kSteps;
    }
  }
  return c;
}

/// Vertex colours can lower alpha below that of material and texture.
bool colors_make_holes(const Primitive& p, const Material& material) {
  if (material.alpha_mode == AlphaMode::opaque) return false;
  for (const Vec4f& c : p.colors) {
    if (!(c.w >= 1)) return true;
  }
  return false;
}

/// Materials that some primitive uses; tables are built only for these.
std::vector<bool> used_materials(const Scene& scene) {
  std::vector<bool> used(scene.materials.size());
  for (const Mesh& mesh : scene.meshes) {
    for (const Primitive& p : mesh.primitives) used[static_cast<std::size_t>(p.material)] = true;
  }
  return used;
}

}  // namespace

ShadingScene::ShadingScene(const Scene& scene, std::uint64_t assumed)
    : source(scene), textures(scene), assumed_(assumed) {
  tracks_footprints = textures.has_procedural() || assumes(kFeatureProceduralTextures);
  add_atmosphere(scene);
  add_materials(scene);
  std::vector<std::uint32_t> first;
  for (const Mesh& mesh : scene.meshes) {
    first.push_back(static_cast<std::uint32_t>(primitives.size()));
    for (const Primitive& p : mesh.primitives) {
      PrimitiveView view = view_of(p);
      const MaterialView& material = materials[static_cast<std::size_t>(p.material)];
      view.traits = material.traits;
      const bool may_lean = has_leaning_normals(p) || (!mesh.keys.empty() && !p.normals.empty());
      view.curved = material.interface == Interface::opaque && may_lean &&
                    !(material.source->diffuse_transmission.factor > 0);
      const bool visible = material.rank != kBoundaryRank;
      if (visible && colors_make_holes(p, *material.source)) view.traits |= kTraitAlpha;
      if (visible) view.traits |= assumed_traits();
      traits |= view.traits;
      primitives.push_back(view);
    }
  }
  if (assumes(kFeatureUnlit)) traits |= kTraitUnlit;
  for (const Instance& instance : scene.instances) {
    const auto mesh = static_cast<std::size_t>(instance.mesh);
    InstanceView view;
    view.source = &instance;
    view.shape = scene.meshes[mesh].shape.get();
    const bool changes = !scene.meshes[mesh].keys.empty();  // solids never deform
    view.solid = view.shape != nullptr || instance.operand ||
                 (assumes(kFeatureShapes | kFeatureCsg) && !changes);
    view.moves = instance.motion != kNone || changes || assumes(kFeatureMotion);
    view.special = view.solid || view.moves;
    view.object_to_world = Affine3f(instance.object_to_world);
    view.world_to_object = Affine3f(instance.world_to_object);
    view.first_primitive = first[mesh];
    view.primitive_count = static_cast<std::uint32_t>(scene.meshes[mesh].primitives.size());
    view.node = instance.node;
    view.handedness = instance.flips_winding ? -1.0f : 1.0f;
    view.body = static_cast<std::uint32_t>(instances.size());
    instances.push_back(view);
  }
  for (const CsgSolid& solid : scene.solids) {
    for (std::uint32_t i = 0; i < solid.count; ++i) instances[solid.first + i].body = solid.first;
  }
  for (InstanceView& view : instances) view.still = &view;
  if ((traits & kTraitBody) != 0) add_body_boxes(scene);
  memory_bytes = textures.memory_bytes() +
                 static_cast<std::int64_t>(primitives.size() * sizeof(PrimitiveView) +
                                           instances.size() * sizeof(InstanceView) +
                                           materials.size() * sizeof(MaterialView) +
                                           glass_.size() * sizeof(GlassTables));
}

/// Traits that surfaces are assumed to have. None of them changes the result of a ray.
std::uint8_t ShadingScene::assumed_traits() const {
  unsigned assumed = 0;
  if (assumes(kFeatureAlphaMask | kFeatureAlphaBlend)) assumed |= kTraitAlpha;
  if (assumes(kFeatureThinTransmission)) assumed |= kTraitStraight;
  return static_cast<std::uint8_t>(assumed);
}

void ShadingScene::add_atmosphere(const Scene& scene) {
  tracks_bodies = assumes(kFeatureMedia);
  has_emissive_media = assumes(kFeatureEmissiveMedia);
  const std::vector<bool> used = used_materials(scene);
  for (std::size_t i = 0; i < scene.materials.size(); ++i) {
    const Material& m = scene.materials[i];
    if (used[i] && (m.medium || m.optics.has_priority || is_absorbing_solid(m)))
      tracks_bodies = true;
  }
  if (!scene.atmosphere) return;
  atmosphere = view_of_medium(scene, &scene.atmosphere->medium, {});
  atmosphere_center = Vec3f(scene.atmosphere->center);
  atmosphere_radius = static_cast<float>(scene.atmosphere->radius);
  tracks_bodies = tracks_bodies || atmosphere.present();
  has_emissive_media = has_emissive_media || atmosphere.emits();
}

void ShadingScene::add_materials(const Scene& scene) {
  materials.reserve(scene.materials.size());
  const std::vector<bool> used = used_materials(scene);
  for (const Material& m : scene.materials) {
    MaterialView view;
    view.source = &m;
    const float f0 = f0_from_ior(m.ior);
    view.f0 = m.specular_glossiness ? m.specular_f0 : m.specular_color * f0;
    view.extinction = volume_absorption(m);
    view.absorbs = m.has_volume && max_component(view.extinction) > 0;
    view.emissive = !m.unlit && max_component(m.emission) > 0;
    view.interface = interface_of(m);
    view.dispersive = m.dispersion > 0 && view.interface == Interface::solid && m.transmission > 0;
    view.conductor = conductor_of(m.optics);
    view.extended = (is_layered(m) || view.dispersive) && !m.unlit;
    view.lambert = m.metallic == 0 && m.specular == 0 && !m.specular_glossiness &&
                   view.interface == Interface::opaque && !view.extended &&
                   !assumes(kFeatureSpecular);
    if (used[materials.size()]) add_tables(&view);
    view.traits = traits_of(m, view, scene);
    if (tracks_bodies) add_volume(scene, &view);
    materials.push_back(view);
  }
  if (!tracks_bodies) return;
  add_relative();
  mark_crossed();
}

/// Marks the bodies whose surfaces are not always visible. Nothing hides solids of the highest
/// rank, so they block light like other surfaces.
void ShadingScene::mark_crossed() {
  std::int32_t highest = 0;
  for (const MaterialView& view : materials) highest = std::max(highest, view.rank);
  for (MaterialView& view : materials) {
    if ((view.traits & kTraitBody) != 0 && view.rank < highest) view.traits |= kTraitCrossed;
  }
}

/// Sets the medium that the material's surfaces enclose: of solids, inside their interface; of
/// other materials with a medium, inside an invisible boundary.
void ShadingScene::add_volume(const Scene& scene, MaterialView* view) {
  const Material& m = *view->source;
  const bool solid = view->interface == Interface::solid;
  if (!solid && !m.medium) return;
  view->rank = solid ? m.optics.priority : kBoundaryRank;
  view->medium = view_of_medium(scene, m.medium ? &*m.medium : nullptr,
                                solid && view->absorbs ? view->extinction : Vec3f{});
  has_emissive_media = has_emissive_media || view->medium.emits();
  view->traits |= kTraitBody;
  if (solid) return;
  view->traits = kTraitBody;
  view->emissive = false;
}

void ShadingScene::add_relative() {
  const auto takes_part = [](const MaterialView& v) {
    return v.interface == Interface::solid && v.source->ior > 0;
  };
  bool wanted = false;
  for (const MaterialView& v : materials) {
    wanted = wanted || (takes_part(v) && v.source->optics.has_priority);
  }
  if (!wanted) return;
  for (const MaterialView& inside : materials) {
    if (!takes_part(inside) || inside.dispersive) continue;
    for (const MaterialView& outside : materials) {
      auto& relative = relative_[{&inside, outside.source->ior}];
      if (!takes_part(outside) || outside.source->ior == 1 || relative != nullptr) continue;
      relative = std::make_unique<Relative>(Relative{*inside.source, inside});
      relative->material.ior /= outside.source->ior;
      relative->view.source = &relative->material;
      relative->view.f0 = relative->material.specular_color * f0_from_ior(relative->material.ior);
      if (inside.tables.entering != nullptr) add_glass_tables(&relative->view);
    }
  }
  std::erase_if(relative_, [](const auto& entry) { return entry.second == nullptr; });
}

/// Adds a box for each instance or CSG solid that may contain a medium, padded like those of ray
/// tracing. If anything moves during the exposure, adds one box around everything.
void ShadingScene::add_body_boxes(const Scene& scene) {
  const std::vector<bool> moving = moving_instances(scene);
  constexpr float kFar = std::numeric_limits<float>::infinity();
  constexpr Box3f kEverywhere = {{-kFar, -kFar, -kFar}, {kFar, kFar, kFar}};
  if (std::find(moving.begin(), moving.end(), true) != moving.end()) {
    body_boxes_ = {kEverywhere};
    return;
  }
  std::vector<Box3f> meshes(scene.meshes.size());
  for (std::size_t i = 0; i < instances.size(); ++i) {
    const auto mesh = static_cast<std::size_t>(scene.instances[i].mesh);
    const std::span views(primitives.data() + instances[i].first_primitive,
                          instances[i].primitive_count);
    const bool body = std::any_of(views.begin(), views.end(), [](const PrimitiveView& view) {
      return (view.traits & kTraitBody) != 0;
    });
    if (!(body || scene.instances[i].operand) || !meshes[mesh].empty()) continue;
    if (instances[i].shape != nullptr) {
      meshes[mesh] = instances[i].shape->bounds;
      continue;
    }
    for (const Primitive& p : scene.meshes[mesh].primitives) {
      for (const Vec3f& at : p.positions) meshes[mesh].extend(at);
    }
  }
  InstanceBoxes bodies = bound_instances(scene, meshes);
  body_boxes_ = std::move(bodies.boxes);
  if (!bodies.unbounded.empty()) body_boxes_.push_back(kEverywhere);
}

bool ShadingScene::may_be_in_body(const Vec3f& p) const {
  return std::any_of(body_boxes_.begin(), body_boxes_.end(),
                     [&p](const Box3f& box) { return box.contains(p); });
}

void ShadingScene::add_tables(MaterialView* view) {
  const Material& m = *view->source;
  const bool metal = m.metallic > 0 && !m.specular_glossiness;
  if (metal || view->interface == Interface::thin) {
    if (!reflector_) reflector_ = std::make_unique<AlbedoTable>(AlbedoTable::reflector());
    view->tables.reflector = reflector_.get();
  }
  if (m.anisotropy.strength > 0 && (metal || view->interface == Interface::thin)) {
    if (!anisotropic_) anisotropic_ = std::make_unique<AnisotropicAlbedo>();
    view->tables.anisotropic = anisotropic_.get();
  }
  if (max_component(m.sheen.color) > 0) {
    if (!sheen_) sheen_ = std::make_unique<SheenTable>();
    view->tables.sheen = sheen_.get();
  }
  const bool refracts = view->interface == Interface::solid && m.transmission > 0;
  if (refracts && m.ior > 0 && m.roughness > 0) add_glass_tables(view);
}

void ShadingScene::add_glass_tables(MaterialView* view) {
  const float ior = view->source->ior;
  for (const auto& tables : glass_) {
    if (tables->ior == ior) {
      view->tables.entering = &tables->entering;
      view->tables.leaving = &tables->leaving;
      return;
    }
  }
  glass_.push_back(std::make_unique<GlassTables>(
      GlassTables{ior, AlbedoTable::dielectric(ior), AlbedoTable::dielectric(1.0 / ior)}));
  view->tables.entering = &glass_.back()->entering;
  view->tables.leaving = &glass_.back()->leaving;
}

}  // namespace tessera::render
