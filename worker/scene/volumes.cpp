#include "worker/scene/volumes.h"

#include <cmath>
#include <vector>

#include "worker/math/elementary.h"

namespace tessera::render {

namespace {

/// Returns whether the surface has no effect on light, apart from vertex colours.
bool is_index_matched_boundary(const Material& m) {
  const bool is_clear = m.base_color.xyz() == Vec3f{1, 1, 1} && !m.base_color_texture;
  const bool passes = m.transmission == 1 && !m.transmission_texture && m.metallic == 0;
  const bool has_more = m.unlit || m.specular_glossiness || m.alpha_mode != AlphaMode::opaque ||
                        max_component(m.emission) > 0 || m.clearcoat.factor > 0 ||
                        max_component(m.sheen.color) > 0 || m.iridescence.factor > 0 ||
                        m.diffuse_transmission.factor > 0 || m.optics.has_priority;
  return m.has_volume && m.ior == 1 && is_clear && passes && !has_more;
}

}  // namespace

Vec3f volume_absorption(const Material& material) {
  Vec3f sigma;
  for (int k = 0; k < 3; ++k) {
    const float c = material.attenuation_color[k];
    const bool clear = !(c < 1) || !(material.attenuation_distance < INFINITY);
    if (clear) continue;
    sigma[k] = c > 0 ? -elementary::log(c) / material.attenuation_distance : INFINITY;
  }
  return sigma;
}

void convert_index_matched_solids(Scene& scene) {
  std::vector<bool> tinted(scene.materials.size());
  for (const Mesh& mesh : scene.meshes) {
    for (const Primitive& p : mesh.primitives) {
      if (!p.colors.empty()) tinted[static_cast<std::size_t>(p.material)] = true;
    }
  }
  for (std::size_t i = 0; i < scene.materials.size(); ++i) {
    Material& m = scene.materials[i];
    if (tinted[i] || !is_index_matched_boundary(m)) continue;
    if (!m.medium) m.medium.emplace();
    m.medium->absorption += volume_absorption(m);
    m.transmission = 0;
    m.has_volume = false;
  }
}

}  // namespace tessera::render
