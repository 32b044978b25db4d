#include "worker/render/numerics/numerics_check.h"

#include <array>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "contract/film_block.h"
#include "worker/gltf/decode/image_decoder.h"
#include "worker/math/elementary.h"
#include "worker/render/frame_renderer.h"
#include "worker/render/numerics/numerics_images.h"

namespace tessera::render {
namespace {

template <typename T>
void add(contract::Hasher* hasher, const T& value) {
  hasher->update(std::as_bytes(std::span(&value, 1)));
}

template <typename T>
void add_functions(contract::Hasher* hasher, T x) {
  const T in_unit = x / (1 + x * x);
  for (const T value :
       {elementary::sin(x), elementary::cos(x), elementary::tan(x), elementary::exp(x),
        elementary::log(x * x), elementary::atan2(x, in_unit), elementary::acos(in_unit),
        elementary::asin(in_unit), elementary::pow(x * x, in_unit)}) {
    add(hasher, value);
  }
}

/// Arguments from 2^-30 to 2^30 of both signs, with digits in all positions.
void add_elementary_functions(contract::Hasher* hasher) {
  double x = 0x1p-30;
  for (int i = 0; i < 400; ++i) {
    x *= 1.1096;
    for (const double signed_x : {x, -x}) {
      add_functions(hasher, signed_x);
      const auto f = static_cast<float>(signed_x);
      add_functions(hasher, f);
      add(hasher, elementary::expm1(f));
      add(hasher, elementary::log1p(f * f));
      const elementary::SinCosf pair = elementary::sincos(f);
      add(hasher, pair.sin);
      add(hasher, pair.cos);
    }
  }
}

absl::Status add_images(Scene* scene) {
  const std::array<std::span<const std::byte>, 3> files = {numerics_png(), numerics_jpeg(),
                                                           numerics_exr()};
  for (std::size_t i = 0; i < files.size(); ++i) {
    auto image = i == 2 ? decode_environment(files[i], "exr") : decode_image(files[i], "image");
    if (!image.ok()) return image.status();
    scene->images.push_back(*std::move(image));
  }
  scene->textures = {{0, Wrap::repeat, Wrap::mirror, false}, {1, Wrap::clamp, Wrap::repeat, false}};
  return absl::OkStatus();
}

TextureRef texture(std::int32_t index, bool srgb) {
  TextureRef ref;
  ref.texture = index;
  ref.srgb = srgb;
  ref.has_transform = true;
  ref.uv_matrix = {1.7f, 0.3f, -0.2f, -0.4f, 1.1f, 0.6f};
  return ref;
}

void add_materials(Scene* scene) {
  Material floor;  // mixed, textured, normal-mapped
  floor.base_color_texture = texture(1, true);
  floor.metallic_roughness_texture = texture(0, false);
  floor.normal_texture = texture(0, false);
  Material metal;
  metal.base_color = {0.9f, 0.7f, 0.3f, 1};
  metal.roughness = 0.35f;
  Material glass;
  glass.metallic = 0;
  glass.roughness = 0.2f;
  glass.transmission = 1;
  glass.has_volume = true;
  glass.attenuation_color = {0.5f, 0.8f, 0.9f};
  glass.attenuation_distance = 0.4f;
  Material thin;
  thin.metallic = 0;
  thin.roughness = 0;
  thin.transmission = 0.7f;
  thin.base_color = {0.8f, 0.9f, 0.6f, 0.6f};
  thin.alpha_mode = AlphaMode::blend;
  Material area_light;
  area_light.emission = {4, 3, 2};
  area_light.emissive_texture = texture(1, true);
  scene->materials = {floor, metal, glass, thin, area_light};
}

/// Adds a box of six two-triangle faces at the origin, with UVs and smooth normals from the
/// corners.
Primitive box(std::int32_t material, bool smooth) {
  Primitive p;
  p.material = material;
  for (int i = 0; i < 8; ++i) {
    const Vec3f c{i & 1 ? 0.5f : -0.5f, i & 2 ? 0.5f : -0.5f, i & 4 ? 0.5f : -0.5f};
    p.positions.push_back(c);
    if (smooth) p.normals.push_back(normalize(c));
    p.uv[0].push_back({c.x + 0.7f * c.z, c.y - 0.3f * c.z});
    p.colors.push_back({1, 1 - 0.1f * static_cast<float>(i & 3), 1, 1});
  }
  constexpr std::array<std::array<std::uint32_t, 4>, 6> kFaces = {
      {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}}};
  for (const auto& f : kFaces) {
    p.triangles.push_back({f[0], f[1], f[2]});
    p.triangles.push_back({f[0], f[2], f[3]});
  }
  return p;
}

void add_box(Scene* scene, std::int32_t material, const Vec3d& scale, const Vec3d& at,
             double turn) {
  const double c = elementary::cos(turn), s = elementary::sin(turn);
  Instance instance;
  instance.mesh = static_cast<std::int32_t>(scene->meshes.size());
  instance.node = instance.mesh;
  Affine3d& m = instance.object_to_world;
  m.rows = {Vec3d{c * scale.x, -s * scale.y, 0}, Vec3d{s * scale.x, c * scale.y, 0},
            Vec3d{0, 0, scale.z}};
  m.translation = at;
  const auto back = inverse(m);
  if (!back) return;
  instance.world_to_object = *back;
  instance.flips_winding = determinant(m) < 0;
  scene->instances.push_back(instance);
  scene->meshes.push_back({"", {box(material, turn != 0)}});
}

void add_lights(Scene* scene) {
  PunctualLight spot;
  spot.kind = PunctualLight::Kind::spot;
  spot.intensity = {9, 8, 7};
  spot.position = {0.5, 2, 0.5};
  spot.direction = normalize(Vec3f{-0.2f, -1, -0.2f});
  spot.cos_inner = 0.95f;
  PunctualLight directional;
  directional.kind = PunctualLight::Kind::directional;
  directional.intensity = {0.5f, 0.5f, 0.6f};
  directional.direction = normalize(Vec3f{0.3f, -1, -0.5f});
  PunctualLight point;
  point.intensity = {2, 2, 2};
  point.position = {-1, 1, 1};
  point.range = 5;
  scene->lights = {spot, directional, point};
  scene->has_environment = true;
  scene->environment.image = 2;
  scene->environment.rotation_degrees = 33;
  scene->environment.strength = 0.7f;
}

absl::StatusOr<Scene> reference_scene() {
  Scene scene;
  absl::Status images = add_images(&scene);
  if (!images.ok()) return images;
  add_materials(&scene);
  add_box(&scene, 0, {4, 0.1, 4}, {0, -0.8, 0}, 0);
  add_box(&scene, 1, {0.7, -0.9, 0.6}, {-0.7, -0.1, 0}, 0.5);  // mirrored
  add_box(&scene, 2, {0.6, 0.8, 0.7}, {0.6, -0.2, 0.2}, 0.3);
  add_box(&scene, 3, {1.2, 1.1, 0.01}, {0, 0, 0.9}, 0.1);
  add_box(&scene, 4, {0.5, 0.02, 0.5}, {0.2, 1.3, -0.4}, 0.2);
  add_lights(&scene);
  scene.bounds_min = {-2.1, -0.9, -2.1};
  scene.bounds_max = {2.1, 1.4, 2.1};
  scene.camera.camera_to_world.translation = {0.1, 0.3, 3.5};
  scene.camera.znear = 0.01;
  return scene;
}

}  // namespace

absl::StatusOr<contract::Digest> numerics_digest(Isa isa) {
  auto scene = reference_scene();
  if (!scene.ok()) {
    return absl::Status(scene.status().code(),
                        absl::StrCat("numerics check: ", scene.status().message()));
  }
  contract::RenderSettings settings;
  settings.width = settings.height = 24;
  settings.seed = 2;
  settings.filter = contract::PixelFilter::blackman_harris;
  settings.filter_width = 3;
  settings.aovs = contract::kAovAlbedo | contract::kAovNormal | contract::kAovDepth |
                  contract::kAovPosition | contract::kAovIds;
  const auto renderer =
      FrameRenderer::create(*std::move(scene), settings, 1, sequential(), nullptr, isa);
  if (!renderer.ok()) return renderer.status();
  contract::Hasher hasher;
  add_elementary_functions(&hasher);
  hasher.update(contract::encode((*renderer)->render({0, 0, 24, 24}, {0, 8}, 0, sequential())));
  hasher.update(contract::encode((*renderer)->render({3, 5, 16, 8}, {8, 8}, 1, sequential())));
  return hasher.finish();
}

}  // namespace tessera::render
