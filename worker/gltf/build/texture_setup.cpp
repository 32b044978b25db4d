#include "worker/gltf/build/texture_setup.h"

#include <algorithm>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "worker/gltf/decode/image_decoder.h"
#include "worker/gltf/file/limits.h"
#include "worker/scene/texture_refs.h"

namespace tessera::render {
namespace {

class TextureBuilder {
 public:
  TextureBuilder(const TextureInput& input, Scene& scene, std::vector<Problem>& problems)
      : input_(input), scene_(scene), problems_(problems) {}

  absl::Status add_all() {
    for (const GltfTexture& source : input_.model.texture_sources) {
      Texture texture;
      if (source.sampler != kNone) texture = input_.model.samplers[source.sampler];
      texture.image = kNone;
      scene_.textures.push_back(texture);
    }
    std::map<std::int32_t, std::int32_t> decoded;  // glTF image -> Scene::images
    for (std::size_t m = 0; m < scene_.materials.size(); ++m) {
      for (TextureRef* ref : texture_refs(scene_.materials[m])) {
        if (!*ref) continue;
        const GltfTexture& source = input_.model.texture_sources[ref->texture];
        if (input_.used[m] && source.procedural != kNone) {
          add_procedural(ref->texture);
          continue;
        }
        if (!input_.used[m] || source.image == kNone) {
          if (input_.used[m]) warn(absl::StrCat("textures[", ref->texture, "]"), "has no image");
          *ref = TextureRef();
          continue;
        }
        if (!decoded.contains(source.image)) {
          absl::Status status = add_image(source.image);
          if (!status.ok()) return status;
          decoded[source.image] = static_cast<std::int32_t>(scene_.images.size()) - 1;
        }
        scene_.textures[ref->texture].image = decoded[source.image];
      }
    }
    add_densities();
    return absl::OkStatus();
  }

 private:
  void warn(const std::string& element, const std::string& message) {
    problems_.push_back({Problem::Severity::warning, element, message});
  }

  /// Copies the procedural textures of media densities and updates their indices.
  void add_densities() {
    const auto add = [this](Medium& medium) {
      if (medium.procedural == kNone) return;
      const std::int32_t texture = medium.procedural;
      add_procedural(texture);
      medium.procedural = scene_.textures[texture].procedural;
    };
    if (scene_.atmosphere) add(scene_.atmosphere->medium);
    for (std::size_t m = 0; m < scene_.materials.size(); ++m) {
      std::optional<Medium>& medium = scene_.materials[m].medium;
      if (!input_.used[m]) medium.reset();
      if (medium) add(*medium);
    }
  }

  void add_procedural(std::int32_t index) {
    Texture& texture = scene_.textures[index];
    if (texture.procedural != kNone) return;
    texture.procedural = static_cast<std::int32_t>(scene_.procedural_textures.size());
    scene_.procedural_textures.push_back(
        input_.model.procedural_textures[input_.model.texture_sources[index].procedural]);
  }

  /// Keeps one texel of an image with equal texels: bilinear filtering is exact on constants.
  template <typename T>
  static void collapse_uniform(SharedArray<T>& texels, Image& image) {
    const auto channels = static_cast<std::size_t>(image.channels);
    if (texels.size() <= channels) return;
    // All are equal if each equals its predecessor.
    if (!std::equal(texels.begin() + channels, texels.end(), texels.begin())) return;
    texels = std::vector<T>(texels.begin(), texels.begin() + channels);
    image.width = image.height = 1;
  }

  template <typename T>
  absl::Status spill(SharedArray<T>& texels) {
    auto spilled = input_.reader.spill(std::as_bytes(std::span(texels.data(), texels.size())));
    if (!spilled.ok()) return spilled.status();
    if (*spilled == nullptr) {
      input_.memory.take(texels.size() * sizeof(T));
      return absl::OkStatus();
    }
    const auto* const first = reinterpret_cast<const T*>(spilled->get());
    texels = SharedArray<T>(*std::move(spilled), first, texels.size());
    return absl::OkStatus();
  }

  absl::Status store_texels(Image& image) {
    collapse_uniform(image.u8, image);
    collapse_uniform(image.u16, image);
    collapse_uniform(image.f32, image);
    if (!image.u8.empty()) return spill(image.u8);
    if (!image.u16.empty()) return spill(image.u16);
    return spill(image.f32);
  }

  absl::Status add_image(std::int32_t index) {
    const GltfImage& source = input_.model.images[index];
    Image& image = input_.next_cache.images[index];
    if (const auto before = input_.cache.images.find(index); before != input_.cache.images.end()) {
      image = before->second;
    } else {
      auto decoded = decode_image(source.bytes, source.name, input_.memory.left());
      absl::Status status = decoded.ok() ? store_texels(*decoded) : decoded.status();
      if (!status.ok()) {
        return absl::Status(status.code(), absl::StrCat(source.name, ": ", status.message()));
      }
      image = *std::move(decoded);
    }
    image_bytes_ += image.u8.size() + 2 * image.u16.size() + 4 * image.f32.size();
    if (image_bytes_ > kMaxAllImageBytes) {
      return absl::InvalidArgumentError(absl::StrCat(
          source.name, ": the images decode to more than ", kMaxAllImageBytes, " bytes"));
    }
    scene_.images.push_back(image);
    return absl::OkStatus();
  }

  const TextureInput& input_;
  Scene& scene_;
  std::vector<Problem>& problems_;
  std::uint64_t image_bytes_ = 0;
};

}  // namespace

absl::Status add_textures(const TextureInput& input, Scene& scene, std::vector<Problem>& problems) {
  return TextureBuilder(input, scene, problems).add_all();
}

}  // namespace tessera::render
