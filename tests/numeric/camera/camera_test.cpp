/// TESSERA_camera, from Scene::camera to the ray and the pixel. Reading it from files is tested in
/// unit/worker/gltf/extensions/extensions_test.cpp.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "tests/support/scene/plain_scene.h"
#include "worker/render/camera/aperture.h"
#include "worker/render/camera/camera_rays.h"

namespace tessera::testing {
namespace {

using render::Camera;
using render::CameraRay;
using render::CameraRays;
using render::Scene;
using render::Vec2f;
using render::Vec3d;
using render::Vec3f;

constexpr std::int32_t kWidth = 64, kHeight = 48;
/// A float direction is within 2^-24 per component of the true one, so within 2e-7 rad; the
/// narrowest pixel below is 0.02 rad wide.
constexpr double kPixels = 2e-7 / 0.02 * 4;

struct Film {
  double x, y;
};

/// Film position of a direction (right, up, forward), computed with libm.
Film film_of(const Camera& camera, const Vec3d& d) {
  const double middle_x = kWidth / 2.0, middle_y = kHeight / 2.0;
  const double longitude = std::atan2(d.x, d.z), level = std::hypot(d.x, d.z);
  const double x = middle_x + longitude / camera.horizontal_angle * kWidth;
  if (camera.kind == Camera::Kind::spherical) {
    return {x, middle_y - std::atan2(d.y, level) / camera.vertical_angle * kHeight};
  }
  if (camera.kind == Camera::Kind::cylindrical) {
    const double top = std::tan(camera.vertical_angle / 2);
    return {x, middle_y - d.y / level / top * middle_y};
  }
  const double angle = std::atan2(std::hypot(d.x, d.y), d.z), widest = camera.horizontal_angle / 2;
  const double r = camera.kind == Camera::Kind::equidistant
                       ? angle / widest
                       : std::sin(angle / 2) / std::sin(widest / 2);
  const double around = std::atan2(d.y, d.x);
  return {middle_x + r * middle_y * std::cos(around), middle_y - r * middle_y * std::sin(around)};
}

Scene curved(Camera::Kind kind, double horizontal, double vertical) {
  Scene scene = empty_scene();
  look_at(&scene, {0.3, -0.2, 0.9}, {0.3, -0.2, -5});  // axes are the world's
  scene.camera.kind = kind;
  scene.camera.horizontal_angle = horizontal;
  scene.camera.vertical_angle = vertical;
  return scene;
}

TEST(PanoramicCamera, RaysFollowProjectionFormula) {
  for (const Camera& camera :
       {curved(Camera::Kind::spherical, 2 * std::numbers::pi, std::numbers::pi).camera,
        curved(Camera::Kind::spherical, 1.3, 1).camera,
        curved(Camera::Kind::cylindrical, 2 * std::numbers::pi, 2).camera,
        curved(Camera::Kind::cylindrical, 2, 3).camera,
        curved(Camera::Kind::equidistant, std::numbers::pi, std::numbers::pi).camera,
        curved(Camera::Kind::equidistant, 1.9 * std::numbers::pi, 1.9 * std::numbers::pi).camera,
        curved(Camera::Kind::equisolid, std::numbers::pi, std::numbers::pi).camera,
        curved(Camera::Kind::equisolid, 1.9 * std::numbers::pi, 1.9 * std::numbers::pi).camera}) {
    const CameraRays rays(camera, kWidth, kHeight);
    int seen = 0;
    for (double y = 0.37; y < kHeight; ++y) {
      for (double x = 0.61; x < kWidth; ++x) {
        CameraRay ray;
        const bool round = camera.kind >= Camera::Kind::equidistant;
        const double r = std::hypot(x - kWidth / 2.0, y - kHeight / 2.0) / (kHeight / 2.0);
        ASSERT_EQ(rays.ray(x, y, {}, &ray), !round || r <= 1) << x << ", " << y;
        if (round && r > 1) continue;
        const Vec3f& d = ray.direction;
        ASSERT_NEAR(length(Vec3d(d)), 1, 1e-6);
        const Film at = film_of(camera, {double{d.x}, double{d.y}, -double{d.z}});
        // Near the poles a degree of longitude is shorter by its cosine.
        const double cosine = round ? 1 : std::hypot(double{d.x}, double{d.z});
        ASSERT_NEAR(at.x, x, kPixels / cosine) << static_cast<int>(camera.kind) << " " << y;
        ASSERT_NEAR(at.y, y, kPixels / (round ? 1 : cosine * cosine))
            << static_cast<int>(camera.kind) << " " << x;
        ++seen;
      }
    }
    EXPECT_GT(seen, 1000);
  }
}

/// project() finds the film point of every ray, at any distance.
void expect_projection(const Camera& camera) {
  const CameraRays rays(camera, kWidth, kHeight);
  for (double y = 0.37; y < kHeight; y += 3) {
    for (double x = 0.61; x < kWidth; x += 3) {
      CameraRay ray;
      if (!rays.ray(x, y, {}, &ray)) continue;
      const auto film = rays.project(Vec3d(ray.origin) + Vec3d(ray.direction) * 3.0);
      ASSERT_TRUE(film.has_value());
      EXPECT_NEAR(film->x, x, 2e-4) << static_cast<int>(camera.kind) << " at " << y;
      EXPECT_NEAR(film->y, y, 2e-4) << static_cast<int>(camera.kind) << " at " << x;
    }
  }
}

TEST(Camera, ProjectionInvertsRays) {
  Scene scene = empty_scene();
  look_at(&scene, {1, 2, 5}, {0.2, 0, 0});
  Camera& camera = scene.camera;
  camera.yfov = 0.9;
  camera.znear = 0.25;
  camera.center_x = 0.3;
  camera.center_y = -0.2;
  expect_projection(camera);
  EXPECT_FALSE(CameraRays(camera, kWidth, kHeight).project({2, 4, 10}).has_value()) << "behind";
  camera.kind = Camera::Kind::orthographic;
  camera.slant_x = 0.5;
  camera.slant_y = -0.25;
  expect_projection(camera);
  expect_projection(curved(Camera::Kind::spherical, 1.3, 1).camera);
  expect_projection(curved(Camera::Kind::cylindrical, 2, 2).camera);
  expect_projection(curved(Camera::Kind::equidistant, 3, 3).camera);
  expect_projection(curved(Camera::Kind::equisolid, 3, 3).camera);
}

TEST(PanoramicCamera, FisheyeIsBlackOutsideCircle) {
  Scene scene = curved(Camera::Kind::equidistant, std::numbers::pi, std::numbers::pi);
  set_constant_sky(&scene, 1);
  const Picture picture = render_picture(scene, small_settings(40, 20, 4));
  EXPECT_EQ(picture.at(20, 10).x, 1);
  EXPECT_EQ(picture.at(2, 10).x, 0);
  EXPECT_EQ(picture.alpha[10 * 40 + 2], 1);
}

TEST(OffAxisCamera, HalfWindowsMatchFullWindow) {
  for (const auto kind : {Camera::Kind::perspective, Camera::Kind::orthographic}) {
    Scene scene = empty_scene();
    look_at(&scene, {1, 2, 5}, {0.2, 0, 0});
    scene.camera.kind = kind;
    scene.camera.yfov = 2 * std::atan(0.75);
    scene.camera.ymag = 0.75;
    scene.camera.znear = 0.25;
    const CameraRays whole(scene.camera, 64, 48);
    scene.camera.center_x = 0.5;  // the right half of [-1, 1]
    const CameraRays half(scene.camera, 32, 48);
    for (double y = 0.5; y < 48; ++y) {
      for (double x = 0.5; x < 32; ++x) {
        CameraRay a, b;
        ASSERT_TRUE(half.ray(x, y, {}, &a) && whole.ray(x + 32, y, {}, &b));
        for (int k = 0; k < 3; ++k) {
          ASSERT_NEAR(a.direction[k], b.direction[k], 1e-7);
          ASSERT_NEAR(a.origin[k], b.origin[k], 1e-6);
        }
      }
    }
  }
}

TEST(ObliqueCamera, ShiftGrowsWithDepth) {
  Scene scene = empty_scene();
  look_at(&scene, {0, 0, 5}, {0, 0, 0});
  scene.camera.kind = Camera::Kind::orthographic;
  scene.camera.ymag = 2;
  scene.camera.slant_x = 0.5;
  scene.camera.slant_y = -0.25;
  scene.camera.znear = 1;
  scene.camera.zfar = 11;
  const CameraRays rays(scene.camera, 40, 40);
  CameraRay ray;
  ASSERT_TRUE(rays.ray(10, 30, {}, &ray));
  const auto depth_at = [&](double t) { return Vec3d(ray.origin) + Vec3d(ray.direction) * t; };
  EXPECT_NEAR(ray.origin.z, 4, 1e-6);
  EXPECT_NEAR(ray.origin.x, -1 + 0.5, 1e-6);
  EXPECT_NEAR(ray.origin.y, -1 - 0.25, 1e-6);
  const Vec3d far = depth_at(double{ray.t_max});
  EXPECT_NEAR(far.z, -6, 1e-5);
  EXPECT_NEAR(far.x, -1 + 0.5 * 11, 1e-5);
  EXPECT_NEAR(far.y, -1 - 0.25 * 11, 1e-5);
}

/// Camera rays of a sphere that fills four fifths of the picture, seen from `distance` metres.
CameraRays distant_rays(Camera::Kind kind, double distance) {
  Scene scene = empty_scene();
  look_at(&scene, Vec3d{0.36, 0.48, 0.8} * distance, {0, 0, 0});
  scene.camera.kind = kind;
  scene.camera.yfov = 2.5 / distance;
  scene.camera.ymag = 1.25;
  scene.camera.znear = 0.01;
  CameraRays rays(scene.camera, kWidth, kHeight);
  rays.start_near({-1, -1, -1}, {1, 1, 1});
  return rays;
}

TEST(Camera, DistantRaysMissTargetByLittle) {
  // Axes of the camera, as look_at() makes them: -Z to the target, X level.
  const Vec3d back{0.36, 0.48, 0.8};
  const Vec3d right = normalize(cross(Vec3d{0, 1, 0}, back)), up = cross(back, right);
  // Rays start within two diagonals, 7 m, of the middle: origin and direction are rounded there,
  // each by at most 7 m * 2^-24 a component. In double, positions at 1e9 m are within 2e-7 m.
  const double tolerance = 2 * 1.8 * 7 * 0x1p-24 + 4e-7;
  for (const Camera::Kind kind : {Camera::Kind::perspective, Camera::Kind::orthographic}) {
    for (const double distance : {1e5, 1e7, 1e8, 1e9}) {
      const CameraRays rays = distant_rays(kind, distance);
      for (double y = 0.37; y < kHeight; y += 3) {
        for (double x = 0.61; x < kWidth; x += 3) {
          CameraRay ray;
          ASSERT_TRUE(rays.ray(x, y, {}, &ray));
          const Vec3d origin(ray.origin), direction(ray.direction);
          const Vec3d hit = origin - direction * (dot(origin, back) / dot(direction, back));
          const double pixel = 2.5 / kHeight;
          const Vec3d expected =
              right * ((x - kWidth / 2.0) * pixel) + up * ((kHeight / 2.0 - y) * pixel);
          ASSERT_LT(length(hit - expected), tolerance) << distance << ": " << x << ", " << y;
        }
      }
    }
  }
}

TEST(Camera, NearbyRaysStartAtNearPlane) {
  Scene scene = empty_scene();
  look_at(&scene, {0, 0, 500}, {0, 0, 0});
  scene.camera.znear = 0.5;
  CameraRays rays(scene.camera, kWidth, kHeight);
  rays.start_near({-1, -1, -1}, {1, 1, 1});
  CameraRay ray;
  ASSERT_TRUE(rays.ray(kWidth / 2.0, kHeight / 2.0, {}, &ray));
  EXPECT_EQ(ray.origin.z, 499.5f);
}

TEST(Camera, ObjectsBehindItAreInvisible) {
  const auto seen = [](Scene scene) {
    render::Material m = lambert({0, 0, 0});
    m.emission = {1, 1, 1};
    m.double_sided = true;
    const auto lamp = add_material(&scene, m);
    // Everything behind z = 5 + 1e-3 emits: one wall as wide as a lens can see.
    add_primitive(&scene, quad({-1e4f, -1e4f, 5.001f}, {2e4f, 0, 0}, {0, 2e4f, 0}, lamp));
    return render_picture(scene, small_settings(32, 32, 16)).mean();
  };
  Scene scene = empty_scene();
  EXPECT_EQ(seen(scene), 0);
  scene.camera.yfov = 3.1;
  EXPECT_EQ(seen(scene), 0);
  scene.camera.center_x = 5;
  scene.camera.lens = {0.5, 2, 5, 0, 0, INFINITY};
  EXPECT_EQ(seen(scene), 0);
  scene.camera.kind = Camera::Kind::orthographic;
  scene.camera.lens = {};
  scene.camera.slant_x = 30;
  EXPECT_EQ(seen(scene), 0);
  for (const auto kind : {Camera::Kind::spherical, Camera::Kind::cylindrical,
                          Camera::Kind::equidistant, Camera::Kind::equisolid}) {
    Scene screen = empty_scene();
    screen.camera.kind = kind;
    screen.camera.horizontal_angle = screen.camera.vertical_angle = std::numbers::pi - 1e-3;
    EXPECT_EQ(seen(screen), 0);
    screen.camera.horizontal_angle = 1.9 * std::numbers::pi;  // sees behind itself
    EXPECT_GT(seen(screen), 0);
  }
}

TEST(Aperture, SamplesAreUniformOverPolygon) {
  constexpr int kSide = 256;
  for (const std::int32_t blades : {0, 3, 5, 8}) {
    render::Lens lens;
    lens.radius = 2;
    lens.blades = blades;
    lens.blade_rotation = 0.3;
    double x = 0, y = 0, square = 0;
    for (int i = 0; i < kSide * kSide; ++i) {
      const Vec2f u{(static_cast<float>(i % kSide) + 0.5f) / kSide,
                    (static_cast<float>(i / kSide) + 0.5f) / kSide};
      const render::AperturePoint p = aperture_point(lens, u);
      x += p.x, y += p.y, square += p.x * p.x + p.y * p.y;
      for (std::int32_t k = 0; k < blades; ++k) {  // inside every side
        const double normal = 0.3 + (2 * k + 1) * std::numbers::pi / blades;
        ASSERT_LE(p.x * std::cos(normal) + p.y * std::sin(normal),
                  2 * std::cos(std::numbers::pi / blades) + 1e-6);
      }
      ASSERT_LE(p.x * p.x + p.y * p.y, 4 + 1e-5);
    }
    constexpr double kCount = double{kSide} * kSide;
    // Second moment of a regular polygon of circumradius R: R^2 (2 + cos(2 pi / n)) / 6. The error
    // of the midpoint rule is the square of the strata's side, blades / 256, times a second
    // derivative.
    const double expected = blades == 0 ? 2 : 4 * (2 + std::cos(2 * std::numbers::pi / blades)) / 6;
    const double side = std::max(blades, 4) / double{kSide};
    EXPECT_NEAR(square / kCount, expected, 4 * side * side) << blades;
    EXPECT_NEAR(x / kCount, 0, 4.0 / kSide) << blades;
    EXPECT_NEAR(y / kCount, 0, 4.0 / kSide) << blades;
  }
}

/// Fraction of a unit disc inside a disc of radius r whose centre is at distance d.
double common_share(double r, double d) {
  if (d >= 1 + r) return 0;
  if (d <= std::abs(1 - r)) return std::min(1.0, r * r);
  const double a = std::acos((d * d + 1 - r * r) / (2 * d));
  const double b = std::acos((d * d + r * r - 1) / (2 * d * r));
  return (a - std::sin(2 * a) / 2 + r * r * (b - std::sin(2 * b) / 2)) / std::numbers::pi;
}

TEST(Lens, VignettingEqualsDiscOverlap) {
  Scene scene = empty_scene();
  scene.camera.yfov = 2 * std::atan(1.0);
  scene.camera.lens = {0.5, 1e12, 0, 0, 0.8, 0.6};
  const CameraRays rays(scene.camera, 100, 100);
  constexpr int kSide = 256;
  for (const double x : {50.0, 70.0, 80.0, 95.0}) {
    int open = 0;
    for (int i = 0; i < kSide * kSide; ++i) {
      const Vec2f u{(static_cast<float>(i % kSide) + 0.5f) / kSide,
                    (static_cast<float>(i / kSide) + 0.5f) / kSide};
      CameraRay ray;
      open += rays.ray(x, 50, u, &ray) ? 1 : 0;
    }
    const double share = common_share(0.6 / 0.5, (x - 50) / 50 * 0.8 / 0.5);
    // A curve shorter than 3 sides crosses at most 3 * 256 strata twice.
    EXPECT_NEAR(open / double{kSide * kSide}, share, 6.0 / kSide) << x;
  }
}

/// Three emissive stripes of different colours before, in and behind the plane of focus.
Scene stripes() {
  Scene scene = empty_scene();
  const auto stripe = [&](float z, float x, float width, const Vec3f& light) {
    render::Material m = lambert({0, 0, 0});
    m.emission = light;
    const auto index = add_material(&scene, m);
    add_primitive(&scene, quad({x, -9, z}, {width, 0, 0}, {0, 18, 0}, index));
  };
  stripe(3, -0.4f, 0.2f, {1, 0, 0});
  stripe(0, -0.9f, 0.9f, {0, 1, 0});
  stripe(-5, 0.4f, 1.5f, {0, 0, 1});
  // A row of 24 pixels, each 1 / 40 wide at depth 1; the lens below blurs over 1 to 6 of them.
  scene.camera.yfov = 2 * std::atan(1.0 / 80);
  return scene;
}

/// Mean and squared standard error of a pixel's channels over independent images.
struct Estimate {
  std::vector<double> sum, squares;
  double count = 0;
  void add(const Picture& p) {
    sum.resize(p.rgb.size());
    squares.resize(p.rgb.size());
    for (std::size_t i = 0; i < p.rgb.size(); ++i) {
      sum[i] += p.rgb[i];
      squares[i] += p.rgb[i] * p.rgb[i];
    }
    ++count;
  }
  double mean(std::size_t i) const { return sum[i] / count; }
  double error2(std::size_t i) const {
    return std::max(squares[i] / count - mean(i) * mean(i), 0.0) / (count - 1);
  }
};

/// A pinhole image from the point (x, y) of the lens, with the window through which that point sees
/// the film in focus.
Picture through_window(double x, double y, double focus, std::uint32_t seed) {
  Scene sharp = stripes();
  sharp.camera.camera_to_world.translation += Vec3d{x, y, 0};
  sharp.camera.center_x = -x / focus;
  sharp.camera.center_y = -y / focus;
  auto settings = small_settings(24, 1, 4);
  settings.seed = seed;
  return render_picture(sharp, settings);
}

TEST(Lens, BlurEqualsAverageOfPinholes) {
  constexpr double kRadius = 0.25, kFocus = 5;
  constexpr int kSide = 16;  // strata of radius, and of angle
  constexpr std::uint32_t kPictures = 32;
  Scene blurred = stripes();
  blurred.camera.lens = {kRadius, kFocus, 0, 0, 0, INFINITY};
  std::mt19937 rng(7);
  std::uniform_real_distribution<double> uniform(0, 1);
  Estimate lens, average;
  for (std::uint32_t seed = 0; seed < kPictures; ++seed) {
    auto settings = small_settings(24, 1, 1024);
    settings.seed = seed;
    lens.add(render_picture(blurred, settings));
    Picture sum;
    for (int i = 0; i < kSide * kSide; ++i) {
      const double r = kRadius * std::sqrt((i % kSide + uniform(rng)) / kSide);
      const double turn = 2 * std::numbers::pi * (i / kSide + uniform(rng)) / kSide;
      const auto number = seed * kSide * kSide + static_cast<std::uint32_t>(i);
      const Picture one =
          through_window(r * std::cos(turn), r * std::sin(turn), kFocus, 1000 + number);
      if (sum.rgb.empty()) sum.rgb.assign(one.rgb.size(), 0);
      for (std::size_t k = 0; k < one.rgb.size(); ++k) {
        sum.rgb[k] += one.rgb[k] / (kSide * kSide);
      }
    }
    average.add(sum);
  }
  double largest = 0, mean_error = 0;
  const std::size_t count = lens.sum.size();
  for (std::size_t i = 0; i < count; ++i) {
    const double error = std::sqrt(lens.error2(i) + average.error2(i));
    mean_error += error / static_cast<double>(count);
    const double off = std::abs(lens.mean(i) - average.mean(i));
    // Equal samples have no variance, only rounding.
    if (off > 1e-6) largest = std::max(largest, off / error);
  }
  // The largest of 72 values of t with 31 degrees of freedom exceeds 4.5 once in 100 times.
  EXPECT_LT(largest, 4.5);
  EXPECT_LT(mean_error, 1e-3);  // small enough to detect a radius wrong by a tenth
  EXPECT_GT(mean_error, 0);
}

}  // namespace
}  // namespace tessera::testing
