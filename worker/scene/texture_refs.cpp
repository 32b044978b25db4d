#include "worker/scene/texture_refs.h"

#include <algorithm>

namespace tessera::render {

std::array<TextureRef*, 18> texture_refs(Material& m) {
  return {&m.base_color_texture,
          &m.metallic_roughness_texture,
          &m.specular_glossiness_texture,
          &m.normal_texture,
          &m.emissive_texture,
          &m.specular_texture,
          &m.specular_color_texture,
          &m.transmission_texture,
          &m.clearcoat.texture,
          &m.clearcoat.roughness_texture,
          &m.clearcoat.normal_texture,
          &m.anisotropy.texture,
          &m.sheen.color_texture,
          &m.sheen.roughness_texture,
          &m.iridescence.texture,
          &m.iridescence.thickness_texture,
          &m.diffuse_transmission.texture,
          &m.diffuse_transmission.color_texture};
}

std::array<const TextureRef*, 18> texture_refs(const Material& m) {
  std::array<const TextureRef*, 18> out{};
  std::ranges::copy(texture_refs(const_cast<Material&>(m)), out.begin());
  return out;
}

}  // namespace tessera::render
