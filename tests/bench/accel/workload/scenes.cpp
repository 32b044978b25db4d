#include "tests/bench/accel/workload/scenes.h"

#include <cmath>
#include <utility>

#include "tests/bench/accel/workload/shapes.h"

namespace tessera::render::bench {
namespace {

constexpr double kPi = 3.141592653589793;

/// Makes a finely meshed sphere with noise, similar to a scan.
Primitive scan(std::uint32_t rows, float radius, const Vec3f& centre) {
  return grid(rows, rows, [=](double u, double v) {
    const double theta = kPi * (0.002 + 0.996 * u), phi = 2 * kPi * v;
    const Vec3f n(
        Vec3d{std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi)});
    return centre + n * (radius * (1 + 0.5f * fractal_noise(n * 3.0f, 6)));
  });
}

/// Makes a tube along a (2, 3) torus knot.
Primitive knot(std::uint32_t rows, std::uint32_t columns, float size, const Vec3f& centre) {
  return grid(rows, columns, [=](double u, double v) {
    const auto path = [](double t) {
      const double r = 2 + std::cos(3 * t);
      return Vec3d{r * std::cos(2 * t), std::sin(3 * t), r * std::sin(2 * t)};
    };
    const double t = 2 * kPi * u;
    const Vec3d at = path(t), along = normalize(path(t + 1e-4) - at);
    const Vec3d side = normalize(cross(along, Vec3d{0, 1, 0})), up = cross(side, along);
    const double w = 2 * kPi * v;
    return centre + Vec3f(at + (side * std::cos(w) + up * std::sin(w)) * 0.4) * size;
  });
}

/// Makes a ribbed surface of revolution.
Primitive lathe(std::uint32_t rows, std::uint32_t columns, float size, const Vec3f& centre) {
  return grid(rows, columns, [=](double u, double v) {
    const double phi = 2 * kPi * v;
    const double r = (0.5 + 0.3 * std::sin(5 * u) + 0.02 * std::sin(24 * phi)) * (1.02 - u);
    return centre + Vec3f(Vec3d{r * std::cos(phi), 2 * u, r * std::sin(phi)}) * size;
  });
}

void add_room(Primitive& p, const Vec3f& lo, const Vec3f& hi) {
  const Vec3f e = hi - lo;
  add_box(p, lo, {e.x, 0, 0}, {0, e.y, 0}, {0, 0, e.z});
}

/// Adds thin bars with random positions and orientations.
void add_bars(Primitive& p, int count, Random& random) {
  for (int i = 0; i < count; ++i) {
    const Vec3f centre = Vec3f{random.both(), random.both(), random.both()} * 10.0f;
    const Vec3f along = random.direction();
    Vec3f a, b;
    make_frame(along, a, b);
    const float length = 1 + 3 * random.unit(), width = 0.01f;
    add_box(p, centre - along * (length / 2), along * length, a * width, b * width);
  }
}

/// Adds flights of stairs with fences, rotated by arbitrary angles.
void add_stairs(Primitive& p, int flights, int steps, Random& random) {
  for (int f = 0; f < flights; ++f) {
    const float angle = 6.2831853f * random.unit();
    const Vec3f x = {std::cos(angle), 0, std::sin(angle)}, z = {-x.z, 0, x.x}, y = {0, 1, 0};
    const Vec3f base = Vec3f{random.both(), random.both(), random.both()} * 8.0f;
    for (int s = 0; s < steps; ++s) {
      const auto k = static_cast<float>(s);
      const Vec3f step = base + x * (0.08f * k) + y * (0.05f * k);
      add_box(p, step, x * 0.09f, y * 0.02f, z * 1.5f);
      add_box(p, step + y * 0.05f, x * 0.01f, y * 0.6f, z * 0.01f);
    }
  }
}

void add_needles(Primitive& p, int count, Random& random) {
  for (int i = 0; i < count; ++i) {
    const Vec3f n = random.direction();
    const Vec3f tip = normalize(n + random.direction() * 0.4f);
    Vec3f a, b;
    make_frame(tip, a, b);
    const Vec3f root = n, side = a * 0.0015f;
    add_triangle(p, root - side, root + side, root + tip * (0.2f + 0.3f * random.unit()));
  }
}

void place(Scene& scene, std::int32_t mesh, const Affine3d& m = {}) {
  Instance instance;
  instance.mesh = mesh;
  instance.object_to_world = m;
  instance.world_to_object = inverse(m).value();
  scene.instances.push_back(instance);
}

/// Sets the scene to one mesh with the identity transform.
void set_mesh(BenchScene& out, std::vector<Primitive> primitives) {
  out.scene.meshes.resize(1);
  out.scene.meshes[0].primitives = std::move(primitives);
  place(out.scene, 0);
}

void set_light(BenchScene& out, const Vec3f& corner, float side) {
  out.light = corner;
  out.light_u = {side, 0, 0};
  out.light_v = {0, 0, side};
}

BenchScene scan_room(bool quick) {
  BenchScene out;
  Primitive room;
  add_room(room, {-4, -1.5f, -4}, {4, 4, 4});
  set_mesh(out, {scan(quick ? 40 : 186, 1, {0, 0, 0}), std::move(room)});
  out.eye = {1.5f, 0.8f, 3};
  set_light(out, {-0.5f, 3.9f, -0.5f}, 1);
  return out;
}

BenchScene model(bool quick) {
  BenchScene out;
  const std::uint32_t n = quick ? 20 : 160;
  Primitive ground;
  add_quad(ground, {-20, -1, -20}, {40, 0, 0}, {0, 0, 40});
  set_mesh(out, {knot(2 * n, n / 2, 0.35f, {0, 0.6f, 0}), lathe(n, n, 0.7f, {-1.6f, -1, 0.4f}),
                 lathe(n, n / 2, 0.5f, {1.5f, -1, 0.6f}), scan(n / 2, 0.4f, {0.4f, -0.6f, 1.2f}),
                 std::move(ground)});
  out.eye = {0.3f, 0.9f, 3.6f};
  set_light(out, {-3, 5, 1}, 2);
  return out;
}

BenchScene stadium(bool quick) {
  BenchScene out;
  const std::uint32_t n = quick ? 30 : 200;
  Primitive field;
  add_quad(field, {-200, 0, -200}, {400, 0, 0}, {0, 0, 400});
  for (int tier = 0; tier < 20; ++tier) {
    for (int seat = 0; seat < 200; ++seat) {
      const double a = 2 * kPi * seat / 200, r = 60 + 3.0 * tier;
      const Vec3f x(Vec3d{std::cos(a), 0, std::sin(a)}), z = {-x.z, 0, x.x};
      add_quad(field, x * static_cast<float>(r) + Vec3f{0, static_cast<float>(tier) * 1.5f, 0},
               x * 2.5f, z * 1.6f);
    }
  }
  set_mesh(out, {lathe(n, n, 0.2f, {0, 0, 0}), std::move(field)});
  out.eye = {0.7f, 0.6f, 0.9f};
  out.target = {0, 0.15f, 0};
  out.scale = 0.2f;
  set_light(out, {-40, 80, -40}, 80);
  return out;
}

BenchScene bars(bool quick) {
  BenchScene out;
  Random random(4);
  Primitive p;
  add_bars(p, quick ? 200 : 50'000, random);
  add_stairs(p, quick ? 4 : 230, quick ? 20 : 100, random);
  set_mesh(out, {std::move(p)});
  out.eye = {9, 5, 14};
  set_light(out, {-6, 16, -6}, 12);
  return out;
}

BenchScene terrain(std::uint32_t n) {
  BenchScene out;
  set_mesh(out, {grid(n, n, [](double u, double v) {
             const Vec3f at(Vec3d{20 * u - 10, 0, 20 * v - 10});
             return at + Vec3f{0, 2.5f * fractal_noise(at * 0.25f, 11), 0};
           })});
  out.eye = {-9, 4, -9};
  set_light(out, {-5, 20, 10}, 5);
  return out;
}

BenchScene hair(bool quick) {
  BenchScene out;
  Random random(6);
  Primitive needles;
  add_needles(needles, quick ? 3'000 : 500'000, random);
  set_mesh(out, {std::move(needles), grid(quick ? 16 : 64, quick ? 16 : 64, [](double u, double v) {
                   const double theta = kPi * (0.002 + 0.996 * u), phi = 2 * kPi * v;
                   return Vec3f(Vec3d{std::sin(theta) * std::cos(phi), std::cos(theta),
                                      std::sin(theta) * std::sin(phi)});
                 })});
  out.eye = {1.2f, 1, 3};
  set_light(out, {-2, 5, 2}, 2);
  return out;
}

/// Makes rotated and scaled instances of a scan and a knot on a ground plane.
BenchScene instances(bool quick) {
  BenchScene out;
  out.scene.meshes.resize(3);
  const std::uint32_t n = quick ? 20 : 160;
  out.scene.meshes[0].primitives = {scan(n, 1, {})};
  out.scene.meshes[1].primitives = {knot(2 * n, n / 2, 0.33f, {})};
  Primitive ground;
  add_quad(ground, {-100, -1.5f, -100}, {200, 0, 0}, {0, 0, 200});
  out.scene.meshes[2].primitives = {std::move(ground)};
  place(out.scene, 2);
  Random random(7);
  const int side = quick ? 6 : 32;
  for (int i = 0; i < side * side; ++i) {
    const Vec3d z(random.direction());
    const Vec3d x = normalize(cross(Vec3d(random.direction()), z)), y = cross(z, x);
    const double scale = 0.5 + static_cast<double>(random.unit());
    Affine3d m;
    m.rows = {x * scale, y * scale, z * scale};
    m.translation = {2.2 * (i % side - side / 2) + static_cast<double>(random.both()),
                     static_cast<double>(random.both()),
                     2.2 * (i / side - side / 2) + static_cast<double>(random.both())};
    place(out.scene, i % 2, m);
  }
  out.eye = {25, 9, 40};
  set_light(out, {-20, 60, 0}, 20);
  return out;
}

BenchScene finished(BenchScene scene, const std::string& name) {
  scene.name = name;
  scene.scene.materials.resize(1);
  scene.scene.camera.camera_to_world.translation = Vec3d(scene.eye);
  return scene;
}

}  // namespace

std::vector<std::string> scene_names() {
  return {"scan_room", "model", "stadium", "bars", "terrain", "hair", "instances"};
}

BenchScene make_scene(const std::string& name, bool quick) {
  const auto make = [&]() -> BenchScene {
    if (name == "scan_room") return scan_room(quick);
    if (name == "model") return model(quick);
    if (name == "stadium") return stadium(quick);
    if (name == "bars") return bars(quick);
    if (name == "terrain") return terrain(quick ? 48 : 1024);
    if (name == "hair") return hair(quick);
    return instances(quick);
  };
  return finished(make(), name);
}

BenchScene make_terrain(std::uint32_t cells) {
  return finished(terrain(cells), "terrain");
}

BenchScene make_layers(int layers) {
  BenchScene out;
  Primitive squares;
  for (int i = 0; i < layers; ++i) {
    const float gap = 1 / static_cast<float>(layers);
    add_quad(squares, {-4, -4, gap * static_cast<float>(-i)}, {8, 0, 0.25f * gap},
             {0, 8, 0.25f * gap});
  }
  set_mesh(out, {std::move(squares)});
  out.eye = {0, 0, 3};
  set_light(out, {-1, -1, 4}, 2);
  return finished(std::move(out), "layers");
}

std::int64_t triangle_count(const Scene& scene) {
  std::int64_t count = 0;
  for (const Mesh& mesh : scene.meshes) {
    for (const Primitive& p : mesh.primitives) {
      count += static_cast<std::int64_t>(p.triangles.size());
    }
  }
  return count;
}

}  // namespace tessera::render::bench
