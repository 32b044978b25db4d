#include "tests/support/render/assumed_features.h"

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "worker/gltf/model/gltf_model.h"
#include "worker/scene/features.h"
#include "worker/scene/texture_refs.h"

namespace tessera::testing {
namespace {

using render::Material;
using render::Mesh;
using render::Primitive;
using render::Scene;
using render::TextureRef;

/// Appends a white texture large enough not to be reduced to one texel.
std::int32_t add_white_texture(Scene* scene) {
  render::Image image;
  image.width = image.height = 2;
  image.channels = 4;
  image.u8 = std::vector<std::uint8_t>(16, 255);
  render::Texture texture;
  texture.image = static_cast<std::int32_t>(scene->images.size());
  scene->images.push_back(std::move(image));
  scene->textures.push_back(texture);
  return static_cast<std::int32_t>(scene->textures.size()) - 1;
}

/// Puts the white texture behind the factors of the base layers, which it does not change.
void add_textures(std::int32_t white, Material* m) {
  const auto add = [white](TextureRef& ref, bool srgb) {
    if (ref) return;
    ref.texture = white;
    ref.srgb = srgb;
  };
  add(m->base_color_texture, true);
  add(m->metallic_roughness_texture, false);
  add(m->specular_glossiness_texture, true);
  add(m->specular_texture, false);
  add(m->specular_color_texture, true);
  add(m->transmission_texture, false);
}

bool has_textures(const Material& m) {
  const auto refs = texture_refs(m);
  return std::any_of(refs.begin(), refs.end(), [](const TextureRef* ref) { return bool(*ref); });
}

/// Adds texture coordinates where there are none; all but (0, 0), which a texture of the file reads
/// there.
void add_coordinates(const Scene& scene, Primitive* p) {
  const Material& m = scene.materials[static_cast<std::size_t>(p->material)];
  if (m.anisotropy.strength > 0 || has_textures(m) || !p->uv[0].empty()) return;
  p->uv[0].reserve(p->positions.size());
  for (const render::Vec3f& at : p->positions) p->uv[0].push_back({at.x, at.y});
}

template <typename Change>
void change_primitives(Scene* scene, const Change& change) {
  for (Mesh& mesh : scene->meshes) {
    if (mesh.shape != nullptr) continue;
    std::vector<Primitive> changed(mesh.primitives.begin(), mesh.primitives.end());
    for (Primitive& p : changed) change(&p);
    mesh.primitives = std::move(changed);
  }
}

}  // namespace

render::TraceOptions assume(std::uint64_t features, Scene* scene, render::Isa isa) {
  if ((features & render::kFeatureTextures) != 0) {
    const std::int32_t white = add_white_texture(scene);
    change_primitives(scene, [scene](Primitive* p) { add_coordinates(*scene, p); });
    for (Material& m : scene->materials) add_textures(white, &m);
  }
  if ((features & render::kFeatureTextureTransforms) != 0) {
    for (Material& m : scene->materials) {
      for (TextureRef* ref : texture_refs(m)) ref->has_transform = true;
    }
  }
  if ((features & render::kFeatureVertexColors) != 0) {
    change_primitives(scene, [](Primitive* p) {
      if (p->colors.empty()) p->colors.assign(p->positions.size(), {1, 1, 1, 1});
    });
  }
  render::TraceOptions tracing = isa;
  tracing.assumed_features = features;
  return tracing;
}

std::uint64_t feature_named(std::string_view name) {
  for (std::uint64_t bit = 1; bit != 0; bit <<= 1) {
    if (render::feature_names(bit).front() == name) return bit;
  }
  return 0;
}

}  // namespace tessera::testing
