#include "tests/support/scene/plain_scene.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "worker/render/frame_renderer.h"

namespace tessera::testing {
namespace {

using render::Affine3d;
using render::Primitive;
using render::Scene;
using render::Vec3d;
using render::Vec3f;

constexpr double kPi = 3.14159265358979323846;

void grow_bounds(Scene* scene, const Primitive& primitive, const Affine3d& placement) {
  for (const Vec3f& p : primitive.positions) {
    const Vec3d w = transform_point(placement, Vec3d(p));
    const bool first = scene->instances.size() == 1 && &p == primitive.positions.data();
    scene->bounds_min = first ? w : min(scene->bounds_min, w);
    scene->bounds_max = first ? w : max(scene->bounds_max, w);
  }
}

void append_quad(Primitive* p, const Vec3f& origin, const Vec3f& a, const Vec3f& b) {
  const auto first = static_cast<std::uint32_t>(p->positions.size());
  p->positions.insert(p->positions.end(), {origin, origin + a, origin + a + b, origin + b});
  p->uv[0].insert(p->uv[0].end(), {{0, 0}, {1, 0}, {1, 1}, {0, 1}});
  p->triangles.push_back({first, first + 1, first + 2});
  p->triangles.push_back({first, first + 2, first + 3});
}

}  // namespace

Scene empty_scene() {
  Scene scene;
  scene.materials.emplace_back();
  look_at(&scene, {0, 0, 5}, {0, 0, 0});
  return scene;
}

std::int32_t add_material(Scene* scene, const render::Material& material) {
  scene->materials.push_back(material);
  return static_cast<std::int32_t>(scene->materials.size()) - 1;
}

render::Material lambert(const Vec3f& albedo) {
  render::Material m;
  m.base_color = {albedo.x, albedo.y, albedo.z, 1};
  m.metallic = 0;
  m.specular = 0;
  return m;
}

render::Material lamp(float radiance) {
  render::Material m = lambert({0, 0, 0});
  m.emission = {radiance, radiance, radiance};
  return m;
}

render::Material metal(float roughness) {
  render::Material m;
  m.roughness = roughness;
  return m;
}

render::Material glass(float ior) {
  render::Material m;
  m.metallic = 0;
  m.roughness = 0;
  m.transmission = 1;
  m.has_volume = true;
  m.ior = ior;
  return m;
}

std::int32_t add_primitive(Scene* scene, Primitive primitive, const Affine3d& placement) {
  render::Instance instance;
  instance.mesh = static_cast<std::int32_t>(scene->meshes.size());
  instance.node = static_cast<std::int32_t>(scene->instances.size());
  instance.object_to_world = placement;
  instance.world_to_object = inverse(placement).value();
  instance.flips_winding = determinant(placement) < 0;
  scene->instances.push_back(instance);
  grow_bounds(scene, primitive, placement);
  render::Mesh mesh;
  mesh.primitives = {std::move(primitive)};
  scene->meshes.push_back(std::move(mesh));
  return static_cast<std::int32_t>(scene->instances.size()) - 1;
}

Primitive quad(const Vec3f& origin, const Vec3f& a, const Vec3f& b, std::int32_t material) {
  Primitive p;
  p.material = material;
  append_quad(&p, origin, a, b);
  return p;
}

Primitive sphere(const Vec3f& center, float radius, int segments, std::int32_t material) {
  Primitive p;
  p.material = material;
  const int rings = segments / 2;
  for (int j = 0; j <= rings; ++j) {
    for (int i = 0; i <= segments; ++i) {
      const double theta = kPi * j / rings, phi = 2 * kPi * i / segments;
      const Vec3f n(Vec3d{std::sin(theta) * std::cos(phi), std::cos(theta),
                          -std::sin(theta) * std::sin(phi)});
      p.positions.push_back(center + n * radius);
      p.normals.push_back(n);
      p.uv[0].push_back({static_cast<float>(i) / static_cast<float>(segments),
                         static_cast<float>(j) / static_cast<float>(rings)});
    }
  }
  const auto row = static_cast<std::uint32_t>(segments + 1);
  for (std::uint32_t j = 0; j < static_cast<std::uint32_t>(rings); ++j) {
    for (std::uint32_t i = 0; i + 1 < row; ++i) {
      const std::uint32_t a = j * row + i, b = a + row;
      if (j > 0) p.triangles.push_back({a, b, a + 1});
      if (j + 1 < static_cast<std::uint32_t>(rings)) p.triangles.push_back({a + 1, b, b + 1});
    }
  }
  return p;
}

Primitive box(const Vec3f& low, const Vec3f& high, bool inward, std::int32_t material) {
  Primitive p;
  p.material = material;
  const Vec3f d = high - low;
  const Vec3f x{d.x, 0, 0}, y{0, d.y, 0}, z{0, 0, d.z};
  const std::array<std::array<Vec3f, 3>, 6> faces = {
      {{low, y, x}, {low + z, x, y}, {low, x, z}, {low + y, z, x}, {low, z, y}, {low + x, y, z}}};
  for (const auto& f : faces) {
    if (inward) {
      append_quad(&p, f[0], f[2], f[1]);
    } else {
      append_quad(&p, f[0], f[1], f[2]);
    }
  }
  return p;
}

void look_at(Scene* scene, const Vec3d& eye, const Vec3d& target) {
  const Vec3d back = normalize(eye - target);
  const Vec3d up = std::fabs(back.y) > 0.999 ? Vec3d{0, 0, -1} : Vec3d{0, 1, 0};
  const Vec3d right = normalize(cross(up, back));
  const Vec3d top = cross(back, right);
  Affine3d& m = scene->camera.camera_to_world;
  m.rows = {Vec3d{right.x, top.x, back.x}, Vec3d{right.y, top.y, back.y},
            Vec3d{right.z, top.z, back.z}};
  m.translation = eye;
}

void set_constant_sky(Scene* scene, float radiance) {
  scene->has_environment = true;
  scene->environment = {};
  scene->environment.constant = {radiance, radiance, radiance};
}

void set_sky(Scene* scene, std::int32_t width, std::int32_t height, const std::vector<float>& rgb) {
  render::Image image;
  image.width = width;
  image.height = height;
  image.channels = 3;
  image.storage = render::Image::Storage::f32;
  image.f32 = rgb;
  scene->has_environment = true;
  scene->environment = {};
  scene->environment.image = static_cast<std::int32_t>(scene->images.size());
  scene->images.push_back(std::move(image));
}

Affine3d translation(double x, double y, double z) {
  Affine3d m;
  m.translation = {x, y, z};
  return m;
}

Affine3d scaling(double x, double y, double z) {
  Affine3d m;
  m.rows = {Vec3d{x, 0, 0}, Vec3d{0, y, 0}, Vec3d{0, 0, z}};
  return m;
}

Vec3d Picture::at(std::int32_t x, std::int32_t y) const {
  const auto i = 3 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                      static_cast<std::size_t>(x));
  return {rgb[i], rgb[i + 1], rgb[i + 2]};
}

double Picture::mean() const {
  double sum = 0;
  for (const double v : rgb) sum += v;
  return sum / static_cast<double>(rgb.size());
}

double Picture::mean_error() const {
  double sum = 0;
  for (const double e : error) sum += e * e;
  return std::sqrt(sum) / static_cast<double>(error.size());
}

double noise_between_seeds(const Scene& scene, contract::RenderSettings settings) {
  double sum = 0;
  for (int pair = 0; pair < 4; ++pair) {
    settings.seed = static_cast<std::uint32_t>(2 * pair);
    const Picture a = render_picture(scene, settings);
    settings.seed += 1;
    const Picture b = render_picture(scene, settings);
    for (std::size_t i = 0; i < a.rgb.size(); ++i) {
      const double scale = 0.5 * (a.rgb[i] + b.rgb[i]) + 0.1;
      sum += (a.rgb[i] - b.rgb[i]) * (a.rgb[i] - b.rgb[i]) / (scale * scale);
    }
  }
  return sum;
}

double largest_difference(const Picture& a, const Picture& b) {
  double largest = 0;
  for (std::int32_t y = 0; y + 4 <= a.height; y += 4) {
    for (std::int32_t x = 0; x + 4 <= a.width; x += 4) {
      double difference = 0, square = 0;
      for (std::int32_t i = 0; i < 16; ++i) {
        const auto at = 3 * static_cast<std::size_t>((y + i / 4) * a.width + x + i % 4);
        for (std::size_t c = at; c < at + 3; ++c) {
          difference += a.rgb[c] - b.rgb[c];
          square += a.error[c] * a.error[c] + b.error[c] * b.error[c];
        }
      }
      // The channels of a pixel have nearly equal errors, which add up.
      if (difference != 0)
        largest = std::max(largest, std::fabs(difference) / std::sqrt(3 * square));
    }
  }
  return largest;
}

contract::RenderSettings small_settings(std::int32_t width, std::int32_t height, std::int32_t spp) {
  contract::RenderSettings s;
  s.width = width;
  s.height = height;
  s.spp = spp;
  return s;
}

Picture render_picture(Scene scene, const contract::RenderSettings& settings,
                       const render::TraceOptions& tracing) {
  auto renderer = render::FrameRenderer::create(std::move(scene), settings, 0, render::sequential(),
                                                nullptr, tracing);
  Picture picture;
  if (!renderer.ok()) return picture;
  const contract::PixelRect window = settings.window();
  picture.width = window.width;
  picture.height = window.height;
  const auto pixels =
      static_cast<std::size_t>(window.width) * static_cast<std::size_t>(window.height);
  constexpr auto kStreams = static_cast<std::size_t>(contract::kReplicates);
  std::vector<double> sums(pixels * kStreams * 3), kept(pixels * kStreams, 0);
  picture.alpha.assign(pixels, 0);
  std::int32_t index = 0;
  for (const contract::Pass& pass : contract::fixed_schedule(settings.spp)) {
    contract::FilmBlock block = (*renderer)->render(window, pass, index++, render::sequential());
    for (std::size_t i = 0; i < sums.size(); ++i) sums[i] += block.rgb[i];
    for (double& k : kept) k += pass.sample_count / static_cast<double>(kStreams);
    for (const auto& d : block.dropped) kept[d.pixel * kStreams + d.replicate] -= d.count;
    for (std::size_t i = 0; i < pixels; ++i) picture.alpha[i] += block.alpha[i];
    picture.blocks.push_back(std::move(block));
  }
  picture.rgb.resize(pixels * 3);
  picture.error.resize(pixels * 3);
  for (std::size_t i = 0; i < pixels; ++i) {
    double all = 0;
    for (std::size_t r = 0; r < kStreams; ++r) all += kept[i * kStreams + r];
    picture.alpha[i] /= all;
    for (std::size_t c = 0; c < 3; ++c) {
      double sum = 0, squares = 0;
      for (std::size_t r = 0; r < kStreams; ++r) sum += sums[(i * kStreams + r) * 3 + c];
      const double mean = sum / all;
      for (std::size_t r = 0; r < kStreams; ++r) {
        const double d = sums[(i * kStreams + r) * 3 + c] / kept[i * kStreams + r] - mean;
        squares += d * d;
      }
      picture.rgb[3 * i + c] = mean;
      picture.error[3 * i + c] = std::sqrt(squares / (kStreams * (kStreams - 1)));
    }
  }
  return picture;
}

}  // namespace tessera::testing
